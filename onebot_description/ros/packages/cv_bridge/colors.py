"""Conversions between the colors of images, with the formulas and rounding of OpenCV."""

from typing import Any

import numpy as np

Picture = Any  # an array (height, width) or (height, width, channels)

_GRAY = np.array([9798, 19235, 3735])  # weights of red, green, blue, in 2^-15
_YUV = np.array([[0, 1673527], [-409993, -852492], [2116026, 0]])  # rows for u and v, in 2^-20
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
    wide = np.pad(image.astype(np.int64), 1, mode="reflect")
    rows, columns = image.shape

    def near(down: int, right: int) -> Picture:
        return wide[1 + down : 1 + down + rows, 1 + right : 1 + right + columns]

    beside, above = near(0, -1) + near(0, 1), near(-1, 0) + near(1, 0)
    corners = near(-1, -1) + near(-1, 1) + near(1, -1) + near(1, 1)
    rgb = np.empty((rows, columns, 3), image.dtype)
    for y, x in ((0, 0), (0, 1), (1, 0), (1, 1)):
        places = slice(y, None, 2), slice(x, None, 2)
        own_channel, side, under = (pattern[i] for i in (2 * y + x, 2 * y + 1 - x, 2 * (1 - y) + x))
        values = {own_channel: near(0, 0), side: (beside + 1) >> 1, under: (above + 1) >> 1}
        if own_channel != "g":
            other_channel = "b" if own_channel == "r" else "r"
            values = {
                own_channel: near(0, 0),
                "g": (beside + above + 2) >> 2,
                other_channel: (corners + 2) >> 2,
            }
        for color, value in values.items():
            rgb[..., "rgb".index(color)][places] = value[places]
    rgb[:, [0, -1]] = rgb[:, [1, -2]]  # OpenCV repeats the pixels beside the edges
    rgb[[0, -1]] = rgb[[1, -2]]
    return rgb
