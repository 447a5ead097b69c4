"""What tests that draw pictures share: a renderer, and reading colors off a picture."""

import functools
import io
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from onebot_bringup.viewer.rendering import NO_RENDERER, TOO_OLD, renderer_problem


def require_renderer() -> None:
    """Skip where nothing can draw, naming the package; fail in CI, which installs it."""
    reason = _missing()
    if reason and os.environ.get("CI"):
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)


@functools.cache
def _missing() -> str:
    problem = renderer_problem()
    assert problem in ("", NO_RENDERER, TOO_OLD), problem
    return problem


def pixels(png: Path | bytes) -> NDArray[np.int64]:
    """Return a picture as (height, width, 3) sRGB bytes."""
    source = io.BytesIO(png) if isinstance(png, bytes) else png
    return np.asarray(Image.open(source).convert("RGB")).astype(int)


def colored(image: NDArray[np.int64], rgb: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Return where ``image`` shows ``rgb``, lit or in the shade: (height, width).

    Shading scales linear light, and so, about, the bytes: the direction in color space stays.
    """
    wanted = np.array(rgb) / np.linalg.norm(rgb)
    length = np.linalg.norm(image, axis=2)
    along = image @ wanted
    return (length > 40) & (along > 0.995 * length)


def center(mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean column and row where ``mask`` is true, as fractions of the picture."""
    rows, columns = np.nonzero(mask)
    height, width = mask.shape
    return float(columns.mean()) / width, float(rows.mean()) / height
