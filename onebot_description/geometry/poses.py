"""Poses in space and in the plane, and vectors, one at a time, as plain floats without numpy.

For one pose, floats are several times as fast as arrays. ``multiply``, ``rotate``,
``of_half_angles`` and ``rows_of`` take components that may also be arrays, for ``quaternions``.
"""

import math
import operator
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from onebot_description.arrays import Floats

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Transform(NamedTuple):
    """The pose of a frame in its parent frame."""

    translation: Triple  # m
    rotation: Quaternion  # unit, x y z w

    def at(self, point: Triple) -> Triple:
        """Return a point of this frame, m, in the parent frame."""
        return compose(self, Transform(point, (0.0, 0.0, 0.0, 1.0))).translation


T = TypeVar("T", float, "Floats")

ZERO: Triple = (0.0, 0.0, 0.0)
_LOCKED = 1e-9  # cosine of the pitch below which roll and yaw turn about the same axis


class Origin(NamedTuple):
    """A pose in the frame of a parent, as URDF writes it."""

    xyz: Triple = ZERO  # m
    rpy: Triple = ZERO  # roll, pitch, yaw about the parent's fixed axes, rad

    @classmethod
    def from_transform(cls, transform: Transform) -> "Origin":
        """Return a transform as an origin."""
        return cls(transform[0], to_rpy(transform[1]))

    @property
    def transform(self) -> Transform:
        """The same pose as a transform."""
        return Transform(self.xyz, from_rpy(self.rpy))


def total(numbers: Iterable[float]) -> float:
    """Add up numbers one by one; ``sum`` rounds differently from Python 3.12 on."""
    return reduce(operator.add, numbers, 0.0)


def clamp(value: float, lower: float, upper: float) -> float:
    """Return the number within the bounds that is nearest to ``value``."""
    # Comparisons: min() and max() would take twice as long.
    return lower if value < lower else upper if value > upper else value


# Rotations --------------------------------------------------------------------------------------


def rotate(rotation: tuple[T, T, T, T], vector: tuple[T, T, T]) -> tuple[T, T, T]:
    """Rotate ``vector`` by a unit quaternion x y z w: v + 2 w (u x v) + 2 u x (u x v)."""
    a, b, c, w = rotation
    x, y, z = vector
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        x + w * tx + (b * tz - c * ty),
        y + w * ty + (c * tx - a * tz),
        z + w * tz + (a * ty - b * tx),
    )


def multiply(first: tuple[T, T, T, T], second: tuple[T, T, T, T]) -> tuple[T, T, T, T]:
    """Return the Hamilton product of two quaternions: the rotation ``second``, then ``first``."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(rotation: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion: the opposite rotation."""
    x, y, z, w = rotation
    return (-x, -y, -z, w)


def about(axis: Triple, angle: float) -> Quaternion:
    """Return the rotation by ``angle``, rad, about an axis of unit length."""
    return *scaled(axis, math.sin(angle / 2.0)), math.cos(angle / 2.0)


def about_z(yaw: float) -> Quaternion:
    """Return the rotation by ``yaw``, rad, about the z axis."""
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the heading of a unit quaternion, rad: the direction of its x axis from above."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def from_rpy(rpy: Triple) -> Quaternion:
    """Return the quaternion x y z w of fixed-axis roll, pitch, yaw, rad."""
    roll, pitch, yaw = (angle / 2.0 for angle in rpy)
    return of_half_angles(
        (math.sin(roll), math.sin(pitch), math.sin(yaw)),
        (math.cos(roll), math.cos(pitch), math.cos(yaw)),
    )


def of_half_angles(sines: tuple[T, T, T], cosines: tuple[T, T, T]) -> tuple[T, T, T, T]:
    """Return the quaternion x y z w of roll, pitch, yaw from sines and cosines of their halves."""
    (sr, sp, sy), (cr, cp, cy) = sines, cosines
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def rows_of(rotation: tuple[T, T, T, T]) -> tuple[tuple[T, T, T], ...]:
    """Return the three rows of the rotation matrix of a unit quaternion x y z w."""
    x, y, z, w = rotation
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
    return (
        (1.0 - yy - zz, xy - wz, xz + wy),
        (xy + wz, 1.0 - xx - zz, yz - wx),
        (xz - wy, yz + wx, 1.0 - xx - yy),
    )


def to_rpy(rotation: Quaternion) -> Triple:
    """Return fixed-axis roll, pitch, yaw, rad, of a unit quaternion; see ``rpy_of_rows``."""
    return rpy_of_rows(rows_of(rotation))


def rpy_of_rows(rows: Sequence[Sequence[float]]) -> Triple:
    """Return fixed-axis roll, pitch, yaw, rad, of the three rows of a rotation matrix.

    At a pitch of a quarter turn (gimbal lock), only the sum or difference of roll and yaw is
    defined: then yaw is zero, as in tf2.
    """
    (xx, _, _), (yx, yy, yz), (zx, zy, zz) = rows
    flat = math.hypot(xx, yx)
    pitch = math.atan2(-zx, flat)
    if flat > _LOCKED:
        return math.atan2(zy, zz), pitch, math.atan2(yx, xx)
    return math.atan2(-yz, yy), pitch, 0.0


# Transforms -------------------------------------------------------------------------------------


def compose(outer: Transform, inner: Transform) -> Transform:
    """Return the transform that applies ``inner``, then ``outer``."""
    x, y, z = rotate(outer[1], inner[0])
    a, b, c = outer[0]
    return Transform((a + x, b + y, c + z), multiply(outer[1], inner[1]))


def of_arrays(translation: "Floats", rotation: "Floats") -> Transform:
    """Return a translation (3,), m, and a rotation (4,), x y z w, as a transform."""
    (x, y, z), (a, b, c, w) = translation.tolist(), rotation.tolist()
    return Transform((x, y, z), (a, b, c, w))


def inverse(transform: Transform) -> Transform:
    """Return the transform that undoes ``transform``."""
    back = conjugate(transform[1])
    x, y, z = rotate(back, transform[0])
    return Transform((-x, -y, -z), back)


# Vectors ----------------------------------------------------------------------------------------


def cross(first: Triple, second: Triple) -> Triple:
    """Return the vector product first x second."""
    a, b, c = first
    x, y, z = second
    return b * z - c * y, c * x - a * z, a * y - b * x


def scaled(vector: Triple, factor: float) -> Triple:
    """Return ``factor`` times a vector."""
    x, y, z = vector
    return factor * x, factor * y, factor * z


# In the plane -----------------------------------------------------------------------------------


class PlanarPose(NamedTuple):
    """A pose in the plane: x and y in m, yaw in rad, counterclockwise seen from above (REP-103)."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def transform(self) -> Transform:
        """The same pose in space, at height 0."""
        return Transform((self.x, self.y, 0.0), about_z(self.yaw))

    def compose(self, other: "PlanarPose") -> "PlanarPose":
        """Return ``other``, which is relative to this pose, in this pose's parent frame."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            self.yaw + other.yaw,
        )

    def inverse(self) -> "PlanarPose":
        """Return the pose p for which ``self.compose(p)`` is zero."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)


class PlanarVelocity(NamedTuple):
    """A velocity in the plane, in the axes of the robot: x forward, y to the left (REP-103).

    Attributes:
        linear: forward, m/s.
        lateral: to the left, m/s.
        angular: of turning to the left, rad/s.
    """

    linear: float = 0.0
    lateral: float = 0.0
    angular: float = 0.0
