"""What the kinematics of every drive is: between the motion of the body and that of its wheels."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from onebot_description.geometry.poses import Triple


class PlanarTwist(NamedTuple):
    """A velocity of the body in its own frame, x forward and y to the left (REP-103).

    It is also a motion along an arc of constant velocity, in m and rad.
    """

    linear: float = 0.0  # forward, m/s
    lateral: float = 0.0  # to the left, m/s
    angular: float = 0.0  # turning to the left, rad/s


class DriveCommand(NamedTuple):
    """The command in force, within limits, and what the joints do for it."""

    linear: float  # forward, m/s
    lateral: float  # to the left, m/s
    angular: float  # turning to the left, rad/s
    wheels: Sequence[float]  # velocity of each wheel, rad/s
    steering: Sequence[float] = ()  # position of each steering joint, rad


class Share(NamedTuple):
    """What one metre on the path of one wheel adds to the motion of the body."""

    forward: float  # m
    left: float  # m
    lever: float  # m for a turn of 1 rad to the left; infinite if it turns nothing


class Kinematics(ABC):
    """Converts between the motion of the body and that of its wheels.

    Wheels and steering joints have the order of ``Wheels.groups`` and ``Wheels.steering``; wheels
    that turn as one count as one. All positive velocities drive forward.

    Attributes:
        shares: what each wheel contributes to the motion of the body.
    """

    shares: Sequence[Share]

    @abstractmethod
    def command(self, twist: PlanarTwist, steering: Sequence[float]) -> DriveCommand:
        """Return what the joints do for a limited twist.

        Args:
            twist: the wanted velocity; what the drive cannot do is left out of the result.
            steering: measured positions of the steering joints, rad.
        """

    @abstractmethod
    def body_motion(self, turned: Sequence[float], steering: Sequence[float]) -> PlanarTwist:
        """Return the motion of the body.

        Args:
            turned: angles by which the wheels have turned, rad; for velocities in rad/s, the result
                is the body's velocity.
            steering: positions of the steering joints, rad.
        """

    @abstractmethod
    def paths(self, motion: PlanarTwist) -> Sequence[float]:
        """Return the path of each wheel on the ground for a motion of the body, m."""

    def errors(self, motion: PlanarTwist, cos: float, sin: float) -> list[Triple]:
        """Return how an error of 1 m on each wheel's path moves x (m), y (m) and yaw (rad).

        It moves the end of the path, and turns the path by half of the error of the heading.

        Args:
            motion: the motion of the body.
            cos: cosine of the heading in the middle of the motion.
            sin: likewise its sine.
        """
        distance, aside, _ = motion
        columns = []
        for forward, left, lever in self.shares:
            along, across = distance / (2.0 * lever), aside / (2.0 * lever)
            x = forward * cos - left * sin - along * sin - across * cos
            y = forward * sin + left * cos + along * cos - across * sin
            columns.append((x, y, 1.0 / lever))
        return columns


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
