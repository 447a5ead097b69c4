"""Conversions between the colors of images, with the formulas and rounding of OpenCV."""

from typing import Any

import numpy as np

Picture = Any  # an array (height, width) or (height, width, channels)

_GRAY = np.array([9798, 19235, 3735])  # weights of red, green, blue, in 2^-15
_YUV = np.array([[0, 1673527], [-409993, -852492], [2116026, 0]])  # rows for u and v, in 2^-20
# In a Bayer mosaic, weights of a color's neighbors, in 2^-2; half of the pixels are green.
_GREEN_WEIGHTS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]])
_OTHER_WEIGHTS = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]])
_LUMA = 1220542  # factor of y, in 2^-20


def converted(image: Picture, layout: str, wanted: str) -> Picture:
    """Return a picture with other colors.

    Args:
        image: (height, width) or (height, width, channels).
        layout: mono, rgb, bgr, rgba, bgra, yuv422, yuv422_yuy2, or a bayer_ pattern.
        wanted: one of the first five.
    """
    if layout.startswith("yuv") and wanted == "mono":
        return image[..., int(layout == "yuv422")].copy()
    alpha = np.full((*image.shape[:2], 1), np.iinfo(image.dtype).max, image.dtype)
    if layout == "mono":
        rgb = np.repeat(image[..., None], 3, axis=2)
    elif layout.startswith("yuv"):
        rgb = _from_yuv(image if layout == "yuv422_yuy2" else image[..., ::-1])
    elif layout.startswith("bayer_"):
        rgb = _from_bayer(image, layout[-4:])
    else:
        rgb = image[..., [layout.index(color) for color in "rgb"]]
        alpha = image[..., 3:] if image.shape[2] == 4 else alpha
    if wanted == "mono":
        gray = (rgb.astype(np.int64) @ _GRAY + (1 << 14)) >> 15
        return gray.astype(image.dtype)
    pixels = np.concatenate([rgb, alpha], axis=2)
    return pixels[..., ["rgba".index(color) for color in wanted]]


def _from_yuv(image: Picture) -> Picture:
    """Return red, green, blue from rows of y u y v (ITU-R BT.601)."""
    pairs = image[..., 1].reshape(image.shape[0], -1, 2).astype(np.int64) - 128
    chroma = np.repeat(pairs @ _YUV.T, 2, axis=1)
    luma = np.maximum(image[..., :1].astype(np.int64) - 16, 0) * _LUMA
    return np.clip((luma + chroma + (1 << 19)) >> 20, 0, 255).astype(np.uint8)


def _from_bayer(image: Picture, pattern: str) -> Picture:
    """Return red, green, blue of a Bayer mosaic by bilinear interpolation."""
    from scipy.ndimage import convolve  # slow to import

    rows, columns = np.indices(image.shape) % 2
    colors = np.array(list(pattern))[2 * rows + columns]
    rgb = np.empty((*image.shape, 3), image.dtype)
    for channel, color in enumerate("rgb"):
        mosaic = np.where(colors == color, image, 0).astype(np.int64)
        weights = _GREEN_WEIGHTS if color == "g" else _OTHER_WEIGHTS
        rgb[..., channel] = (convolve(mosaic, weights, mode="mirror") + 2) >> 2
    rgb[:, [0, -1]] = rgb[:, [1, -2]]  # OpenCV repeats the pixels beside the edges
    rgb[[0, -1]] = rgb[[1, -2]]
    return rgb
