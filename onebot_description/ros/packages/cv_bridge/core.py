"""``CvBridge``: converts sensor_msgs/Image and CompressedImage messages to arrays, and back.

Arrays are as in OpenCV: (height, width) or (height, width, channels), with colors as blue, green,
red unless a function says otherwise. Pillow reads and writes compressed images.
"""

import io
import re
from typing import Any

import numpy as np
import sensor_msgs.msg
from cv_bridge import colors
from cv_bridge.colors import Picture

_DEPTHS = "8U 8S 16U 16S 32S 32F 64F".split()  # OpenCV's names, in the order of its numbers
_DTYPES = "uint8 int8 uint16 int16 int32 float32 float64".split()
_GENERIC = re.compile("(8U|8S|16U|16S|32S|32F|64F)(?:C([0-9]+))?")
_COLOR = re.compile("(rgb|bgr|rgba|bgra|mono|bayer_rggb|bayer_bggr|bayer_gbrg|bayer_grbg)(8|16)")
_CHANNELS = {"rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4, "yuv422": 2, "yuv422_yuy2": 2}
_QUALITY = 95  # JPEG quality, the same as OpenCV's


class CvBridgeError(TypeError):
    """A picture cannot be converted."""


class CvBridge:
    """Converts messages to arrays, and back."""

    def dtype_with_channels_to_cvtype2(self, dtype: Any, n_channels: int) -> str:
        """Return the encoding of an array, such as 8UC3."""
        if dtype.name not in _DTYPES:
            raise CvBridgeError(f"no encoding has numbers of the type {dtype.name}")
        return f"{_DEPTHS[_DTYPES.index(dtype.name)]}C{n_channels}"

    def cvtype2_to_dtype_with_channels(self, cvtype: int) -> tuple[str, int]:
        """Return the numpy type and the number of channels of a type of OpenCV."""
        return _DTYPES[cvtype & 7], (cvtype >> 3) + 1

    def encoding_to_cvtype2(self, encoding: str) -> int:
        """Return OpenCV's type for an encoding."""
        return getCvType(encoding)

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """Return the numpy type and the number of channels of an encoding."""
        return self.cvtype2_to_dtype_with_channels(getCvType(encoding))

    def imgmsg_to_cv2(self, img_msg: Any, desired_encoding: str = "passthrough") -> Picture:
        """Return the picture of an Image message.

        Args:
            img_msg: the message.
            desired_encoding: as in sensor_msgs; the message's own by default.

        Raises:
            CvBridgeError: it cannot be converted.
        """
        name, channels = self.encoding_to_dtype_with_channels(img_msg.encoding)
        dtype = np.dtype(name).newbyteorder(">" if img_msg.is_bigendian else "<")
        data = img_msg.data
        size = dtype.itemsize * channels
        if img_msg.step < img_msg.width * size or len(data) < img_msg.height * img_msg.step:
            rows = f"{img_msg.height} rows of {img_msg.width} pixels, with a step of {img_msg.step}"
            raise CvBridgeError(f"Image is wrongly formed: {len(data)} bytes for {rows} bytes")
        shape = img_msg.height, img_msg.width, channels
        strides = img_msg.step, size, dtype.itemsize
        image: Picture = np.ndarray(shape, dtype, data, strides=strides)
        image = np.ascontiguousarray(image[:, :, 0] if channels == 1 else image, np.dtype(name))
        if desired_encoding == "passthrough":
            return image
        return convert(image, img_msg.encoding, desired_encoding)

    def cv2_to_imgmsg(
        self, cvim: Picture, encoding: str = "passthrough", header: Any = None
    ) -> Any:
        """Return an Image message.

        Args:
            cvim: the picture.
            encoding: its encoding; a generic one, such as 8UC3, by default.
            header: the message's header.

        Raises:
            CvBridgeError: an array of this type has another encoding.
        """
        kind = self._kind(cvim)
        if encoding != "passthrough" and self.encoding_to_cvtype2(kind) != getCvType(encoding):
            raise CvBridgeError(
                f"encoding specified as {encoding}, but image has incompatible type {kind}"
            )
        message = sensor_msgs.msg.Image()
        message.height, message.width = cvim.shape[:2]
        message.encoding = kind if encoding == "passthrough" else encoding
        if header is not None:
            message.header = header
        message.is_bigendian = cvim.dtype.byteorder == ">"
        message.data.frombytes(cvim.tobytes())
        message.step = len(message.data) // message.height if message.height else 0
        return message

    def compressed_imgmsg_to_cv2(
        self, cmprs_img_msg: Any, desired_encoding: str = "passthrough"
    ) -> Picture:
        """Return the picture of a CompressedImage message: gray, or with blue, green, red.

        Raises:
            CvBridgeError: it is not a picture that Pillow reads without loss.
        """
        from PIL import Image

        data = bytes(cmprs_img_msg.data)
        if data[1:4] == b"PNG" and data[24:25] == b"\x10" and data[25:26] not in b"\0":
            raise CvBridgeError("Pillow cannot read colors with 16 bits")
        try:
            with Image.open(io.BytesIO(data)) as picture:
                image = _pixels(picture)
        except OSError as error:
            raise CvBridgeError(f"not a picture: {error}") from error
        if desired_encoding == "passthrough":
            return image
        gray = "mono16" if image.dtype == np.uint16 else "mono8"
        source = {1: gray, 3: "bgr8", 4: "bgra8"}[1 if image.ndim == 2 else image.shape[2]]
        return convert(image, source, desired_encoding)

    def cv2_to_compressed_imgmsg(self, cvim: Picture, dst_format: str = "jpg") -> Any:
        """Return a CompressedImage message.

        Args:
            cvim: the picture: gray, or with blue, green, red and perhaps alpha.
            dst_format: the file name extension of the format, such as jpg or png.

        Raises:
            CvBridgeError: such a picture cannot be written in this format.
        """
        from PIL import Image

        self._kind(cvim)
        kind = Image.registered_extensions().get(f".{dst_format.lower()}")
        pixels = np.squeeze(cvim, 2) if cvim.ndim == 3 and cvim.shape[2] == 1 else cvim
        stream = io.BytesIO()
        try:
            if pixels.ndim == 3:
                order = [2, 1, 0] if kind == "JPEG" else [2, 1, 0, 3][: pixels.shape[2]]
                pixels = pixels[..., order]
            Image.fromarray(np.ascontiguousarray(pixels)).save(stream, kind, quality=_QUALITY)
        except (OSError, KeyError, ValueError, IndexError, TypeError, AttributeError) as error:
            raise CvBridgeError(
                f"an array {cvim.shape} of {cvim.dtype} cannot be written as {dst_format}: {error}"
            ) from error
        message = sensor_msgs.msg.CompressedImage(format=dst_format)
        message.data.frombytes(stream.getvalue())
        return message

    def _kind(self, cvim: Any) -> str:
        if not isinstance(cvim, (np.ndarray, np.generic)):
            raise TypeError("Your input type is not a numpy array")
        shape: tuple[int, ...] = cvim.shape
        channels = 1 if len(shape) < 3 else shape[2]
        return self.dtype_with_channels_to_cvtype2(cvim.dtype, channels)


def getCvType(encoding: str) -> int:  # noqa: N802
    """Return OpenCV's type for an encoding.

    Raises:
        CvBridgeError: the encoding is not known.
    """
    _, depth, channels = _parsed(encoding)
    return _DEPTHS.index(depth) + ((channels - 1) << 3)


def convert(image: Picture, source: str, target: str) -> Picture:
    """Return a picture in another encoding.

    Raises:
        CvBridgeError: there is no such conversion.
    """
    layout, depth, channels = _parsed(source)
    new_layout, new_depth, new_channels = _parsed(target)
    if layout and layout != new_layout and new_layout in ("mono", "rgb", "bgr", "rgba", "bgra"):
        image = colors.converted(image, layout, new_layout)
    elif layout != new_layout if new_layout else channels != new_channels:
        raise CvBridgeError(f"Unsupported conversion from [{source}] to [{target}]")
    return _with_depth(image, depth, new_depth)


def _with_depth(image: Picture, depth: str, new_depth: str) -> Picture:
    """Return a picture with another depth; 8 and 16 bits are scaled to each other."""
    if depth == new_depth:
        return image.copy()
    bits = depth[:-1], new_depth[:-1]
    scaled = image * {("8", "16"): 257.0, ("16", "8"): 1.0 / 257.0}.get(bits, 1.0)
    dtype = np.dtype(_DTYPES[_DEPTHS.index(new_depth)])
    if dtype.kind != "f":
        limits = np.iinfo(dtype)
        scaled = np.clip(np.rint(scaled), limits.min, limits.max)
    return scaled.astype(dtype)


def _parsed(encoding: str) -> tuple[str, str, int]:
    """Return the colors of an encoding ("" for a generic one), its depth and channels."""
    if match := _COLOR.fullmatch(encoding):
        return match[1], f"{match[2]}U", _CHANNELS.get(match[1], 1)
    if encoding in _CHANNELS and encoding.startswith("yuv"):
        return encoding, "8U", 2
    if match := _GENERIC.fullmatch(encoding):
        return "", match[1], int(match[2] or 1)
    raise CvBridgeError(f"Unrecognized image encoding [{encoding}]")


def _pixels(picture: Any) -> Picture:
    """Return the array that OpenCV would read, from a picture of Pillow."""
    if picture.mode.startswith("I"):
        return np.asarray(picture).astype(np.uint16)
    if picture.mode in ("1", "L"):
        return np.asarray(picture.convert("L"))
    has_alpha = picture.mode in ("LA", "PA", "RGBA") or "transparency" in picture.info
    pixels = np.asarray(picture.convert("RGBA" if has_alpha else "RGB"))
    return np.ascontiguousarray(pixels[..., [2, 1, 0, 3][: pixels.shape[2]]])
