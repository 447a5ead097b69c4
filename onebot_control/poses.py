"""Poses in the plane (``PlanarPose``) and in space, as plain floats, and names of frames."""

import math
from typing import NamedTuple

WORLD_FRAME = "world"  # the default of the parameter world_frame_id

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Transform = tuple[Triple, Quaternion]  # translation, m, then rotation, x y z w


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


def compose(outer: Transform, inner: Transform) -> Transform:
    """Return the transform that applies ``inner``, then ``outer``."""
    x, y, z = rotate(outer[1], inner[0])
    a, b, c = outer[0]
    return (a + x, b + y, c + z), multiply(outer[1], inner[1])


def inverse(transform: Transform) -> Transform:
    """Return the transform that undoes ``transform``."""
    back = conjugate(transform[1])
    x, y, z = rotate(back, transform[0])
    return (-x, -y, -z), back


def cross(first: Triple, second: Triple) -> Triple:
    """Return the vector product first x second."""
    a, b, c = first
    x, y, z = second
    return b * z - c * y, c * x - a * z, a * y - b * x


def scaled(vector: Triple, factor: float) -> Triple:
    """Return ``factor`` times a vector."""
    x, y, z = vector
    return factor * x, factor * y, factor * z


def about_z(yaw: float) -> Quaternion:
    """Return the rotation by ``yaw``, rad, about the z axis."""
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def prefixed(frame: str, enabled: bool, prefix: str, namespace: str) -> str:
    """Return the name of a frame with diff_drive_controller's prefix.

    Args:
        frame: the name without prefix.
        enabled: the parameter tf_frame_prefix_enable.
        prefix: the parameter tf_frame_prefix; if empty, the namespace is the prefix.
        namespace: the node's.
    """
    if not enabled:
        return frame
    words = (prefix or namespace).removesuffix("/").removeprefix("/")
    return f"{words}/{frame}" if words else frame


class PlanarPose(NamedTuple):
    """A pose in the plane: x and y in m, yaw in rad, counterclockwise seen from above (REP-103)."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    @property
    def transform(self) -> Transform:
        """The same pose in space, at height 0."""
        return (self.x, self.y, 0.0), about_z(self.yaw)

    def compose(self, other: "PlanarPose") -> "PlanarPose":
        """Return ``other``, which is relative to this pose, in the frame that this pose is in."""
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
    """Return the heading of a unit quaternion, rad: the direction of its x axis from above."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
