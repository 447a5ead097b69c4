"""The interface of kinematics, which convert between body motion and wheel motion."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from onebot_description.geometry.poses import Triple


class DriveCommand(NamedTuple):
    """The current command, within limits, and the corresponding joint commands."""

    linear: float  # forward, m/s
    lateral: float  # leftward, m/s
    angular: float  # turning to the left, rad/s
    wheels: Sequence[float]  # velocity of each wheel, rad/s
    steering: Sequence[float] = ()  # position of each steering joint, rad


class Share(NamedTuple):
    """The body motion per meter of one wheel's path."""

    forward: float  # m
    left: float  # m
    lever: float  # path for a turn of 1 rad to the left, m; infinite if it does not turn the body


PathError = tuple[float, float, float, float]
"""The change of x (m), y (m) and yaw (rad) per meter of a wheel's path, and its variance, m^2."""


class Kinematics(ABC):
    """Converts between the motion of the body and that of its wheels.

    Wheels and steering joints have the order of ``Wheels.groups`` and ``Wheels.steering``; wheels
    that turn together count as one. Positive velocities drive forward. A motion of the body is an
    arc of constant velocity: forward and to the left, m, and turning to the left, rad; per second,
    these are the components of a PlanarVelocity.

    Attributes:
        shares: the contribution of each wheel to the motion of the body.
    """

    shares: Sequence[Share]

    @abstractmethod
    def command(
        self, twist: Triple, steering: Sequence[float], dt: float = math.inf
    ) -> DriveCommand:
        """Return the joint commands for a limited twist.

        Args:
            twist: the desired motion per second; the result omits what the drive cannot do.
            steering: measured positions of the steering joints, rad.
            dt: time until the next command, s; needed for steering.
        """

    def limited(self, command: DriveCommand, before: DriveCommand, dt: float) -> DriveCommand:
        """Return a command within the limits of the wheels, ``dt`` seconds after ``before``."""
        return command

    def fault(self, twist: Triple) -> str:
        """Return why the drive cannot follow a twist, without particulars; "" if it can."""
        return ""

    @abstractmethod
    def body_motion(self, turned: Sequence[float], steering: Sequence[float]) -> Triple:
        """Return the motion of the body.

        Args:
            turned: angles by which the wheels have turned, rad; for velocities in rad/s, the result
                is per second.
            steering: positions of the steering joints, rad.
        """

    @abstractmethod
    def paths(self, motion: Triple) -> Sequence[float]:
        """Return the path of each wheel on the ground for a motion of the body, m."""

    def errors(
        self, motion: Triple, cos: float, sin: float, noise: Sequence[float]
    ) -> list[PathError]:
        """Return how errors of the wheels' paths move the body.

        Each error moves the end of the body's path, and rotates it by half of the heading error.

        Args:
            motion: the motion of the body.
            cos: cosine of the heading in the middle of the motion.
            sin: sine of the same heading.
            noise: variance of each wheel's path, m^2 per meter.
        """
        distance, aside, _ = motion
        paths, errors = self.paths(motion), []
        for wheel, (forward, left, lever) in enumerate(self.shares):
            twice = 2.0 * lever
            along, across = distance / twice, aside / twice
            x = forward * cos - left * sin - along * sin - across * cos
            y = forward * sin + left * cos + along * cos - across * sin
            errors.append((x, y, 1.0 / lever, noise[wheel] * abs(paths[wheel])))
        return errors


MIN_LENGTH = 1e-6  # m; with shorter lengths, results may not be finite


def check_lengths(kinematics: Kinematics, *names: str) -> None:
    """Check lengths of kinematics.

    Raises:
        ValueError: a length is not finite, or too short.
    """
    for name in names:
        value = getattr(kinematics, name)
        if not (math.isfinite(value) and value >= MIN_LENGTH):
            raise ValueError(f"{name} must be at least {MIN_LENGTH:g} m, not {value:g} m")
