"""The base's hull: one smooth skin, swept from tail to nose, at any distance from itself."""

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from onebot_description.cad.dimensions import Base
from onebot_description.cad.shapes import loft

_SECTION_POINTS = 36
_SECTION_POWER = 5.0  # of the superellipse: 2 is an ellipse, many a rectangle
_LEAN = 0.07  # the sides lean inwards, by this share of the half width
# How far from nose and tail the width, the top and the bottom begin to close (m), and how squarely
# they do (the superellipse's power).
_NOSE = {"width": (0.115, 2.5), "top": (0.155, 2.3), "bottom": (0.06, 2.6)}
_TAIL = {"width": (0.085, 2.8), "top": (0.085, 2.5), "bottom": (0.05, 2.4)}
_RAMP = 0.028  # length of the rise from the bottom to the tail's
NOSE_HEIGHT = -0.027  # of the foremost point
TAIL_HEIGHT = 0.031


def hull(base: Base, grown: float = 0.0) -> Manifold:
    """Return the hull's solid, its skin moved outwards by ``grown`` metres (inwards if < 0)."""
    x = _stations(base.rear - grown, base.front - base.bumper + grown)
    width, bottom, top = _outline(base, x, grown)
    across, up = _section()
    sections = np.empty((len(x), _SECTION_POINTS, 3))
    sections[..., 0] = x[:, None]
    sections[..., 1] = width[:, None] * across
    sections[..., 2] = (top + bottom)[:, None] / 2 + (top - bottom)[:, None] / 2 * up
    return loft(sections)


def is_inside(base: Base, points: NDArray[np.float64], grown: float) -> NDArray[np.bool_]:
    """Return which of the (N, 3) points lie inside ``hull(base, grown)``."""
    x = np.clip(points[:, 0], base.rear - grown, base.front - base.bumper + grown)
    width, bottom, top = _outline(base, x, grown)
    height = np.maximum(top - bottom, 1e-9) / 2
    up = (points[:, 2] - (top + bottom) / 2) / height
    across = points[:, 1] / (np.maximum(width, 1e-9) * (1 - _LEAN * (1 + up) / 2))
    inside = np.abs(across) ** _SECTION_POWER + np.abs(up) ** _SECTION_POWER < 1
    return np.asarray(inside & (x == points[:, 0]))


def _outline(
    base: Base, x: NDArray[np.float64], grown: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return half the width, the bottom and the top at each x."""
    tail, nose = base.rear - grown, base.front - base.bumper + grown
    middle = np.interp(x, [tail, nose], [TAIL_HEIGHT, NOSE_HEIGHT])
    top = middle + (base.deck + grown - middle) * _closing(x, tail, nose, "top")
    floor = _floor(base, x) - grown
    bottom = middle - (middle - floor) * _closing(x, tail, nose, "bottom")
    return (base.width / 2 + grown) * _closing(x, tail, nose, "width"), bottom, top


def _stations(tail: float, nose: float) -> NDArray[np.float64]:
    """Return where sections stand along x: dense where the hull closes."""
    turn = np.linspace(0.0, np.pi / 2, 11)
    rear = tail + 0.085 * (1 - np.cos(turn))
    front = nose - 0.155 * (1 - np.cos(np.linspace(0.0, np.pi / 2, 14)))
    between = np.linspace(rear[-1], front[-1], 12)[1:-1]
    return np.concatenate([rear, between, front[::-1]])


def _closing(x: NDArray[np.float64], tail: float, nose: float, what: str) -> NDArray[np.float64]:
    """Return 1 amidships, falling to 0 at either end along a superellipse."""
    length, power = _NOSE[what]
    ahead = np.clip((x - (nose - length)) / length, 0.0, 1.0)
    closing = (1 - ahead**power) ** (1 / power)
    length, power = _TAIL[what]
    behind = np.clip(((tail + length) - x) / length, 0.0, 1.0)
    return np.asarray(closing * (1 - behind**power) ** (1 / power), float)


def _floor(base: Base, x: NDArray[np.float64]) -> NDArray[np.float64]:
    share = np.clip((base.tail_start + _RAMP - x) / _RAMP, 0.0, 1.0)
    return np.asarray(base.bottom + (base.tail_bottom - base.bottom) * share**2 * (3 - 2 * share))


def _section() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the unit section's points: across and up, each reaching from -1 to 1."""
    angle = np.linspace(0.0, 2 * np.pi, _SECTION_POINTS, endpoint=False)
    power = 2 / _SECTION_POWER
    across = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power
    up = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power
    across = across * (1 - _LEAN * (1 + up) / 2)
    return across / np.abs(across).max(), up
