"""Motions of joints (sines and keyframes): their position at a time, and checks of limits.

Positions are in rad (m for prismatic joints), times in s since the start of the motion. To add a
kind of motion, write a ``Motion`` here, and its parameters and factory function in ``config``.
"""

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, replace

TURN = 2.0 * math.pi
LINEAR = "linear"
MINIMUM_JERK = "minimum_jerk"
BLENDS = (LINEAR, MINIMUM_JERK)

# Peak over mean speed of 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan, 1985).
MINIMUM_JERK_PEAK = 1.875

# Looped keyframes whose ends are this close to whole turns apart keep turning, rad.
_WHOLE_TURN = 1e-2
# Smaller violations are rounding, and not reported: relative for speeds, rad or m for positions.
_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Allowed:
    """The limits of one joint, for checks and their messages."""

    lower: float  # rad or m
    upper: float
    velocity: float  # rad/s or m/s
    unit: str = "rad"  # "m" for a prismatic joint

    def reaches(self, speed: float) -> bool:
        """Whether ``speed`` is allowed."""
        return speed <= self.velocity * (1.0 + _TOLERANCE)

    def holds(self, position: float) -> bool:
        """Whether ``position`` is in range."""
        return self.lower - _TOLERANCE <= position <= self.upper + _TOLERANCE

    def clamp(self, position: float) -> float:
        """Return the nearest position in range."""
        return min(max(position, self.lower), self.upper)

    @property
    def range(self) -> str:
        """The range as text."""
        return f"its limits [{self.lower:.6g}, {self.upper:.6g}] {self.unit}"

    @property
    def speed(self) -> str:
        """The velocity limit as text."""
        return f"its limit {self.velocity:.4g} {self.unit}/s"


class Motion(ABC):
    """How a joint moves by itself."""

    @abstractmethod
    def at(self, time: float) -> float:
        """Return the position at ``time`` (at least 0)."""

    @abstractmethod
    def violations(self, allowed: Allowed) -> Iterator[str]:
        """Yield a message, which says how to fix it, for each limit that the motion exceeds."""


@dataclass(frozen=True)
class Sine(Motion):
    """``offset + amplitude * sin(2 pi frequency t + phase)``; frequency in Hz, phase in rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0

    def at(self, time: float) -> float:
        angle = TURN * self.frequency * time + self.phase
        return self.offset + self.amplitude * math.sin(angle)

    def violations(self, allowed: Allowed) -> Iterator[str]:
        size, unit = abs(self.amplitude), allowed.unit
        low, high = self.offset - size, self.offset + size
        if not (allowed.holds(low) and allowed.holds(high)):
            text = f"sine from {low:.6g} to {high:.6g} {unit} is beyond {allowed.range}"
            yield f"{text}: lower amplitude, or change offset"
        peak = TURN * self.frequency * size
        if not allowed.reaches(peak):
            text = f"sine at {self.frequency:.4g} Hz peaks at {peak:.4g} {unit}/s"
            slower = allowed.velocity / (TURN * size)
            yield f"{text}, over {allowed.speed}: lower frequency to {slower:.6g}"


@dataclass(frozen=True)
class Keyframes(Motion):
    """A motion through ``positions`` at ``times``."""

    times: tuple[float, ...]  # increasing, from 0 on
    positions: tuple[float, ...]  # one per time
    blend: str = LINEAR  # interpolation, one of BLENDS
    loop: bool = True  # start over after the last, instead of holding it
    turn: float = 0.0  # added to the positions after each pass of the loop

    @classmethod
    def hold(cls, position: float) -> "Keyframes":
        """Return the motion that stays at a position."""
        return cls((0.0,), (position,), loop=False)

    @classmethod
    def sweep(cls, speed: float, start: float, lower: float, upper: float) -> "Keyframes":
        """Return the motion from ``start`` up, then back and forth over the range.

        If the range is infinite, it goes up forever.

        Args:
            speed: rad/s or m/s, at least 0.
            start: rad or m.
            lower: minimum position, rad or m.
            upper: maximum position, rad or m.
        """
        if speed <= 0.0 or lower == upper:
            return cls.hold(start)
        if not math.isfinite(upper - lower):
            return cls((0.0, TURN / speed), (start, start + TURN), turn=TURN)
        up, span = (upper - start) / speed, (upper - lower) / speed
        return cls((0.0, up, up + span, 2.0 * span), (start, upper, lower, start))

    def turning(self) -> "Keyframes":
        """Return the motion for a continuous joint: a loop over whole turns keeps turning."""
        way = self.positions[-1] - self.positions[0]
        return replace(self, turn=way) if abs(math.remainder(way, TURN)) < _WHOLE_TURN else self

    def at(self, time: float) -> float:
        period, passes = self.times[-1], 0.0
        if self.loop and period > 0.0:
            passes, time = divmod(time, period)
        index = bisect_right(self.times, time)
        if not 0 < index < len(self.times):
            position = self.positions[0 if index == 0 else -1]
        else:
            begin, end = self.times[index - 1 : index + 1]
            from_, to = self.positions[index - 1 : index + 1]
            position = self._between(from_, to, (time - begin) / (end - begin))
        return position + passes * self.turn

    def _between(self, from_: float, to: float, share: float) -> float:
        if self.blend == MINIMUM_JERK:
            share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        return from_ + share * (to - from_)

    def violations(self, allowed: Allowed) -> Iterator[str]:
        unit, times, positions = allowed.unit, self.times, self.positions
        for number, position in enumerate(positions, 1):
            if not allowed.holds(position):
                name = f"keyframe {number} at" if len(positions) > 1 else "position"
                text = f"{name} {position:.6g} {unit} is beyond {allowed.range}"
                yield f"{text}: held at {allowed.clamp(position):.6g}"
        factor = 1.0 if self.blend == LINEAR else MINIMUM_JERK_PEAK
        for number in range(1, len(times)):
            seconds = times[number] - times[number - 1]
            way = factor * abs(positions[number] - positions[number - 1])
            if not allowed.reaches(way / seconds):
                ends = f"from keyframe {number} to {number + 1}"
                text = f"{ends} it peaks at {way / seconds:.4g} {unit}/s, over {allowed.speed}"
                needed = way / allowed.velocity if allowed.velocity else math.inf
                yield f"{text}: give it {needed:.6g} s instead of {seconds:.6g}"
