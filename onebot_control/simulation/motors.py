"""The motors of a robot's driven joints."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import Robot
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.model.robot_model import RobotModel
from onebot_description.text import did_you_mean


class Motors:
    """Velocity motors, each as strong and as fast as its joint's ``<limit>`` says."""

    def __init__(self, description: Description, driven: Sequence[str]) -> None:
        """Look the driven joints up.

        Raises:
            OneBotError: there are none, or one is unknown, named twice or without effort.
        """
        model = RobotModel.from_description(description)
        joints = {joint.name: joint for joint in description.joints}
        source = description.source
        if not driven:
            raise OneBotError(f"{source}: the simulation was given no driven joints")
        self.driven = tuple(driven)
        self._efforts = []
        for name in self.driven:
            if name not in model.joints:
                known = did_you_mean(name, model.joints, "joints that move")
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
        self._fastest = model.velocity[[model.row(name) for name in self.driven]].tolist()

    def targets(self, velocities: Mapping[str, float] | ArrayLike) -> list[float]:
        """Return the speeds in the order of ``driven``, no faster than the joints' limits.

        Raises:
            ValueError: one is missing, unknown or not finite.
        """
        if isinstance(velocities, Mapping):
            if velocities.keys() != set(self.driven):
                raise ValueError(
                    f"velocities must be of exactly {', '.join(self.driven)}, "
                    f"not of {', '.join(map(str, velocities)) or 'nothing'}"
                )
            velocities = [velocities[name] for name in self.driven]
        wanted = np.asarray(velocities, float)
        if wanted.shape != (len(self.driven),):
            raise ValueError(f"velocities must be {len(self.driven)} numbers, not {velocities!r}")
        # Plain floats: for a handful of numbers arrays take longer than all the rest.
        values = wanted.tolist()
        if not all(map(math.isfinite, values)):
            # One NaN would make the whole world NaN for good.
            raise ValueError(f"velocities must be finite, not {velocities!r}")
        return [
            min(max(value, -fastest), fastest)
            for value, fastest in zip(values, self._fastest, strict=True)
        ]

    def drive(self, client: int, robot: Robot, targets: Sequence[float]) -> None:
        """Have the motors keep up ``targets`` (in the order of ``driven``) from now on."""
        engine.setJointMotorControlArray(
            robot.body,
            [robot.joints[name] for name in self.driven],
            engine.VELOCITY_CONTROL,
            targetVelocities=targets,
            forces=self._efforts,
            physicsClientId=client,
        )
