"""Where a robot has been (nav_msgs/Odometry): an arrow or axes now and then, as RViz draws them.

A topic that the view draws as a trail or covariance is not shown in this way, too.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.message_display import Drawing, MessageDisplay
from onebot_bringup.viewer.displays.pose import Floats, PoseLook, PosesDrawing, one_pose
from onebot_bringup.viewer.settings import setting

_MOST_KEPT = 1000  # also where all are to be kept: each arrow is logged with those before it


@dataclass(frozen=True)
class OdometryLook(PoseLook):
    """Poses of odometry, as arrows along x or as axes."""

    keep: int = setting(100, "poses that are shown; 0 for as many as possible (1000)")
    position_tolerance: float = setting(0.1, "metres from one pose to the next")
    angle_tolerance: float = setting(0.1, "or radians")


class OdometryDrawing(PosesDrawing[OdometryLook]):
    """The last poses of one topic."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._kept: deque[Floats] = deque(maxlen=min(self.look.keep or _MOST_KEPT, _MOST_KEPT))
        self._kept_in = ""  # the frame

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the last poses, if this one is far enough from the one before."""
        [pose] = one_pose(message.pose.pose)
        if self._kept_in != self.frame:
            self._kept_in = self.frame
            self._kept.clear()
        if self._kept and self._is_near(self._kept[-1], pose):
            return () if self.is_fitted else self.shapes(np.array(self._kept))
        self._kept.append(pose)
        return self.shapes(np.array(self._kept))

    def _is_near(self, before: Floats, pose: Floats) -> bool:
        lengths = np.linalg.norm(before[3:]) * np.linalg.norm(pose[3:])
        cosine = abs(before[3:] @ pose[3:]) / lengths if lengths else 1.0
        turned = 2 * np.arccos(min(1.0, cosine))
        moved = np.linalg.norm(pose[:3] - before[:3])
        look = self.look
        return bool(moved < look.position_tolerance and turned < look.angle_tolerance)

    def replace(self, before: Drawing[OdometryLook]) -> None:
        """Draw also what was kept."""
        super().replace(before)
        if isinstance(before, OdometryDrawing):
            self._kept.extend(before._kept)
            self._kept_in = before._kept_in


class OdometryDisplay(MessageDisplay[OdometryLook]):
    """Draws the last poses of a robot."""

    key = "odometry"
    Look = OdometryLook
    draws = OdometryDrawing
    message_types = ("nav_msgs/msg/Odometry",)
