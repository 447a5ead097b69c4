"""Poses: on the ground (``PlanarPose``) and in space, as plain floats; and names of frames."""

import math
from typing import NamedTuple

WORLD_FRAME = "world"  # unless a parameter names another one

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Transform = tuple[Triple, Quaternion]


def rotate(rotation: Quaternion, vector: Triple) -> Triple:
    """Rotate ``vector`` by a unit quaternion x y z w: v + 2 w (u x v) + 2 u x (u x v)."""
    a, b, c, w = rotation
    x, y, z = vector
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (
        x + w * tx + (b * tz - c * ty),
        y + w * ty + (c * tx - a * tz),
        z + w * tz + (a * ty - b * tx),
    )


def multiply(first: Quaternion, second: Quaternion) -> Quaternion:
    """Hamilton product: the rotation ``second``, then ``first``."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(rotation: Quaternion) -> Quaternion:
    """The opposite rotation."""
    x, y, z, w = rotation
    return (-x, -y, -z, w)


def compose(outer: Transform, inner: Transform) -> Transform:
    """The transform ``inner``, then ``outer``."""
    x, y, z = rotate(outer[1], inner[0])
    a, b, c = outer[0]
    return (a + x, b + y, c + z), multiply(outer[1], inner[1])


def inverse(transform: Transform) -> Transform:
    """The transform that undoes ``transform``."""
    back = conjugate(transform[1])
    x, y, z = rotate(back, transform[0])
    return (-x, -y, -z), back


def cross(first: Triple, second: Triple) -> Triple:
    """Vector product."""
    a, b, c = first
    x, y, z = second
    return b * z - c * y, c * x - a * z, a * y - b * x


def scaled(vector: Triple, factor: float) -> Triple:
    """Return ``factor`` times a vector."""
    x, y, z = vector
    return factor * x, factor * y, factor * z


def about_z(yaw: float) -> Quaternion:
    """Rotation by ``yaw``, rad, about the vertical."""
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def prefixed(frame: str, enabled: bool, prefix: str, namespace: str) -> str:
    """Return ``frame`` as diff_drive_controller names it.

    By the parameters tf_frame_prefix_enable and tf_frame_prefix, which is the namespace if empty.
    """
    if not enabled:
        return frame
    words = (prefix or namespace).removesuffix("/").removeprefix("/")
    return f"{words}/{frame}" if words else frame


class PlanarPose(NamedTuple):
    """A pose on the ground, m and rad."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def transform(self) -> Transform:
        """The same pose in space."""
        return (self.x, self.y, 0.0), about_z(self.yaw)

    def compose(self, other: "PlanarPose") -> "PlanarPose":
        """Return ``other``, given relative to this pose, in the frame this pose is given in."""
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


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the heading of a quaternion, rad: the direction of its x axis seen from above."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
