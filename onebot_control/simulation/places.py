"""Places on the ground where a robot may stand."""

import math

from onebot_description.errors import OneBotError

Place = tuple[float, float, float]

# Farther out, rounding is no longer small against the micrometres that a wheel's contact gives.
FARTHEST = 10_000.0


def checked_place(x: float, y: float, yaw: float) -> Place:
    """Return a place to stand at.

    Args:
        x: of the root link's frame, m.
        y: likewise, m.
        yaw: its heading, rad.

    Raises:
        ValueError: a value is not finite.
        OneBotError: it is too far away to be exact there.
    """
    if not all(map(math.isfinite, (x, y, yaw))):
        raise ValueError(f"x, y and yaw must be finite, not {x}, {y}, {yaw}")
    if max(abs(x), abs(y)) > FARTHEST:
        raise OneBotError(
            f"x {x:g} m, y {y:g} m: the simulation is exact up to {FARTHEST:g} m from the origin"
        )
    return float(x), float(y), float(yaw)
