"""Kinematics of drives that move in all directions of the plane, by mecanum or omni wheels."""

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from onebot_description.geometry.poses import PlanarPose, Triple, cross, scaled, total

_LEAST = 1e-6  # m; with shorter lengths, results might not be finite
_SINGULAR = 1e-9  # share of the determinant of independent directions

_CENTER = PlanarPose(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class HolonomicKinematics:
    """Converts between wheel and body motion of wheels with rollers.

    The body's frame has x forward and y to the left (REP-103).
    """

    # For each wheel its velocity, rad/s, per m/s forward, per m/s to the left, and per rad/s of
    # turning to the left.
    rows: tuple[Triple, ...]

    def __post_init__(self) -> None:
        """Check that the wheels move the robot in all directions.

        Raises:
            ValueError: they do not, or a number is not finite.
        """
        if not all(math.isfinite(value) for row in self.rows for value in row):
            raise ValueError(f"the wheels' geometry must be finite, not {self.rows}")
        if len(self.rows) < 3 or self._determinant <= _SINGULAR * math.prod(
            math.hypot(*row) for row in self._normal
        ):
            raise ValueError(
                "the wheels do not move the robot forward, sideways and round independently: it "
                "needs three or more, whose rollers point in different directions"
            )

    @classmethod
    def mecanum(
        cls,
        radius: float,
        reach: float,
        counts: Sequence[int] = (1, 1, 1, 1),
        offset: PlanarPose = _CENTER,
    ) -> "HolonomicKinematics":
        """Return the kinematics of mecanum wheels at the corners of a rectangle.

        The wheels are those at the front left, the front right, the rear right and the rear left.

        Args:
            radius: of the wheels, m.
            reach: half the distance between the axles plus half that between the sides, m.
            counts: number of wheels at each corner.
            offset: the base's frame from the middle between the wheels, m and rad, as
                mecanum_drive_controller's kinematics.base_frame_offset.

        Raises:
            ValueError: a length is not finite, or too short.
        """
        _check_lengths(radius=radius, reach=reach)
        corners = ((1.0, -1.0, -reach), (1.0, 1.0, reach), (1.0, -1.0, reach), (1.0, 1.0, -reach))
        cos, sin = math.cos(offset.yaw), math.sin(offset.yaw)
        rows = [
            (x * cos + y * sin, y * cos - x * sin, turn + x * offset.y - y * offset.x)
            for (x, y, turn), count in zip(corners, counts, strict=True)
            for _ in range(count)
        ]
        return cls(tuple([scaled(row, 1.0 / radius) for row in rows]))

    @classmethod
    def omni(
        cls, radius: float, robot_radius: float, count: int, wheel_offset: float = 0.0
    ) -> "HolonomicKinematics":
        """Return the kinematics of omni wheels on a circle, whose axles point to its middle.

        Args:
            radius: of the wheels, m.
            robot_radius: of the circle, m.
            count: of the wheels, which are counted anticlockwise.
            wheel_offset: direction of the first wheel, rad to the left of forward.

        Raises:
            ValueError: a length is not finite, or too short, or there are fewer than 3 wheels.
        """
        _check_lengths(wheel_radius=radius, robot_radius=robot_radius)
        angles = [wheel_offset + 2.0 * math.pi * wheel / count for wheel in range(count)]
        rows = [(math.sin(angle), -math.cos(angle), -robot_radius) for angle in angles]
        return cls(tuple([scaled(row, 1.0 / radius) for row in rows]))

    def wheel_velocities(
        self, linear_x: float, linear_y: float, angular: float
    ) -> tuple[float, ...]:
        """Return the velocities of the wheels, rad/s, for a body twist.

        Args:
            linear_x: forward, m/s.
            linear_y: to the left, m/s.
            angular: velocity of turning to the left, rad/s.
        """
        return tuple([x * linear_x + y * linear_y + turn * angular for x, y, turn in self.rows])

    def body_motion(self, wheels: Sequence[float]) -> Triple:
        """Return travel forward and to the left (m), and left turn (rad), for wheel angles in rad.

        It is the one that fits best, by least squares, if wheels slipped. For wheel velocities in
        rad/s, the results are the body's velocities.
        """
        x, y, turn = (_dot(shares, wheels) for shares in self._shares)
        return x, y, turn

    @cached_property
    def _normal(self) -> tuple[Triple, Triple, Triple]:
        """The symmetric matrix A'A (3, 3), with the rows A."""
        columns = list(zip(*self.rows, strict=True))
        x, y, turn = (
            (_dot(a, columns[0]), _dot(a, columns[1]), _dot(a, columns[2])) for a in columns
        )
        return x, y, turn

    @cached_property
    def _determinant(self) -> float:
        x, y, turn = self._normal
        return _dot(x, cross(y, turn))

    @cached_property
    def _shares(self) -> tuple[tuple[float, ...], ...]:
        """The pseudo-inverse (A'A)^-1 A' (3, N): how much each wheel moves the body."""
        # In floats: numpy's results differ in the last bits between processors.
        x, y, turn = self._normal
        adjugate = cross(y, turn), cross(turn, x), cross(x, y)
        return tuple(
            tuple([_dot(part, row) / self._determinant for row in self.rows]) for part in adjugate
        )


def _dot(first: Sequence[float], second: Sequence[float]) -> float:
    return total(map(operator.mul, first, second))


def _check_lengths(**lengths: float) -> None:
    for name, value in lengths.items():
        if not (math.isfinite(value) and value >= _LEAST):
            raise ValueError(f"{name} must be at least {_LEAST:g} m, not {value:g} m")
