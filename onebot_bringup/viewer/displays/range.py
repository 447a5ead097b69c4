"""Range sensors (sensor_msgs/Range): the cone of radiation up to what was measured, as in RViz."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.displays.display import LARGEST
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, fraction, setting

_CORNERS = 32  # of the base
_WIDEST = math.radians(170)


@dataclass(frozen=True)
class RangeLook(Look):
    """Cones of range sensors."""

    color: Color = setting((255, 255, 255), "sRGB bytes", color)
    alpha: float = setting(0.5, "1.0 hides what is behind", fraction)


class RangeDrawing(Drawing[RangeLook]):
    """The cone of one sensor."""

    waiting = 10

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the colour, and the triangles: around the tip, and of the base."""
        this = np.arange(_CORNERS) + 1
        following = np.roll(this, -1)
        side = np.column_stack([np.zeros_like(this), following, this])
        base = np.column_stack([np.full_like(this, _CORNERS + 1), this, following])
        shade = (*self.look.color, round(255 * self.look.alpha))
        return [
            rr.Mesh3D.from_fields(
                triangle_indices=np.concatenate([side, base]),
                albedo_factor=shade,
                face_rendering="Front",  # else the far side shines through
            )
        ]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the cone along x; none where nothing was detected.

        Raises:
            ValueError: its field of view is none.
        """
        reach, angle = displayed_range(message), float(message.field_of_view)
        if not (0.0 < angle and reach <= LARGEST):
            raise ValueError(f"its field of view is {angle:g} rad, its range {reach:g} m")
        radius = reach * math.tan(min(angle, _WIDEST) / 2)
        turns = np.linspace(0.0, 2 * math.pi, _CORNERS, endpoint=False)
        base = np.column_stack(
            [np.full_like(turns, reach), radius * np.cos(turns), radius * np.sin(turns)]
        )
        corners = np.concatenate([np.zeros((1, 3)), base, [(reach, 0.0, 0.0)]])
        return [rr.Mesh3D.from_fields(vertex_positions=corners if reach else [])]


def displayed_range(message: Any) -> float:
    """Return how far the cone goes, metres; 0 for none.

    A sensor that detects at one distance (``min_range`` is ``max_range``) reports -inf for
    something in its range, and +inf for nothing.
    """
    measured, least, most = message.range, message.min_range, message.max_range
    if least <= measured <= most:
        return float(measured)
    return float(least) if least == most and measured == -math.inf else 0.0


class RangeDisplay(MessageDisplay[RangeLook]):
    """Draws what range sensors measure."""

    key = "range"
    Look = RangeLook
    draws = RangeDrawing
    message_types = ("sensor_msgs/msg/Range",)
