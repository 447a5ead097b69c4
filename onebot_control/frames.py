"""Frame names and planar poses."""

import math
from typing import NamedTuple


def prefixed(frame: str, enabled: bool, prefix: str, namespace: str) -> str:
    """Return ``frame`` as diff_drive_controller names it.

    Args:
        frame: such as "odom".
        enabled: parameter tf_frame_prefix_enable.
        prefix: parameter tf_frame_prefix; the namespace when empty.
        namespace: of the node, such as "/" or "/robot1".
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

    def then(self, other: "PlanarPose") -> "PlanarPose":
        """Return ``other``, which is given in the frame that this pose is of, in this one's own."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            self.yaw + other.yaw,
        )

    def inverse(self) -> "PlanarPose":
        """Return the pose p for which ``self.then(p)`` is zero."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return PlanarPose(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the heading of a quaternion, rad: the direction of its x axis seen from above."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
