"""What the kinematics of every drive is: between the motion of the body and that of its wheels."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from onebot_description.geometry.poses import Triple


class DriveCommand(NamedTuple):
    """The command in force, within limits, and what the joints do for it."""

    linear: float  # forward, m/s
    lateral: float  # leftward, m/s
    angular: float  # turning to the left, rad/s
    wheels: Sequence[float]  # velocity of each wheel, rad/s
    steering: Sequence[float] = ()  # position of each steering joint, rad


class Share(NamedTuple):
    """What one metre on the path of one wheel adds to the motion of the body."""

    forward: float  # m
    left: float  # m
    lever: float  # m on the path for a turn of 1 rad to the left; infinite if it turns nothing


PathError = tuple[float, float, float, float]
"""By how much x (m), y (m) and yaw (rad) change with 1 m on a wheel's path; its variance, m^2."""


class Kinematics(ABC):
    """Converts between the motion of the body and that of its wheels.

    Wheels and steering joints have the order of ``Wheels.groups`` and ``Wheels.steering``; wheels
    that turn as one count as one. All positive velocities drive forward. A motion of the body is
    along an arc of constant velocity: forward and to the left, m, and turning to the left, rad;
    per second, it is the components of a PlanarVelocity.

    Attributes:
        shares: what each wheel contributes to the motion of the body.
    """

    shares: Sequence[Share]

    @abstractmethod
    def command(
        self, twist: Triple, steering: Sequence[float], dt: float = math.inf
    ) -> DriveCommand:
        """Return what the joints do for a limited twist.

        Args:
            twist: the wanted motion per second; the result leaves out what the drive cannot do.
            steering: measured positions of the steering joints, rad.
            dt: time until the next command, s, which steering needs.
        """

    def limited(self, command: DriveCommand, before: DriveCommand, dt: float) -> DriveCommand:
        """Return a command within the limits of the wheels, ``dt`` seconds after another one."""
        return command

    def fault(self, twist: Triple) -> str:
        """Return what of a wanted twist the drive cannot do, in the same words for all such."""
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

        Each moves the end of the body's path, and turns that path by half of the heading's error.

        Args:
            motion: the motion of the body.
            cos: cosine of the heading in the middle of the motion.
            sin: likewise its sine.
            noise: variance of each wheel's path, m^2 per metre.
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


LEAST = 1e-6  # m; with shorter lengths, results might not be finite


def check_lengths(kinematics: Kinematics, *names: str) -> None:
    """Check lengths of kinematics.

    Raises:
        ValueError: a length is not finite, or too short.
    """
    for name in names:
        value = getattr(kinematics, name)
        if not (math.isfinite(value) and value >= LEAST):
            raise ValueError(f"{name} must be at least {LEAST:g} m, not {value:g} m")
