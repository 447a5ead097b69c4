"""joint_state_broadcaster's choice of joints and interfaces. No ROS here."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from onebot_control.control_config import INTERFACES, BroadcasterConfig
from onebot_control.control_parameters import BROADCASTER
from onebot_control.simulation import JointStates
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.text import did_you_mean

Floats = NDArray[np.float64]


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
        self._shown = [
            not config.interfaces or interface in config.interfaces for interface in INTERFACES
        ]

    def arrays(self, states: JointStates) -> JointStates:
        """Return positions, velocities and efforts of ``names``; NaN where not asked for."""
        count = len(self._rows)
        fields = []
        for shown, values in zip(self._shown, states, strict=True):
            field = np.zeros(len(self.names))
            field[:count] = values[self._rows] if shown else np.nan
            fields.append(field)
        return JointStates(*fields)
