"""Coloured points of scans and clouds, as RViz's point cloud transformers colour them."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import ColumnMaker, ReadyColumn, empty
from onebot_bringup.viewer.displays.display import LARGEST, LayoutPart
from onebot_bringup.viewer.displays.drawing import AUTO, Drawing, TopicSettings
from onebot_bringup.viewer.settings import Color, color, height, one_of, setting

Floats32 = NDArray[np.float32]
Colors = NDArray[np.uint32]  # 0xRRGGBBAA

RGB8, INTENSITY, AXIS, FLAT = "RGB8", "Intensity", "AxisColor", "FlatColor"
_AXES = ("X", "Y", "Z")
_OPAQUE = 0xFF
_LARGEST_VALUE = 999_999.0  # of a channel, in its bounds: RViz's
_ON_SCREEN = 3.0  # pixels


@dataclass(frozen=True)
class PointsSettings(TopicSettings):
    """Coloured points."""

    size: float = setting(0.0, "of a point, metres; 0 for three pixels, however far away it is")
    color_transformer: str = setting(
        AUTO, "auto takes the first for which there is data", one_of(AUTO, INTENSITY, AXIS, FLAT)
    )
    channel_name: str = setting("intensity", "the field that Intensity shows")
    use_rainbow: bool = setting(True, "of Intensity; else from min_color to max_color")
    invert_rainbow: bool = setting(False, "red where the value is highest")
    min_color: Color = setting((0, 0, 0), "sRGB bytes", color)
    max_color: Color = setting((255, 255, 255), "sRGB bytes", color)
    autocompute_intensity_bounds: bool = setting(True, "of each message")
    min_intensity: float = setting(0.0, "if they are not computed", height)
    max_intensity: float = setting(4096.0, "if they are not computed", height)
    axis: str = setting("Z", "of the fixed frame, which AxisColor shows", one_of(*_AXES))
    autocompute_value_bounds: bool = setting(True, "of AxisColor, of each message")
    min_value: float = setting(-10.0, "metres, if they are not computed", height)
    max_value: float = setting(10.0, "metres, if they are not computed", height)
    color: Color | None = setting(None, "of FlatColor, sRGB bytes; by default one of ours", color)
    decay_time: float = setting(0.0, "seconds that points stay; 0 until the next message")


class Points(NamedTuple):
    """What is in a message; points that are not finite are still among them."""

    positions: Floats32  # (N, 3), in the message's frame
    # Values (N,) of a channel; None if there is no such one.
    channel: Callable[[str], NDArray[Any] | None]
    colors: Colors | None = None  # (N,), their own


_POSITIONS = ColumnMaker(rr.Points3D.columns(positions=[(0.0, 0.0, 0.0)]))
_COLORS = ColumnMaker(rr.Points3D.columns(colors=np.zeros(1, np.uint32)))


class PointsDrawing(Drawing[PointsSettings]):
    """Draws the points of one topic."""

    order: ClassVar[Sequence[str]]  # of the transformers that auto takes
    placed = True
    few: ClassVar[bool] = False  # points: to transform them costs less than to log where they are

    @abstractmethod
    def points(self, message: Any) -> Points:
        """Return what is in a message.

        Raises:
            ValueError: it is not consistent.
        """

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the size; negative radii are pixels."""
        return [rr.Points3D.from_fields(radii=[self.settings.size / 2 or -_ON_SCREEN / 2])]

    def layout(self) -> LayoutPart:
        """Return how long points stay."""
        seconds = self.settings.decay_time
        return LayoutPart(windows=((self.entity, seconds),) if seconds else ())

    def drawn_in(self) -> str:
        """Points are where they were measured, wherever the sensor goes until the next message."""
        fixed = self.stage.fixed_frame
        return fixed if self._transformed or self.frame == fixed else self.entity

    @property
    def _transformed(self) -> bool:
        """Whether points are logged in the fixed frame; those that stay must be."""
        return self.few or self.settings.decay_time > 0.0

    def draw(self, message: Any) -> Sequence[ReadyColumn]:
        """Return the points that are finite."""
        positions, channel, own = self.points(message)
        usable = _usable(positions)
        if usable is not None:
            positions = positions[usable]
            own = None if own is None else own[usable]
        transform = self.settings.color_transformer
        for name in self.order if transform == AUTO else (transform,):
            colors = own if name == RGB8 else self._colors(name, positions, channel, usable)
            if colors is not None:
                break
        else:
            colors = self._flat()
        if self.home != self.frame and (pose := self.pose()) is not None:
            if self._transformed:
                matrix = pose.T.astype(np.float32)
                with np.errstate(over="ignore", invalid="ignore"):
                    positions = positions @ matrix[:3, :3]
                    positions += matrix[3, :3]
            else:
                self.place(self.stage.fixed_frame, self.entity, pose)
        return [_POSITIONS.row(positions), _COLORS.row(colors)]

    def _colors(
        self,
        transformer: str,
        positions: Floats32,
        channel: Callable[[str], NDArray[Any] | None],
        usable: NDArray[np.bool_] | None,
    ) -> Colors | None:
        """Return the colours (N,), or (1,) for all; None if there is no data for them."""
        look = self.settings
        if transformer == AXIS:
            bounds = None if look.autocompute_value_bounds else (look.min_value, look.max_value)
            return colored(self._along_axis(positions), bounds, _table(True, False))
        values = channel(look.channel_name) if transformer == INTENSITY else None
        if values is None or (look.color_transformer == AUTO and _is_constant(values)):
            return self._flat() if transformer == FLAT else None
        fixed = (look.min_intensity, look.max_intensity)
        return colored(
            values if usable is None else values[usable],
            None if look.autocompute_intensity_bounds else fixed,
            _table(look.use_rainbow, look.invert_rainbow, look.min_color, look.max_color),
        )

    def _flat(self) -> Colors:
        red, green, blue = self.color
        return np.array([red << 24 | green << 16 | blue << 8 | _OPAQUE], np.uint32)

    def _along_axis(self, positions: Floats32) -> NDArray[Any]:
        axis, pose = _AXES.index(self.settings.axis), self.pose()
        if pose is None:
            return positions[:, axis]
        row = pose[axis].astype(np.float32)
        found: Floats32 = positions @ row[:3] + row[3]
        return found


def _is_constant(values: NDArray[Any]) -> bool:
    """Whether there is nothing to see in values (N,): many sensors send zeros."""
    return not len(values) or bool(values[0] == values[-1] and (values == values[0]).all())


def _usable(positions: Floats32) -> NDArray[np.bool_] | None:
    """Return which points are finite, and not enormous; None for all."""
    if not len(positions) or -LARGEST <= positions.min() <= positions.max() <= LARGEST:
        return None
    within: NDArray[np.bool_] = np.abs(positions) <= LARGEST
    return within[:, 0] & within[:, 1] & within[:, 2]


# --- colours ------------------------------------------------------------------------------------


def colored(values: NDArray[Any], bounds: tuple[float, float] | None, table: Colors) -> Colors:
    """Return the colours of values.

    Args:
        values: (N,) numbers.
        bounds: that have the first and the last colour; None for the least and the greatest value.
        table: (256,) colours.
    """
    if not len(values):
        return np.empty(0, np.uint32)
    # In a type that has fractions, and a copy: 32 bits for what fits.
    scaled = values.astype(np.result_type(values.dtype, np.float32))
    low, high = bounds or _bounds(scaled)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled -= scaled.dtype.type(low)
        scaled *= scaled.dtype.type(255.0 / (high - low) if high > low else 0.0)
        rows = np.clip(scaled, 0.0, 255.0, out=scaled).astype(np.uint8)  # any one for NaN
    found: Colors = empty(rows.shape, np.uint32)
    return table.take(rows, out=found, mode="wrap")  # which is the fastest: they are within it


def _bounds(values: NDArray[Any]) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if not -LARGEST <= low <= high <= LARGEST:
        finite = values[np.isfinite(values)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
    return max(-_LARGEST_VALUE, float(low)), min(_LARGEST_VALUE, float(high))


@lru_cache(maxsize=32)
def _table(
    rainbow: bool, inverted: bool, lowest: Color = (0, 0, 0), highest: Color = (255, 255, 255)
) -> Colors:
    """Return 256 colours, from that of the lowest value to that of the highest."""
    at = np.linspace(0.0, 1.0, 256)
    if rainbow:
        rgb = _rainbow(at if inverted else 1.0 - at)
    else:
        rgb = np.linspace(np.array(lowest), np.array(highest), 256) / 255
    red, green, blue = np.rint(255 * rgb).astype(np.uint32).T
    table: Colors = red << 24 | green << 16 | blue << 8 | np.uint32(_OPAQUE)
    return table


def _rainbow(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return RViz's rainbow: from magenta at 0 over blue, green and yellow to red at 1."""
    corners = [(1, 0, 1), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 1, 0), (1, 0, 0)]
    places = np.linspace(0.0, 1.0, len(corners))
    return np.column_stack(
        [np.interp(at, places, channel) for channel in zip(*corners, strict=True)]
    )
