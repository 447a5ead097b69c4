"""How sure a pose is: an ellipse around the place, and a sector around the heading.

The shapes lie in frames of their own, which move with the messages. A move is a row in what /tf is
logged with anyway, and a shape is logged only when it changes, so that a covariance
costs less than a trail, however fast the robot drives.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.displays.display import (
    LARGEST,
    ODOMETRY,
    REPEAT_AFTER,
    Context,
    ItemsDisplay,
    LayoutPart,
    below,
)
from onebot_bringup.viewer.settings import Color, color, height, setting, topic
from onebot_description.parameters.reader import REQUIRED
from onebot_description.wire.messages import OdometrySample

COVARIANCE_ENTITY = "covariance"
# Of an outline, which has one point more: its first again.
CORNERS = 48
# An eigenvalue this much below zero, of the largest one, is rounding; more is no covariance.
_ROUNDING = 1e-9
# Half an axis beyond this (metres) means "unknown", as 1e6 in a covariance does.
LARGEST_AXIS = 100.0
FILL_ALPHA = 45
_CHANGE = 0.01  # of a shape's size: less would not be seen

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CovarianceSettings:
    """An ellipse and a sector that show the covariance of the poses of an Odometry topic."""

    topic: str = setting(REQUIRED, "an Odometry topic", topic)
    color: Color | None = setting(None, "sRGB bytes; by default one of ours", color)
    width: float = setting(0.006, "of the lines, metres")
    height: float = setting(0.0, "metres above the poses; negative to lay it on the ground", height)
    sigma: float = setting(3.0, "how many standard deviations they are wide")
    heading: float = setting(0.5, "radius of the sector, which shows the yaw, metres; 0 for none")


class CovarianceDisplay(ItemsDisplay[Mapping[str, CovarianceSettings], "CovarianceStream"]):
    """Draws how sure the robot is of its pose."""

    key = "covariance"
    Settings = CovarianceSettings
    named = True
    noun = "covariance"
    types = (ODOMETRY,)

    def wanted(
        self, settings: Mapping[str, CovarianceSettings]
    ) -> Mapping[str, tuple[str, CovarianceSettings]]:
        """Return the covariances."""
        return {name: (item.topic, item) for name, item in settings.items()}

    def make(self, name: str, settings: CovarianceSettings, color: Color) -> "CovarianceStream":
        """Return the shapes of one topic."""
        return CovarianceStream(self.context, name, settings, color)

    def layout(self) -> LayoutPart:
        """Return the shapes."""
        shown = tuple(map(covariance_entity, self.items))
        return LayoutPart(hidden=(COVARIANCE_ENTITY,), shown=shown)


# --- the shapes ---------------------------------------------------------------------------------


class Ellipse(NamedTuple):
    """Standard deviations: metres along the longer axis and across it, and its direction (rad)."""

    along: float
    across: float
    angle: float


def place_ellipse(covariance: Floats) -> Ellipse | None:
    """Return how far the place scatters on the ground.

    Args:
        covariance: (36,) of a pose, row by row: x, y, z in m and the angles about x, y, z in rad.

    Returns:
        None if it is unknown (all zero, negative, not finite) or no covariance at all. If one
        direction is sure, ``across`` is zero.
    """
    xx, xy, yx, yy = (float(covariance[i]) for i in (0, 1, 6, 7))
    if not all(map(math.isfinite, (xx, xy, yx, yy))) or xx < 0 or yy < 0:
        return None
    xy = (xy + yx) / 2
    mean, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    largest, smallest = mean + half, mean - half
    if largest <= 0 or smallest < -_ROUNDING * largest:
        return None
    angle = math.atan2(2 * xy, xx - yy) / 2
    return Ellipse(math.sqrt(largest), math.sqrt(max(0.0, smallest)), angle)


def heading_deviation(covariance: Floats) -> float | None:
    """Return the standard deviation of the yaw, rad; None if it is unknown, as above."""
    variance = float(covariance[35])
    return math.sqrt(variance) if math.isfinite(variance) and variance > 0 else None


def ellipse_outline(ellipse: Ellipse, sigma: float) -> Floats:
    """Return (49, 3) points around an ellipse of ``sigma`` deviations, closed, metres."""
    turns = np.linspace(0.0, 2 * math.pi, CORNERS + 1)
    x, y = sigma * ellipse.along * np.cos(turns), sigma * ellipse.across * np.sin(turns)
    cos, sin = math.cos(ellipse.angle), math.sin(ellipse.angle)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, np.zeros_like(turns)])


def sector_outline(deviation: float, sigma: float, radius: float) -> Floats:
    """Return (49, 3) points around a sector of ``sigma`` deviations to either side of x, metres."""
    half = min(math.pi, sigma * deviation)
    turns = np.linspace(-half, half, CORNERS - 1)
    arc = radius * np.column_stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)])
    middle = np.zeros((1, 3))
    return np.concatenate([middle, arc, middle])


def fan() -> NDArray[np.int64]:
    """Return the triangles of the surface that an outline encloses."""
    return np.array([(0, i, i + 1) for i in range(1, CORNERS)])


class CovarianceStream:
    """Logs the ellipse and the sector of one Odometry topic."""

    def __init__(
        self, context: Context, name: str, settings: CovarianceSettings, color: Color
    ) -> None:
        """Log into the recording of ``context``.

        Args:
            context: of the display.
            name: of the covariance, and its entities.
            settings: how it is drawn.
            color: where the settings have none.
        """
        self._context = context
        self._settings = settings
        entity, color = covariance_entity(name), settings.color or color
        self._place = _Outline(context, f"{entity}/place", color, settings.width)
        self._heading = _Outline(context, f"{entity}/heading", color, settings.width)
        self._last: tuple[int, OdometrySample] | None = None
        self.frame = ""  # that its messages name

    def add(self, stamp_ns: int, sample: OdometrySample) -> None:
        """Add a message; its shapes move there at once, and change their form in ``flush``."""
        if not sample.frame_id or not (np.abs(sample.translation) <= LARGEST).all():
            return
        self.frame = sample.frame_id
        self._last = (stamp_ns, sample)
        if self._place.drawn or self._heading.drawn:
            self._move(stamp_ns, sample)

    def _move(self, stamp_ns: int, sample: OdometrySample) -> None:
        place = np.array(sample.translation)
        place[2] += self._settings.height
        for outline, rotation in (
            (self._place, np.array([0.0, 0.0, 0.0, 1.0])),
            (self._heading, yaw_only(sample.rotation)),
        ):
            if outline.drawn:
                self._context.transforms.place(stamp_ns, self.frame, outline.frame, place, rotation)

    def flush(self) -> None:
        """Log the shapes if they have changed."""
        if self._last is None:
            return
        stamp_ns, sample = self._last
        sigma, radius = self._settings.sigma, self._settings.heading
        ellipse = place_ellipse(sample.covariance)
        deviation = heading_deviation(sample.covariance)
        before = self._place.drawn, self._heading.drawn
        self._place.draw(
            stamp_ns,
            ellipse_outline(ellipse, sigma)
            if ellipse is not None and 0 < sigma * ellipse.along <= LARGEST_AXIS
            else None,
        )
        self._heading.draw(
            stamp_ns,
            sector_outline(deviation, sigma, radius)
            if deviation is not None and sigma * radius > 0
            else None,
        )
        if (self._place.drawn, self._heading.drawn) != before:
            self._move(stamp_ns, sample)


class _Outline:
    """A line around a flat, transparent shape, in a frame of its own."""

    def __init__(self, context: Context, entity: str, color: Color, width: float) -> None:
        self._recording = context.recording
        self._clock = context.clock
        self._entity = entity
        self._color = color
        self._width = width
        self._logged: Floats | None = None
        self._logged_at = 0.0
        self._styled = False
        self.frame = below(context.root, entity)
        self.drawn = False

    def draw(self, stamp_ns: int, outline: Floats | None) -> None:
        """Log ``outline``, (49, 3) metres, from this time on; None for nothing."""
        if outline is None and not self.drawn:
            return
        shape = np.zeros((CORNERS + 1, 3)) if outline is None else outline
        now = self._clock()
        if self._is_as(shape) and now - self._logged_at < REPEAT_AFTER:
            return
        self._style()
        self._logged, self._logged_at, self.drawn = shape, now, outline is not None
        columns = [
            *rr.LineStrips3D.columns(strips=[shape] if self.drawn else [np.zeros((0, 3))]),
            *rr.Mesh3D.columns(vertex_positions=shape).partition([len(shape)]),
        ]
        stamp = np.array([stamp_ns], "datetime64[ns]")
        index = rr.TimeColumn(TIMELINE, timestamp=stamp)
        self._recording.send_columns(self._entity, indexes=[index], columns=columns)

    def _is_as(self, shape: Floats) -> bool:
        """Whether what is shown looks like ``shape``."""
        if self._logged is None:
            return False
        return bool(np.abs(shape - self._logged).max() <= _CHANGE * np.abs(self._logged).max())

    def _style(self) -> None:
        """Log once in which frame the shapes lie and how they look."""
        if self._styled:
            return
        self._styled = True
        self._recording.log(
            self._entity,
            rr.CoordinateFrame(self.frame),
            rr.LineStrips3D.from_fields(colors=[self._color], radii=[self._width / 2]),
            rr.Mesh3D.from_fields(triangle_indices=fan(), albedo_factor=(*self._color, FILL_ALPHA)),
            static=True,
        )


def yaw_only(rotation: Floats) -> Floats:
    """Return the turn about z alone of a quaternion x y z w, of length 1."""
    length = math.hypot(rotation[2], rotation[3])
    if not 0 < length < math.inf:
        return np.array([0.0, 0.0, 0.0, 1.0])
    return np.array([0.0, 0.0, rotation[2] / length, rotation[3] / length])


def covariance_entity(name: str) -> str:
    """Return the entity of the covariance ``name``."""
    return rr.new_entity_path([COVARIANCE_ENTITY, name]).lstrip("/")
