"""What a joint can be asked to do: hold a position, swing, follow keyframes, sweep its range.

Positions are in rad (m for a prismatic joint), times in s since the motion began.
"""

from dataclasses import dataclass

LINEAR = "linear"
MINIMUM_JERK = "minimum_jerk"
BLENDS = (LINEAR, MINIMUM_JERK)

# Peak over mean speed of 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan, 1985).
MINIMUM_JERK_PEAK = 1.875


@dataclass(frozen=True)
class Constant:
    """Hold ``position``; ``pose`` names the pose it comes from, if any."""

    position: float
    pose: str = ""


@dataclass(frozen=True)
class Sine:
    """``offset + amplitude * sin(2 pi frequency t + phase)``; frequency in Hz, phase in rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True)
class Keyframes:
    """Go through ``positions`` at ``times``.

    Attributes:
        times: increasing, from 0 on.
        positions: as many as times.
        blend: how to pass from one to the next, a member of BLENDS.
        loop: start over after the last, instead of holding it.
        lead: seconds given, once, to reach the first position from wherever the joint stands;
            the times count from then on. 0 for none.
    """

    times: tuple[float, ...]
    positions: tuple[float, ...]
    blend: str = LINEAR
    loop: bool = True
    lead: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """Go to and fro over the whole range at ``speed``, from ``start`` upwards; turn on if endless.

    Attributes:
        speed: rad/s (m/s), > 0.
        start: position to begin at.
        lower: of the range.
        upper: of the range; infinite for a joint that turns without end.
    """

    speed: float
    start: float
    lower: float
    upper: float


Motion = Constant | Sine | Keyframes | Sweep
