"""Point clouds (sensor_msgs/PointCloud2), whatever fields they have."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import empty
from onebot_bringup.viewer.displays.drawing import AUTO, DEPTH_HEAVY, by_topic
from onebot_bringup.viewer.displays.points import (
    AXIS,
    FLAT,
    INTENSITY,
    RGB8,
    Colors,
    Floats32,
    Points,
    PointsDrawing,
    PointsSettings,
)
from onebot_bringup.viewer.settings import one_of, setting
from onebot_description.errors import listing

# By PointField.datatype.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_POSITION = ("x", "y", "z")
_PACKED = ("rgb", "rgba")  # colours: a byte each, the lowest is blue


@by_topic
@dataclass(frozen=True)
class PointCloud2Settings(PointsSettings):
    """Points of clouds."""

    color_transformer: str = setting(
        AUTO,
        "auto takes the first for which there is data",
        one_of(AUTO, RGB8, INTENSITY, AXIS, FLAT),
    )


class PointCloud2Drawing(PointsDrawing):
    """The clouds of one topic."""

    key, Settings = "point_cloud2", PointCloud2Settings
    message_types = ("sensor_msgs/msg/PointCloud2",)
    heavy, kept = True, DEPTH_HEAVY
    order = (RGB8, INTENSITY, AXIS)

    def points(self, message: Any) -> Points:
        """Return all points."""
        fields = _fields(message, {*_POSITION, *_PACKED, self.settings.channel_name})
        if not fields.keys() >= set(_POSITION):
            known = listing(message.fields.name, 10)
            raise ValueError(f"no fields x, y and z that can be read, but {known}")
        values = _values(message, fields)
        names = values.dtype.names or ()
        return Points(
            _positions(values),
            lambda name: values[name] if name in names else None,
            next((_colors(values[name], name) for name in _PACKED if name in names), None),
        )


def _fields(message: Any, wanted: set[str]) -> dict[str, tuple[np.dtype[Any], int]]:
    """Return type and place of those fields that are ``wanted``.

    Raises:
        ValueError: it is not within a point.
    """
    order, found = ">" if message.is_bigendian else "<", {}
    fields = message.fields
    for name, offset, kind in zip(fields.name, fields.offset, fields.datatype, strict=True):
        if name in wanted and int(kind) in _TYPES:
            dtype = np.dtype(order + _TYPES[int(kind)])
            if int(offset) + dtype.itemsize > message.point_step:
                raise ValueError(
                    f'the field "{name}" ends at byte {int(offset) + dtype.itemsize} of a point, '
                    f"which has {message.point_step} (point_step)"
                )
            found[name] = (dtype, int(offset))
    return found


def _values(message: Any, fields: dict[str, tuple[np.dtype[Any], int]]) -> NDArray[Any]:
    """Return the points as (N,) structs in the message's own bytes, where rows are not padded.

    Raises:
        ValueError: there are less bytes.
    """
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
    found: NDArray[Any] = np.ndarray(shape, _structs(step, fields), message.data, 0, strides)
    return found.reshape(-1)


def _structs(step: int, fields: dict[str, tuple[np.dtype[Any], int]]) -> np.dtype[Any]:
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": step})


def _positions(values: NDArray[Any]) -> Floats32:
    """Return (N, 3) numbers that lie side by side; three at once would take longer to copy."""
    found: Floats32 = empty((len(values), 3), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, name in enumerate(_POSITION):
            found[:, axis] = values[name]
    return found


def _colors(values: NDArray[Any], name: str) -> Colors | None:
    """Return colours; None if the field cannot hold them."""
    if values.dtype.itemsize != 4:
        return None
    packed = values.view(values.dtype.str.replace("f", "u").replace("i", "u")).astype(np.uint32)
    alpha = packed >> 24 if name == "rgba" else np.uint32(0xFF)
    found: Colors = packed << 8 | alpha
    return found
