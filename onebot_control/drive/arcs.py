"""Integrates motion in the plane exactly."""

import math

from onebot_description.geometry.poses import PlanarPose, Triple


def along_arc(pose: PlanarPose, motion: Triple) -> PlanarPose:
    """Return the pose after a motion with a constant twist, which follows an arc.

    The chord has the direction of travel in the middle of the arc, and is sin(h) / h as long as
    the arc, with half the turn h.

    Args:
        pose: the pose before.
        motion: travel forward and to the left, m, and left turn, rad, in the body's frame.
    """
    x, y, turn = motion
    half = turn / 2.0
    shrunk = math.sin(half) / half if half else 1.0
    cos, sin = shrunk * math.cos(pose.yaw + half), shrunk * math.sin(pose.yaw + half)
    return PlanarPose(pose.x + x * cos - y * sin, pose.y + x * sin + y * cos, pose.yaw + turn)
