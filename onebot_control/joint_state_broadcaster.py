"""joint_state_broadcaster's choice of joints and interfaces. No ROS here."""

import math
from collections.abc import Sequence

from onebot_control.control_config import INTERFACES, BroadcasterConfig
from onebot_control.control_parameters import BROADCASTER
from onebot_control.simulation import JointStates
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.text import did_you_mean


class JointStateBroadcaster:
    """Says what a JointState message holds.

    Attributes:
        names: of the joints in the message.
        frame_id: of its header.
    """

    def __init__(self, config: BroadcasterConfig, joints: Sequence[str]) -> None:
        """Choose among ``joints``, those that there are.

        Raises:
            ConfigError: a joint named is not among them.
        """
        chosen = config.joints or tuple(joints)
        problems = [
            Problem(f"{BROADCASTER}.joints", f'no joint "{name}"{did_you_mean(name, joints)}')
            for name in chosen
            if name not in joints
        ]
        if problems:
            raise ConfigError(problems)
        extra = tuple(name for name in config.extra_joints if name not in chosen)
        self.names = (*chosen, *extra)
        self.frame_id = config.frame_id
        self._rows = [list(joints).index(name) for name in chosen]
        self._extra = [0.0] * len(extra)
        self._hidden = [math.nan] * len(chosen) + self._extra
        self._shown = [
            not config.interfaces or interface in config.interfaces for interface in INTERFACES
        ]

    def values(self, states: JointStates) -> list[list[float]]:
        """Return positions, velocities and efforts of ``names``; NaN where not asked for."""
        # For a handful of joints lists are quicker than arrays.
        return [
            self._chosen(field.tolist()) if shown else self._hidden
            for field, shown in zip(states, self._shown, strict=True)
        ]

    def _chosen(self, field: list[float]) -> list[float]:
        return [field[row] for row in self._rows] + self._extra
