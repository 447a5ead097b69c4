"""What a pose's covariance says of its place and its heading, and the outlines that show it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Of an outline, which has one point more: its first again.
CORNERS = 48
# An eigenvalue this much below zero, of the largest one, is rounding; more is no covariance.
_ROUNDING = 1e-9

Floats = NDArray[np.float64]


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
