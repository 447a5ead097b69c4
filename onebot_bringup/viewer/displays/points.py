"""Draws scans (LaserScan) and clouds (PointCloud2) as points, colored as in RViz."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import ColumnMaker, ReadyColumn, empty
from onebot_bringup.viewer.core.display import LayoutPart
from onebot_bringup.viewer.core.drawing import (
    AUTO,
    DEPTH_HIGH_BANDWIDTH,
    Drawing,
    TopicSettings,
)
from onebot_bringup.viewer.core.rerun_limits import LARGEST
from onebot_bringup.viewer.core.settings import Color, color, one_of, setting, signed
from onebot_description.errors import listing

Floats32 = NDArray[np.float32]
Colors = NDArray[np.uint32]  # 0xRRGGBBAA

RGB8, INTENSITY, AXIS, FLAT = "RGB8", "Intensity", "AxisColor", "FlatColor"
_AXES = ("X", "Y", "Z")
_OPAQUE = 0xFF
_LARGEST_VALUE = 999_999.0  # RViz's limit of values in the bounds of a channel
_ON_SCREEN = 3.0  # default size of a point, pixels


@dataclass(frozen=True)
class PointsSettings(TopicSettings):
    """Colored points."""

    size: float = setting(0.0, "meters; 0: a few pixels")
    color_transformer: str = setting(
        AUTO, "auto: the first that has data", one_of(AUTO, RGB8, INTENSITY, AXIS, FLAT)
    )
    channel_name: str = setting("intensity", "the field that Intensity shows")
    use_rainbow: bool = setting(True, "rainbow for Intensity; false: from min_color to max_color")
    invert_rainbow: bool = setting(False, "red where the value is highest")
    min_color: Color = setting((0, 0, 0), "sRGB bytes", color)
    max_color: Color = setting((255, 255, 255), "sRGB bytes", color)
    autocompute_intensity_bounds: bool = setting(True, "compute them for each message")
    min_intensity: float = setting(0.0, "if not computed", signed)
    max_intensity: float = setting(4096.0, "if not computed", signed)
    axis: str = setting("Z", "axis of the fixed frame, for AxisColor", one_of(*_AXES))
    autocompute_value_bounds: bool = setting(True, "compute them for each message")
    min_value: float = setting(-10.0, "meters, if not computed", signed)
    max_value: float = setting(10.0, "meters, if not computed", signed)
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    decay_time: float = setting(0.0, "seconds that points stay; 0: until the next message")


P = TypeVar("P", bound=PointsSettings)


class Points(NamedTuple):
    """The points of a message, including those that are not finite."""

    positions: Floats32  # (N, 3), in the message's frame
    # Returns the values (N,) of a channel; None if there is no such channel.
    channel: Callable[[str], NDArray[Any] | None]
    colors: Colors | None = None  # (N,), the points' own colors


_POSITIONS = ColumnMaker(rr.Points3D.columns(positions=[(0.0, 0.0, 0.0)]))
_COLORS = ColumnMaker(rr.Points3D.columns(colors=np.zeros(1, np.uint32)))


class PointsDrawing(Drawing[P]):
    """Draws the points of one topic."""

    order: ClassVar[Sequence[str]]  # transformers that "auto" tries in turn
    at_stamp_time = True

    @abstractmethod
    def points(self, message: Any) -> Points:
        """Return the points of a message.

        Raises:
            ValueError: the message is inconsistent.
        """

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the size of the points; negative radii are in pixels."""
        return [rr.Points3D.from_fields(radii=[self.settings.size / 2 or -_ON_SCREEN / 2])]

    def layout(self) -> LayoutPart:
        seconds = self.settings.decay_time
        return LayoutPart(windows=((self.entity, seconds),) if seconds else ())

    def frame_to_draw_in(self) -> str:
        """Return the fixed frame: points stay where they were measured when the sensor moves on."""
        return self.stage.fixed_frame

    def draw(self, message: Any) -> Sequence[ReadyColumn]:
        """Return the finite points with their colors."""
        positions, channel, rgb_colors = self.points(message)
        usable = _usable(positions)
        if usable is not None:
            positions = positions.T.compress(usable, axis=1).T
            rgb_colors = None if rgb_colors is None else rgb_colors[usable]
        if self.entity_frame != self.frame and (pose := self.pose()) is not None:
            positions = _moved(positions, pose.astype(np.float32))
        transform = self.settings.color_transformer
        for name in self.order if transform == AUTO else (transform,):
            colors = rgb_colors if name == RGB8 else self._colors(name, positions, channel, usable)
            if colors is not None:
                break
        else:
            colors = self._flat()
        return [_POSITIONS.row(positions), _COLORS.row(colors)]

    def _colors(
        self,
        transformer: str,
        positions: Floats32,
        channel: Callable[[str], NDArray[Any] | None],
        usable: NDArray[np.bool_] | None,
    ) -> Colors | None:
        """Return the colors (N,), or (1,) for all points; None if there is no data for them."""
        look = self.settings
        if transformer == AXIS:
            bounds = None if look.autocompute_value_bounds else (look.min_value, look.max_value)
            return colored(positions[:, _AXES.index(look.axis)], bounds, _table(True, False))
        values = channel(look.channel_name) if transformer == INTENSITY else None
        if values is None or (look.color_transformer == AUTO and _is_constant(values)):
            return None
        fixed = (look.min_intensity, look.max_intensity)
        return colored(
            values if usable is None else values[usable],
            None if look.autocompute_intensity_bounds else fixed,
            _table(look.use_rainbow, look.invert_rainbow, look.min_color, look.max_color),
        )

    def _flat(self) -> Colors:
        red, green, blue = self.color
        return np.array([red << 24 | green << 16 | blue << 8 | _OPAQUE], np.uint32)


def _moved(positions: Floats32, pose: Floats32) -> Floats32:
    """Return points (N, 3) transformed by their frame's pose (4, 4)."""
    rows = empty((3, len(positions)), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        # A matrix product would wake the threads of BLAS, which takes longer.
        np.einsum("ij,jk->ik", pose[:3, :3], positions.T, out=rows)
        rows += pose[:3, 3:]
    moved: Floats32 = rows.T
    return moved


def _is_constant(values: NDArray[Any]) -> bool:
    """Whether values (N,) are all the same: many sensors only send zeros."""
    return not len(values) or bool(values[0] == values[-1] and (values == values[0]).all())


def _usable(positions: Floats32) -> NDArray[np.bool_] | None:
    """Return a mask of the points that are finite and drawable; None if all are."""
    if not len(positions) or -LARGEST <= positions.min() <= positions.max() <= LARGEST:
        return None
    within: NDArray[np.bool_] = np.abs(positions) <= LARGEST
    return within[:, 0] & within[:, 1] & within[:, 2]


# --- scans ----------------------------------------------------------------------------------------


class LaserScanDrawing(PointsDrawing[PointsSettings]):
    """The scans of one topic."""

    key = "laser_scan"
    message_types = ("sensor_msgs/msg/LaserScan",)
    order = (INTENSITY,)

    def points(self, message: Any) -> Points:
        """Return the points with ranges of at least range_min and below range_max."""
        ranges, intensities = message.ranges, message.intensities
        if len(intensities) not in (0, len(ranges)):
            raise ValueError(f"{len(ranges)} ranges, but {len(intensities)} intensities")
        measured = (ranges >= message.range_min) & (ranges < message.range_max)
        directions = _directions(message.angle_min, message.angle_increment, len(ranges))
        if not measured.all():
            ranges, directions = ranges[measured], directions[:, measured]
            intensities = intensities[measured] if len(intensities) else intensities
        # One row per axis is several times as fast to compute and transform as one row per point.
        positions = np.zeros((3, len(ranges)), np.float32)
        np.multiply(directions, ranges, out=positions[:2])
        return Points(positions.T, {"intensity": intensities if len(intensities) else None}.get)


@lru_cache(maxsize=8)
def _directions(start: float, step: float, count: int) -> Floats32:
    """Return the directions (2, N) of the rays, which seldom change."""
    with np.errstate(all="ignore"):  # non-finite points are left out later
        angles = start + step * np.arange(count)
        return np.array([np.cos(angles), np.sin(angles)], np.float32)


# --- clouds ---------------------------------------------------------------------------------------

# NumPy types by PointField.datatype.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_POSITION = ("x", "y", "z")
_PACKED = ("rgb", "rgba")  # fields of colors with a byte per channel, blue in the lowest one


class PointCloud2Drawing(PointsDrawing[PointsSettings]):
    """The clouds of one topic."""

    key = "point_cloud2"
    message_types = ("sensor_msgs/msg/PointCloud2",)
    high_bandwidth, max_waiting = True, DEPTH_HIGH_BANDWIDTH
    order = (RGB8, INTENSITY, AXIS)

    def points(self, message: Any) -> Points:
        fields = _fields(message, {*_POSITION, *_PACKED, self.settings.channel_name})
        if not fields.keys() >= set(_POSITION):
            present = listing(message.fields.name, 10)
            raise ValueError(f"no fields x, y and z that can be read, but {present}")
        values = _values(message, fields)
        names = values.dtype.names or ()
        return Points(
            _positions(values),
            lambda name: values[name] if name in names else None,
            next((_packed_colors(values[name], name) for name in _PACKED if name in names), None),
        )


def _fields(message: Any, wanted: set[str]) -> dict[str, tuple[np.dtype[Any], int]]:
    """Return the type and byte offset of each of the ``wanted`` fields that exist."""
    order, columns = ">" if message.is_bigendian else "<", {}
    fields = message.fields
    for name, offset, kind in zip(fields.name, fields.offset, fields.datatype, strict=True):
        if name in wanted and int(kind) in _TYPES:
            dtype = np.dtype(order + _TYPES[int(kind)])
            # NumPy would read outside of the points, for some offsets outside of the memory.
            if int(offset) + dtype.itemsize > message.point_step:
                raise ValueError(
                    f'the field "{name}" ends at byte {int(offset) + dtype.itemsize} of a point, '
                    f"which has {message.point_step} (point_step)"
                )
            columns[name] = (dtype, int(offset))
    return columns


def _values(message: Any, fields: dict[str, tuple[np.dtype[Any], int]]) -> NDArray[Any]:
    """Return the points as (N,) structs; without padding of rows, a view of the message's bytes."""
    width, rows, step = int(message.width), int(message.height), int(message.point_step)
    row_step = rows > 1 and int(message.row_step) or width * step
    if width * rows == 0:
        return np.empty(0, _structs(step, fields))
    needed = (rows - 1) * row_step + width * step
    if row_step < width * step or len(message.data) < needed:
        raise ValueError(
            f"{rows} rows of {width} points of {step} bytes, {row_step} from row to row, do not "
            f"fit into {len(message.data)} bytes"
        )
    shape, strides = (rows, width), (row_step, step)
    points: NDArray[Any] = np.ndarray(shape, _structs(step, fields), message.data, 0, strides)
    return points.reshape(-1)


def _structs(step: int, fields: dict[str, tuple[np.dtype[Any], int]]) -> np.dtype[Any]:
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": step})


def _positions(values: NDArray[Any]) -> Floats32:
    """Return the positions (N, 3), stored by axis, in which they are transformed faster."""
    rows = empty((3, len(values)), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, name in enumerate(_POSITION):
            rows[axis] = values[name]
    positions: Floats32 = rows.T
    return positions


def _packed_colors(values: NDArray[Any], name: str) -> Colors:
    """Return the colors in a field."""
    packed = values.view(values.dtype.str.replace("f", "u").replace("i", "u")).astype(np.uint32)
    alpha = packed >> 24 if name == "rgba" else np.uint32(0xFF)
    colors: Colors = packed << 8 | alpha
    return colors


# --- colors ------------------------------------------------------------------------------------


def colored(values: NDArray[Any], bounds: tuple[float, float] | None, table: Colors) -> Colors:
    """Return the colors (N,) of values.

    Args:
        values: (N,) numbers.
        bounds: values of the first and the last color; None for the minimum and maximum value.
        table: (256,) colors.
    """
    if not len(values):
        return np.empty(0, np.uint32)
    # Copy to a floating-point type, float32 if that is precise enough.
    scaled = values.astype(np.result_type(values.dtype, np.float32))
    low, high = bounds or _bounds(scaled)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled -= scaled.dtype.type(low)
        scaled *= scaled.dtype.type(255.0 / (high - low) if high > low else 0.0)
        rows = np.clip(scaled, 0.0, 255.0, out=scaled).astype(np.uint8)  # NaN may become any color
    colors: Colors = empty(rows.shape, np.uint32)
    # All indexes are valid, so use "wrap", the fastest mode.
    return table.take(rows, out=colors, mode="wrap")


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
    """Return (256,) colors, from the lowest value's to the highest value's."""
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
