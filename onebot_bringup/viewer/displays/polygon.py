"""Polygons (geometry_msgs/PolygonStamped), such as a robot's footprint, as closed lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.display import drawable
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, setting

_ON_SCREEN = 2.0  # pixels


@dataclass(frozen=True)
class PolygonLook(Look):
    """Polygons as closed lines."""

    color: Color | None = setting(None, "sRGB bytes; by default one of ours a topic", color)
    width: float = setting(0.0, "of the line, metres; 0 for two pixels, however far away it is")


class PolygonDrawing(Drawing[PolygonLook]):
    """The polygon of one topic; one without points clears it."""

    repeated = True

    def style(self) -> Sequence[rr.AsComponents]:
        """Return colour and width; negative radii are pixels."""
        color = self.look.color or self.color
        radius = self.look.width / 2 or -_ON_SCREEN / 2
        return [rr.LineStrips3D.from_fields(colors=[color], radii=[radius])]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the line, from its last point to the first, too."""
        points = drawable(message.polygon.points.array())
        strips = [np.concatenate([points, points[:1]])] if len(points) else []
        return [rr.LineStrips3D.from_fields(strips=strips)]


class PolygonDisplay(MessageDisplay[PolygonLook]):
    """Draws polygons."""

    key = "polygon"
    Look = PolygonLook
    draws = PolygonDrawing
    message_types = ("geometry_msgs/msg/PolygonStamped",)
