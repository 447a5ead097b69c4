"""The common parts of drives with rollers on their wheels, which move in all directions."""

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from onebot_control.drive.kinematics import (
    DriveCommand,
    Kinematics,
    Share,
    check_lengths,
)
from onebot_control.drive.parameters import AlikeWheelsParameters
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_description.geometry.poses import PlanarPose, Triple, cross, scaled, total
from onebot_description.parameters.reader import group

_SINGULAR = 1e-9  # share of the determinant of independent directions

_CENTER = PlanarPose(0.0, 0.0, 0.0)


class HolonomicKinematics(Kinematics):
    """Converts between wheel and body motion of wheels with rollers.

    The body's frame has x forward and y to the left (REP-103).
    """

    def __init__(self, radius: float, rows: Sequence[Triple], kind: str) -> None:
        """Set the geometry.

        Args:
            radius: radius of the wheels, m.
            rows: (N, 3), the path of each wheel, m, per meter forward, per meter to the left, and
                per rad of turning to the left.
            kind: kind of the wheels.

        Raises:
            ValueError: the wheels do not move the robot in all directions.
        """
        self.radius, self.rows, self.kind = radius, tuple(rows), kind
        check_lengths(self, "radius")
        if len(self.rows) < 3:
            raise ValueError(f"it needs three wheels or more, not {len(self.rows)}")
        columns = list(zip(*self.rows, strict=True))
        # The symmetric matrix A'A (3, 3) of the rows A, in plain floats, because the last bits of
        # numpy's results depend on the processor.
        x, y, turn = (
            (_dot(a, columns[0]), _dot(a, columns[1]), _dot(a, columns[2])) for a in columns
        )
        determinant = _dot(x, cross(y, turn))
        bound = math.prod(math.hypot(*row) for row in (x, y, turn))
        if determinant <= _SINGULAR * bound:
            raise ValueError(
                "the wheels cannot move the robot forward, sideways and around independently; "
                "their rollers must point in different directions"
            )
        # The pseudo-inverse (A'A)^-1 A' (3, N): the motion of the body per path of each wheel.
        adjugate = cross(y, turn), cross(turn, x), cross(x, y)
        self._inverse = [[_dot(part, row) / determinant for row in self.rows] for part in adjugate]
        self.shares = [
            Share(forward, left, 1.0 / turned if turned else math.inf)
            for forward, left, turned in zip(*self._inverse, strict=True)
        ]

    @classmethod
    def mecanum(
        cls,
        radius: float,
        reach: float,
        counts: Sequence[int] = (1, 1, 1, 1),
        offset: PlanarPose = _CENTER,
    ) -> "HolonomicKinematics":
        """Return the kinematics of mecanum wheels at the corners of a rectangle.

        Their order is front left, front right, rear right, rear left.

        Args:
            radius: radius of the wheels, m.
            reach: half the distance between the axles plus half that between the sides, m.
            counts: number of wheels at each corner.
            offset: the base's frame relative to the center of the wheels, m and rad, as in
                mecanum_drive_controller's kinematics.base_frame_offset.

        Raises:
            ValueError: a length is not finite, or too short.
        """
        corners = ((1.0, -1.0, -reach), (1.0, 1.0, reach), (1.0, -1.0, reach), (1.0, 1.0, -reach))
        cos, sin = math.cos(offset.yaw), math.sin(offset.yaw)
        rows = [
            (x * cos + y * sin, y * cos - x * sin, turn + x * offset.y - y * offset.x)
            for (x, y, turn), count in zip(corners, counts, strict=True)
            for _ in range(count)
        ]
        return cls(radius, rows, "mecanum")

    @classmethod
    def omni(
        cls, radius: float, robot_radius: float, count: int, wheel_offset: float = 0.0
    ) -> "HolonomicKinematics":
        """Return the kinematics of omni wheels on a circle, whose axles point to its center.

        Args:
            radius: radius of the wheels, m.
            robot_radius: radius of the circle, m.
            count: number of wheels, which are ordered anticlockwise.
            wheel_offset: direction of the first wheel, rad to the left of forward.

        Raises:
            ValueError: a length is not finite, or too short, or there are fewer than 3 wheels.
        """
        angles = [wheel_offset + 2.0 * math.pi * wheel / count for wheel in range(count)]
        rows = [(math.sin(angle), -math.cos(angle), -robot_radius) for angle in angles]
        return cls(radius, rows, "omni")

    def __str__(self) -> str:
        return f"{len(self.rows)} {self.kind} wheels of radius {self.radius:g} m"

    def command(
        self, twist: Triple, steering: Sequence[float] = (), dt: float = math.inf
    ) -> DriveCommand:
        return DriveCommand(*twist, [path / self.radius for path in self.paths(twist)])

    def body_motion(self, turned: Sequence[float], steering: Sequence[float] = ()) -> Triple:
        """Return the motion of the body; if wheels slipped, the least-squares fit."""
        forward, left, turn = self._inverse
        motion = _dot(forward, turned), _dot(left, turned), _dot(turn, turned)
        return scaled(motion, self.radius)

    def paths(self, motion: Triple) -> list[float]:
        forward, left, turn = motion
        return [x * forward + y * left + lever * turn for x, y, lever in self.rows]


def _dot(first: Sequence[float], second: Sequence[float]) -> float:
    return total(map(operator.mul, first, second))


@dataclass(frozen=True)
class HolonomicParameters(AlikeWheelsParameters[HolonomicKinematics]):
    """The parameters of all drives with rollers on their wheels."""

    lateral: SpeedLimits = group(SpeedLimits, "linear.y")

    @property
    def limits(self) -> Mapping[str, SpeedLimits]:
        return {**super().limits, "linear.y": self.lateral}

    def kinematics(self, geometry: HolonomicKinematics) -> HolonomicKinematics:
        return geometry
