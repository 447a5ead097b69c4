"""What a motion asks for beyond a joint's limits, and the nearest thing that would be right."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from onebot_description.joints.motions import (
    LINEAR,
    MINIMUM_JERK_PEAK,
    Constant,
    Keyframes,
    Motion,
    Sine,
    Sweep,
)

# Rounding must not be reported: 2 pi f written with a few digits is right.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Allowed:
    """What one joint may do.

    Attributes:
        lower: rad, or m.
        upper: rad, or m.
        velocity: rad/s, or m/s.
        unit: "rad" or "m".
        endless: the joint turns without end.
    """

    lower: float
    upper: float
    velocity: float
    unit: str = "rad"
    endless: bool = False

    def holds(self, position: float) -> bool:
        """Whether ``position`` is in range."""
        return self.lower - _TOLERANCE <= position <= self.upper + _TOLERANCE

    @property
    def range(self) -> str:
        """The range in words."""
        return f"its limits [{self.lower:.6g}, {self.upper:.6g}] {self.unit}"

    @property
    def speed(self) -> str:
        """The velocity limit in words."""
        return f"its limit {self.velocity:.4g} {self.unit}/s"


def violations(motion: Motion, allowed: Allowed) -> list[str]:
    """Return what ``motion`` asks in excess of ``allowed``, each with its remedy."""
    if isinstance(motion, Constant):
        return _constant(motion, allowed)
    if isinstance(motion, Sine):
        return _sine(motion, allowed)
    if isinstance(motion, Keyframes):
        return _keyframes(motion, allowed)
    return _sweep(motion, allowed)


def _constant(motion: Constant, allowed: Allowed) -> list[str]:
    if allowed.holds(motion.position):
        return []
    source = f'pose "{motion.pose}"' if motion.pose else "position"
    nearest = min(max(motion.position, allowed.lower), allowed.upper)
    asked = f"{source} {motion.position:.6g} {allowed.unit} is beyond {allowed.range}"
    return [f"{asked}: held at {nearest:.6g}"]


def _sine(motion: Sine, allowed: Allowed) -> list[str]:
    found = []
    size = abs(motion.amplitude)
    name = f"sine of amplitude {size:.4g}"
    low, high = motion.offset - size, motion.offset + size
    if not (allowed.holds(low) and allowed.holds(high)):
        room = min(motion.offset - allowed.lower, allowed.upper - motion.offset)
        remedy = (
            f"lower amplitude to {_floor(room)}"
            if room > 0.0
            else f"bring offset to {(allowed.lower + allowed.upper) / 2.0:.4g}"
        )
        about = f"{name} about {motion.offset:.4g} goes from {low:.4g} to {high:.4g} {allowed.unit}"
        found.append(f"{about}, beyond {allowed.range}: {remedy}")
    peak = 2.0 * math.pi * motion.frequency * size
    if peak > allowed.velocity * (1.0 + _TOLERANCE):
        found.append(
            f"{name} at {motion.frequency:.4g} Hz peaks at {peak:.4g} {allowed.unit}/s,"
            f" over {allowed.speed}: lower frequency to"
            f" {_floor(allowed.velocity / (2.0 * math.pi * size))}"
        )
    return found


def _keyframes(motion: Keyframes, allowed: Allowed) -> list[str]:
    found = []
    for number, position in enumerate(motion.positions, 1):
        if not allowed.holds(position):
            asked = f"keyframe {number} at {position:.6g} {allowed.unit} is beyond {allowed.range}"
            nearest = min(max(position, allowed.lower), allowed.upper)
            found.append(f"{asked}: write {nearest:.6g}")
    found += _segments(motion, allowed)
    gap = motion.positions[0] - motion.positions[-1]
    if allowed.endless:
        gap -= 2.0 * math.pi * round(gap / (2.0 * math.pi))
    if motion.loop and abs(gap) > 1e-2 and motion.times[-1] > 0.0:
        found.append(
            f"the loop jumps from {motion.positions[-1]:.6g} to {motion.positions[0]:.6g}"
            f" {allowed.unit}, so the joint goes there at {allowed.speed}: end with a keyframe at"
            f" {motion.positions[0]:.6g}, or set loop to false"
        )
    return found


def _segments(motion: Keyframes, allowed: Allowed) -> list[str]:
    """Speeds between keyframes."""
    found = []
    factor = 1.0 if motion.blend == LINEAR else MINIMUM_JERK_PEAK
    for number in range(1, len(motion.times)):
        seconds = motion.times[number] - motion.times[number - 1]
        way = abs(motion.positions[number] - motion.positions[number - 1])
        peak = factor * way / seconds
        if peak > allowed.velocity * (1.0 + _TOLERANCE):
            remedy = (
                f"give it {_ceil(factor * way / allowed.velocity)} s"
                if allowed.velocity > 0.0
                else "the joint cannot move"
            )
            found.append(
                f"from keyframe {number} to {number + 1} it peaks at {peak:.4g} {allowed.unit}/s,"
                f" over {allowed.speed}: {remedy} instead of {seconds:.4g}"
            )
    return found


def _sweep(motion: Sweep, allowed: Allowed) -> list[str]:
    if motion.speed <= allowed.velocity * (1.0 + _TOLERANCE):
        return []
    return [
        f"delta times rate asks {motion.speed:.4g} {allowed.unit}/s, over {allowed.speed},"
        " which it keeps to: lower delta or rate"
    ]


def _floor(value: float) -> str:
    """Four digits, rounded down, so that what is advised is itself right."""
    return f"{_digits(value, math.floor):g}"


def _ceil(value: float) -> str:
    return f"{_digits(value, math.ceil):g}"


def _digits(value: float, rounding: Callable[[float], int]) -> float:
    if value == 0.0 or not math.isfinite(value):
        return value
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return rounding(round(value / step, 6)) * step
