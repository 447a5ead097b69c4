"""A planned path (nav_msgs/Path) as a line; an empty one clears it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import rerun as rr

from onebot_bringup.viewer.displays.display import SELDOM, drawable
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, height, setting


@dataclass(frozen=True)
class PathLook(Look):
    """Lines along planned paths."""

    color: Color | None = setting(None, "sRGB bytes; by default one of ours a topic", color)
    line_width: float = setting(0.02, "of the lines, metres")
    height: float = setting(0.0, "metres above the poses; negative to lay it on the ground", height)


class PathDrawing(Drawing[PathLook]):
    """The paths of one topic, each in place of the one before."""

    repeated = True

    def style(self) -> Sequence[rr.AsComponents]:
        """Return colour and width."""
        color, radius = self.look.color or self.color, self.look.line_width / 2
        return [rr.LineStrips3D.from_fields(colors=[color], radii=[radius])]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the line, without points that are not finite, or enormous."""
        points = drawable(message.poses.pose.position.array()) + (0.0, 0.0, self.look.height)
        return [rr.LineStrips3D.from_fields(strips=[points] if len(points) else [])]


class PathDisplay(MessageDisplay[PathLook]):
    """Draws planned paths."""

    key = "path"
    Look = PathLook
    draws = PathDrawing
    message_types = ("nav_msgs/msg/Path",)
    live = False
    period_ns = SELDOM
