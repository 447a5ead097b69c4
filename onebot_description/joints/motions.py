"""What a joint can be asked to do: hold a position, swing, follow keyframes, sweep its range.

Positions are in rad (m for a prismatic joint), times in s since the motion began.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.joints.limits import FloatArray

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


# Where all joints ought to be at a moment: the motions of N joints as arrays.

_TURN = 2.0 * np.pi
# Looped keyframes whose ends lie whole turns apart go on turning; closer than this counts as whole.
_WHOLE_TURN = 1e-2


class Tracks:
    """The motions of N joints, evaluated together."""

    def __init__(
        self,
        motions: Sequence[Motion],
        origins: FloatArray,
        starts: FloatArray,
        endless: NDArray[np.bool_],
    ) -> None:
        """Sort the motions by kind.

        Args:
            motions: N motions.
            origins: (N,) time at which each began, in s.
            starts: (N,) positions the joints had then, for keyframes with a lead.
            endless: (N,) true for joints that turn without end.

        Raises:
            TypeError: a motion of a kind that nothing here evaluates.
        """
        for motion in motions:
            if not isinstance(motion, _EVALUATED):
                raise TypeError(f"no track for a motion of type {type(motion).__name__}")
        self._base = np.array(
            [motion.position if isinstance(motion, Constant) else 0.0 for motion in motions]
        )
        self._banks: list[_Sines | _Keyframes | _Sweeps] = []
        for bank in _BANKS:
            index = np.array([i for i, m in enumerate(motions) if isinstance(m, bank.KIND)], int)
            if len(index):
                chosen = [motions[i] for i in index]
                self._banks.append(
                    bank(chosen, index, origins[index], starts[index], endless[index])
                )

    def at(self, time: float) -> FloatArray:
        """Return the positions (N,) asked for at ``time``, in s, whatever the limits."""
        positions: FloatArray = self._base.copy()
        for bank in self._banks:
            positions[bank.index] = bank.at(time)
        return positions


class _Bank:
    """Some motions of one kind; ``index`` says which joints they move."""

    def __init__(self, index: NDArray[np.intp], origins: FloatArray) -> None:
        self.index = index
        self._origins = origins

    def _since(self, time: float) -> FloatArray:
        return np.asarray(np.maximum(time - self._origins, 0.0))


class _Table(_Bank):
    """Motions that some numbers of their own describe, whatever the joint; a row a number."""

    NUMBERS: tuple[str, ...]

    def __init__(
        self,
        motions: Sequence[Motion],
        index: NDArray[np.intp],
        origins: FloatArray,
        _starts: FloatArray,
        _endless: NDArray[np.bool_],
    ) -> None:
        super().__init__(index, origins)
        self._table = np.array(
            [[getattr(motion, name) for motion in motions] for name in self.NUMBERS]
        )


class _Sines(_Table):
    KIND = Sine
    NUMBERS = ("amplitude", "frequency", "phase", "offset")

    def at(self, time: float) -> FloatArray:
        amplitude, frequency, phase, offset = self._table
        angle = _TURN * frequency * self._since(time) + phase
        return np.asarray(offset + amplitude * np.sin(angle))


class _Keyframes(_Bank):
    """Rows of times and positions, padded at the end by repeating the last one."""

    KIND = Keyframes

    def __init__(
        self,
        motions: Sequence[Keyframes],
        index: NDArray[np.intp],
        origins: FloatArray,
        starts: FloatArray,
        endless: NDArray[np.bool_],
    ) -> None:
        super().__init__(index, origins)
        rows = [_row(motion, start) for motion, start in zip(motions, starts, strict=True)]
        width = max(len(times) for times, _ in rows)
        self._times = np.array([_pad(times, width, np.inf) for times, _ in rows])
        self._positions = np.array([_pad(places, width, places[-1]) for _, places in rows])
        self._smooth = np.array([motion.blend == MINIMUM_JERK for motion in motions])
        self._first = np.array([motion.lead for motion in motions])
        self._last = np.array([times[-1] for times, _ in rows])
        self._loop = np.array([motion.loop for motion in motions]) & (self._last > self._first)
        turn = np.array([m.positions[-1] - m.positions[0] for m in motions])
        whole = np.abs(turn - _TURN * np.round(turn / _TURN)) < _WHOLE_TURN
        self._turn = np.where(whole & endless & self._loop, turn, 0.0)

    def at(self, time: float) -> FloatArray:
        since = self._since(time)
        period = np.where(self._loop, self._last - self._first, 1.0)
        again = self._loop & (since >= self._last)
        passes = np.where(again, np.floor((since - self._first) / period), 0.0)
        moment = np.where(again, self._first + (since - self._first) % period, since)
        return np.asarray(self._within(moment) + passes * self._turn)

    def _within(self, moment: FloatArray) -> FloatArray:
        """Positions during the first pass."""
        rows = np.arange(len(moment))
        after = np.count_nonzero(self._times <= moment[:, None], axis=1)
        right = np.minimum(after, self._times.shape[1] - 1)
        left = np.maximum(after - 1, 0)
        begin, end = self._times[rows, left], self._times[rows, right]
        inside = (begin < end) & (end < np.inf)
        share = np.where(inside, (moment - begin) / np.where(inside, end - begin, 1.0), 0.0)
        share = np.clip(share, 0.0, 1.0)
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        share = np.where(self._smooth, smooth, share)
        from_, to = self._positions[rows, left], self._positions[rows, right]
        return np.asarray(from_ + share * (to - from_))


class _Sweeps(_Table):
    KIND = Sweep
    NUMBERS = ("speed", "start", "lower", "upper")

    def at(self, time: float) -> FloatArray:
        speed, start, lowest, highest = self._table
        ahead = start + speed * self._since(time)
        bounded = np.isfinite(lowest) & np.isfinite(highest)
        lower = np.where(bounded, lowest, 0.0)
        span = np.where(bounded, highest - lowest, 1.0)
        # A triangle wave: up to the upper end, back to the lower one.
        way = (ahead - lower) % np.where(span > 0.0, 2.0 * span, 1.0)
        folded = np.where(span > 0.0, lower + span - np.abs(way - span), lower)
        return np.asarray(np.where(bounded, folded, ahead))


_BANKS = (_Sines, _Keyframes, _Sweeps)
_EVALUATED = (Constant, *(bank.KIND for bank in _BANKS))


def _row(motion: Keyframes, start: float) -> tuple[list[float], list[float]]:
    """Times and positions, the lead made into a keyframe of its own."""
    if motion.lead <= 0.0:
        return list(motion.times), list(motion.positions)
    times = [0.0, *(motion.lead + time for time in motion.times)]
    return times, [float(start), *motion.positions]


def _pad(values: list[float], width: int, filler: float) -> list[float]:
    return values + [filler] * (width - len(values))


# What a motion asks for beyond a joint's limits, and the nearest thing that would be right.

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
