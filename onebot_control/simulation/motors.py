"""The motors of a robot's driven joints."""

import math
import sys
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from onebot_control.simulation.bodies import moving_joints
from onebot_control.simulation.engine import engine
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean


class Motors:
    """Velocity motors, each as strong and as fast as its joint's ``<limit>`` says."""

    def __init__(self, description: Description, driven: Sequence[str]) -> None:
        """Look the driven joints up.

        Raises:
            OneBotError: there are none, or one is unknown, named twice or without effort.
        """
        joints = {joint.name: joint for joint in moving_joints(description)}
        source = description.source
        if not driven:
            raise OneBotError(f"{source}: the simulation was given no driven joints")
        self.driven = tuple(driven)
        self._efforts = []
        for name in self.driven:
            if name not in joints:
                known = did_you_mean(name, joints, "joints that move")
                raise OneBotError(f'{source}: there is no joint "{name}" to drive{known}')
            if self.driven.count(name) > 1:
                raise OneBotError(f'{source}: driven joint "{name}" is named twice')
            effort = joints[name].effort
            if not effort:
                raise OneBotError(
                    f'{source}: driven joint "{name}" needs <limit effort="..." velocity="...">; '
                    "the effort (Nm, or N) is what its motor can do, and must be above 0"
                )
            self._efforts.append(effort)
        speeds = [joints[name].velocity for name in self.driven]
        # No infinity, so that whatever is not finite is beyond.
        self._fastest = [sys.float_info.max if speed is None else speed for speed in speeds]
        self._names = frozenset(self.driven)

    def targets(self, velocities: Mapping[str, float] | ArrayLike) -> list[float]:
        """Return the speeds in the order of ``driven``, no faster than the joints' limits.

        Raises:
            ValueError: one is missing, unknown or not finite.
        """
        if isinstance(velocities, Mapping):
            if velocities.keys() != self._names:
                raise ValueError(
                    f"velocities must be of exactly {', '.join(self.driven)}, "
                    f"not of {', '.join(map(str, velocities)) or 'nothing'}"
                )
            # Plain floats: for a handful of numbers arrays take longer than all the rest.
            values = [float(velocities[name]) for name in self.driven]
        else:
            wanted = np.asarray(velocities, float)
            if wanted.shape != (len(self.driven),):
                raise ValueError(
                    f"velocities must be {len(self.driven)} numbers, not {velocities!r}"
                )
            values = wanted.tolist()
        for row, fastest in enumerate(self._fastest):
            if not -fastest <= values[row] <= fastest:
                values[row] = self._limited(values[row], fastest)
        return values

    def _limited(self, value: float, fastest: float) -> float:
        """The speed nearest to ``value`` that is not too fast."""
        if not math.isfinite(value):
            # One NaN would make the whole world NaN for good.
            raise ValueError(f"velocities must be finite, not {value}")
        return math.copysign(fastest, value)

    def drive(
        self, client: int, body: int, indices: Sequence[int], targets: Sequence[float]
    ) -> None:
        """Have the motors keep up ``targets`` from now on.

        Args:
            client: PyBullet's number of the world.
            body: and of the robot in it.
            indices: and of the joints, in the order of ``driven``.
            targets: likewise, rad/s or m/s.
        """
        engine.setJointMotorControlArray(
            body,
            indices,
            engine.VELOCITY_CONTROL,
            targetVelocities=targets,
            forces=self._efforts,
            physicsClientId=client,
        )
