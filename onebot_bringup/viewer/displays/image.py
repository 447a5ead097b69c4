"""Pictures (sensor_msgs/Image and CompressedImage), each topic in a view beside the robot's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import ReadyColumn, bytes_maker, ready
from onebot_bringup.viewer.core.display import LayoutPart, SideView
from onebot_bringup.viewer.core.drawing import (
    DEPTH_HIGH_BANDWIDTH,
    Drawing,
    TopicSettings,
)
from onebot_bringup.viewer.core.settings import setting, signed
from onebot_description.arrays import Bytes
from onebot_description.errors import printable, shortened


@dataclass(frozen=True)
class ImageSettings(TopicSettings):
    """Pictures."""

    normalize_range: bool = setting(True, "scale 16 and 32 bit images by their own values")
    min_value: float = setting(0.0, "the value of black, if not normalized", signed)
    max_value: float = setting(1.0, "the value of white, if not normalized", signed)


# --- encodings of pixels --------------------------------------------------------------------------


class _Encoding(NamedTuple):
    """How a pixel is stored, and how Rerun shows it."""

    dtype: str  # a channel's type, in the byte order of the machine
    channels: int
    kind: type[rr.Image | rr.DepthImage]
    format: Mapping[str, Any]  # Rerun's format
    meter: float = 0.0  # the value of a meter, for depth images


def _color(model: str, channels: int) -> _Encoding:
    return _Encoding("u1", channels, rr.Image, {"color_model": model, "channel_datatype": "U8"})


def _packed(pixel_format: str, channels: int) -> _Encoding:
    return _Encoding("u1", channels, rr.Image, {"pixel_format": pixel_format})


def _depth(dtype: str, datatype: str, meter: float) -> _Encoding:
    grey = {"color_model": "L", "channel_datatype": datatype}
    return _Encoding(dtype, 1, rr.DepthImage, grey, meter)


_GREY = _color("L", 1)
_UYVY = ("yuv422", "uyvy")  # luminance in the second byte; in Rerun's YUY2, the first
_ENCODINGS: Mapping[str, _Encoding] = {
    "rgb8": _color("RGB", 3),
    "rgba8": _color("RGBA", 4),
    **dict.fromkeys(("bgr8", "8UC3"), _color("BGR", 3)),
    **dict.fromkeys(("bgra8", "8UC4"), _color("BGRA", 4)),
    **dict.fromkeys(("mono8", "8UC1"), _GREY),
    "mono16": _GREY._replace(dtype="u2"),
    "16UC1": _depth("u2", "U16", 1000.0),  # REP-118: depth in millimeters
    "32FC1": _depth("f4", "F32", 1.0),
    **{
        f"bayer_{order}8": _packed(f"Bayer{order.upper()}8", 1)
        for order in ("rggb", "bggr", "gbrg", "grbg")
    },
    **dict.fromkeys((*_UYVY, "yuv422_yuy2", "yuyv"), _packed("YUY2", 2)),
}
_COMPRESSED = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png"}


def _pixels(message: Any, encoding: _Encoding) -> Bytes:
    """Return the pixels without padding, in native byte order; not copied if they already are."""
    width, rows, step = int(message.width), int(message.height), int(message.step)
    size = np.dtype(encoding.dtype).itemsize
    line = width * encoding.channels * size
    if not width * rows:
        raise ValueError("it has no pixels")
    if step < line or len(message.data) < (rows - 1) * step + line:
        raise ValueError(
            f"{rows} rows of {width} pixels of {line // width} bytes, {step} from row to row "
            f"(step), do not fit into {len(message.data)} bytes"
        )
    pixels: Bytes = np.ndarray((rows, line), np.uint8, message.data, 0, (step, 1)).reshape(-1)
    if size > 1 and message.is_bigendian:
        pixels = pixels.view(f"u{size}").byteswap().view(np.uint8)
    return pixels


class ImageDrawing(Drawing[ImageSettings]):
    """The pictures of one topic."""

    key = "image"
    message_types = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
    rviz_classes = ("CompressedImage", "Camera")
    high_bandwidth, max_waiting = True, DEPTH_HIGH_BANDWIDTH
    has_header = False  # shown without a transform

    @classmethod
    def is_duplicate(cls, topic: str, topics: Mapping[str, str]) -> bool:
        """Whether it is the compressed copy of a picture that image_transport publishes."""
        picture, _, transport = topic.rpartition("/")
        return transport == "compressedDepth" or (
            transport == "compressed" and topics.get(picture) in cls.message_types
        )

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the frame that a CameraInfo beside the topic defines for its picture."""
        return [rr.CoordinateFrame(picture_frame(self.name))]

    def layout(self) -> LayoutPart:
        """Return a view of the picture; the robots' view shows it only in a camera's frustum."""
        return LayoutPart(views=(ImageView(self.entity, self.name),), hidden=(self.entity,))

    def draw(self, message: Any) -> Sequence[ReadyColumn]:
        if hasattr(message, "format"):
            return self._compressed(message)
        encoding = _ENCODINGS.get(message.encoding)
        if encoding is None:
            name = printable(shortened(message.encoding))
            raise ValueError(f'encoding "{name}" is not supported, only {", ".join(_ENCODINGS)}')
        pixels = _pixels(message, encoding)
        if message.encoding in _UYVY:
            pixels = pixels.view(np.uint16).byteswap().view(np.uint8)
        elif message.encoding == "mono16":
            pixels = self._grey(pixels.view(np.uint16))
        buffer = _depth_buffer if encoding.kind is rr.DepthImage else _buffer
        bounds = (
            None
            if self.settings.normalize_range
            else (self.settings.min_value, self.settings.max_value)
        )
        size = (message.width, message.height)
        return [buffer(pixels), *_format(message.encoding, size, bounds)]

    def _grey(self, values: NDArray[np.uint16]) -> Bytes:
        low, high = self.settings.min_value, self.settings.max_value
        if self.settings.normalize_range:
            low, high = float(values.min()), float(values.max())
        scaled = (values - np.float32(low)) * np.float32(255.0 / max(high - low, 1e-9))
        grey: Bytes = np.clip(scaled, 0.0, 255.0).astype(np.uint8)
        return grey

    def _compressed(self, message: Any) -> Sequence[ReadyColumn]:
        start = message.data[:8].tobytes()
        for magic, media_type in _COMPRESSED.items():
            if start.startswith(magic):
                kind = rr.EncodedImage.columns(media_type=[media_type])
                return [_blob(message.data), *ready(kind)]
        name = printable(shortened(message.format))
        raise ValueError(f'format "{name}" is not supported, only jpeg and png')


_buffer = bytes_maker(rr.Image.columns(buffer=[b"0"]))
_depth_buffer = bytes_maker(rr.DepthImage.columns(buffer=[b"0"]))
_blob = bytes_maker(rr.EncodedImage.columns(blob=[b"0"]))


@lru_cache(maxsize=64)
def _format(
    name: str, size: tuple[int, int], bounds: tuple[float, float] | None
) -> Sequence[ReadyColumn]:
    """Return the columns besides the pixels; ``bounds`` are the values of black and white."""
    encoding, (width, height) = _ENCODINGS[name], size
    shape = rr.components.ImageFormat(width=width, height=height, **encoding.format)
    if encoding.kind is rr.Image:
        return ready(rr.Image.columns(format=[shape]))
    depth_range = None if bounds is None else [bounds]
    return ready(
        rr.DepthImage.columns(
            format=[shape],
            meter=[encoding.meter],
            colormap=["Grayscale"],
            depth_range=depth_range,
        )
    )


# --- views ----------------------------------------------------------------------------------------


class ImageView(SideView):
    """A view of the pictures of a topic."""

    def view(self) -> rrb.View:
        return rrb.Spatial2DView(origin=self.entity, name=self.name)


def picture_frame(topic: str) -> str:
    """Return the frame of a camera's pictures.

    Args:
        topic: the topic of its CameraInfo, or of a picture beside it.
    """
    space = topic.removesuffix("/compressed").rpartition("/")[0]
    return f"picture:{space or '/'}"
