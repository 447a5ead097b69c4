"""Single points (geometry_msgs/PointStamped), such as those clicked in the page."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.display import LARGEST
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, setting
from onebot_description.parameters.reader import parameter

_MOST_KEPT = 10_000


@dataclass(frozen=True)
class PointStampedLook(Look):
    """Points as spheres."""

    color: Color | None = setting(None, "sRGB bytes; by default one of ours a topic", color)
    radius: float = setting(0.2, "metres")
    history_length: int = parameter(1, "points that are shown", at_least=1, at_most=_MOST_KEPT)


class PointStampedDrawing(Drawing[PointStampedLook]):
    """The last points of one topic."""

    repeated = True

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._kept: deque[Any] = deque(maxlen=self.look.history_length)
        self._kept_in = ""  # the frame

    def style(self) -> Sequence[rr.AsComponents]:
        """Return colour and size."""
        color = self.look.color or self.color
        return [rr.Points3D.from_fields(colors=[color], radii=[self.look.radius])]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the last points of the frame."""
        place = message.point.array()
        if not (np.abs(place) <= LARGEST).all():
            raise ValueError("its point is not finite")
        if self._kept_in != self.frame:
            self._kept_in = self.frame
            self._kept.clear()
        if self._last is None or message is not self._last[1]:  # not logged again
            self._kept.append(place)
        return [rr.Points3D.from_fields(positions=np.array(self._kept))]

    def replace(self, before: Drawing[PointStampedLook]) -> None:
        """Draw also what was kept."""
        super().replace(before)
        if isinstance(before, PointStampedDrawing):
            self._kept.extend(before._kept)
            self._kept_in, self._last = before._kept_in, before._last


class PointStampedDisplay(MessageDisplay[PointStampedLook]):
    """Draws points."""

    key = "point_stamped"
    Look = PointStampedLook
    draws = PointStampedDrawing
    message_types = ("geometry_msgs/msg/PointStamped",)
