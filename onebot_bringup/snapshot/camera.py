"""A camera as it is written on a command line: ``x,y,z`` or ``x,y,z:tx,ty,tz``."""

import math

from onebot_bringup.viewer.geometry import Vector


def parse_camera(text: str) -> tuple[Vector, Vector | None]:
    """Return eye and target, metres in the fixed frame; no target if only the eye is given.

    Raises:
        ValueError: it is written otherwise, or it looks nowhere; the message says how to write it.
    """
    eye, colon, target = text.partition(":")
    found = _vector(eye, text), _vector(target, text) if colon else None
    if found[0] == found[1]:
        raise ValueError(f'"{text}": the camera stands where it looks at')
    return found


def _vector(text: str, whole: str) -> Vector:
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(z):
        raise ValueError(f'"{whole}": write x,y,z of the eye, or x,y,z:x,y,z with its target (m)')
    return x, y, z
