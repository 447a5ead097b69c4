"""Motions of joints: constant, sine, keyframes and sweep; their evaluation and limit checks.

Positions are in rad (m for a prismatic joint), times in s since the start of the motion. `Tracks`
evaluates the motions of all joints as arrays; `violations` compares one motion with its limits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.joints.limits import FloatArray

TURN = 2.0 * math.pi
LINEAR = "linear"
MINIMUM_JERK = "minimum_jerk"
BLENDS = (LINEAR, MINIMUM_JERK)

# Peak over mean speed of 10 u^3 - 15 u^4 + 6 u^5 (Flash and Hogan, 1985).
MINIMUM_JERK_PEAK = 1.875

# Looped keyframes whose ends are this close to whole turns apart keep turning, rad.
_WHOLE_TURN = 1e-2
# Relative to a limit: rounding must not be reported, such as 2 pi f written with a few digits.
_TOLERANCE = 1e-9
_TINY = 1e-100  # not worth a digit


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
    """Move through ``positions`` at ``times``."""

    times: tuple[float, ...]  # increasing, from 0 on
    positions: tuple[float, ...]  # as many as times
    blend: str = LINEAR  # interpolation, one of BLENDS
    loop: bool = True  # start over after the last, instead of holding it
    # Seconds to reach the first position from the present one, once; the times are counted from
    # its end. 0 for none.
    lead: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """Move back and forth over the whole range, from ``start`` upwards.

    A joint with an infinite range keeps turning.
    """

    speed: float  # rad/s (m/s), > 0
    start: float
    lower: float
    upper: float


Motion = Constant | Sine | Keyframes | Sweep


class Tracks:
    """The target positions of N joints, evaluated as arrays."""

    def __init__(
        self,
        motions: Sequence[Motion],
        origins: FloatArray,
        starts: FloatArray,
        endless: NDArray[np.bool_],
    ) -> None:
        """Group the motions by kind.

        Args:
            motions: N motions.
            origins: (N,) start time of each motion, s.
            starts: (N,) positions of the joints at that time, for keyframes with a lead.
            endless: (N,) True for continuous joints.

        Raises:
            TypeError: a motion is of a kind without an evaluator.
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
        """Return the target positions (N,) at ``time``, in s, before limits are applied."""
        positions: FloatArray = self._base.copy()
        for bank in self._banks:
            positions[bank.index] = bank.at(time)
        return positions


class _Bank:
    """Motions of one kind; ``index`` holds the joints they move."""

    def __init__(self, index: NDArray[np.intp], origins: FloatArray) -> None:
        self.index = index
        self._origins = origins

    def _since(self, time: float) -> FloatArray:
        return np.asarray(np.maximum(time - self._origins, 0.0))


class _Table(_Bank):
    """Motions that are fully described by their own numbers; one row per number."""

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
        angle = TURN * frequency * self._since(time) + phase
        return np.asarray(offset + amplitude * np.sin(angle))


class _Keyframes(_Bank):
    """One row of times and positions per motion, padded to equal length."""

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
        self._positions = np.array([_pad(points, width, points[-1]) for _, points in rows])
        self._smooth = np.array([motion.blend == MINIMUM_JERK for motion in motions])
        self._first = np.array([motion.lead for motion in motions])
        self._last = np.array([times[-1] for times, _ in rows])
        self._loop = np.array([motion.loop for motion in motions]) & (self._last > self._first)
        turn = np.array([m.positions[-1] - m.positions[0] for m in motions])
        whole = np.abs(turn - TURN * np.round(turn / TURN)) < _WHOLE_TURN
        self._turn = np.where(whole & endless & self._loop, turn, 0.0)

    def at(self, time: float) -> FloatArray:
        since = self._since(time)
        period = np.where(self._loop, self._last - self._first, 1.0)
        again = self._loop & (since >= self._last)
        passes = np.where(again, np.floor((since - self._first) / period), 0.0)
        moment = np.where(again, self._first + (since - self._first) % period, since)
        return np.asarray(self._within(moment) + passes * self._turn)

    def _within(self, moment: FloatArray) -> FloatArray:
        """The positions within the first pass."""
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
    """Times and positions, with the lead as a keyframe of its own."""
    if motion.lead <= 0.0:
        return list(motion.times), list(motion.positions)
    times = [0.0, *(motion.lead + time for time in motion.times)]
    return times, [float(start), *motion.positions]


def _pad(values: list[float], width: int, filler: float) -> list[float]:
    return values + [filler] * (width - len(values))


@dataclass(frozen=True)
class Allowed:
    """The limits of one joint."""

    lower: float  # rad or m
    upper: float
    velocity: float  # rad/s or m/s
    unit: str = "rad"  # or "m"
    endless: bool = False  # a continuous joint

    def holds(self, position: float) -> bool:
        """Whether ``position`` is in range."""
        return self.lower - _TOLERANCE <= position <= self.upper + _TOLERANCE

    @property
    def range(self) -> str:
        """The range as text."""
        return f"its limits [{self.lower:.6g}, {self.upper:.6g}] {self.unit}"

    @property
    def speed(self) -> str:
        """The velocity limit as text."""
        return f"its limit {self.velocity:.4g} {self.unit}/s"


def violations(motion: Motion, allowed: Allowed) -> list[str]:
    """Return one message, with a remedy, for each limit that ``motion`` exceeds."""
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
    peak = TURN * motion.frequency * size
    if peak > allowed.velocity * (1.0 + _TOLERANCE):
        found.append(
            f"{name} at {motion.frequency:.4g} Hz peaks at {peak:.4g} {allowed.unit}/s,"
            f" over {allowed.speed}: lower frequency to"
            f" {_floor(allowed.velocity / (TURN * size))}"
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
        gap -= TURN * round(gap / TURN)
    if motion.loop and abs(gap) > _WHOLE_TURN and motion.times[-1] > 0.0:
        found.append(
            f"the loop jumps from {motion.positions[-1]:.6g} to {motion.positions[0]:.6g}"
            f" {allowed.unit}, so the joint moves there at {allowed.speed}: end with a keyframe at"
            f" {motion.positions[0]:.6g}, or set loop to false"
        )
    return found


def _segments(motion: Keyframes, allowed: Allowed) -> list[str]:
    """The messages on speeds between keyframes."""
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
        f"delta times rate is {motion.speed:.4g} {allowed.unit}/s, over {allowed.speed},"
        " which it keeps to: lower delta or rate"
    ]


def _floor(value: float) -> str:
    """Four digits, rounded down, so that the advised value keeps the limit."""
    return f"{_digits(value, math.floor):g}"


def _ceil(value: float) -> str:
    return f"{_digits(value, math.ceil):g}"


def _digits(value: float, rounding: Callable[[float], int]) -> float:
    if not math.isfinite(value):
        return value
    if abs(value) < _TINY:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    return rounding(round(value / step, 6)) * step
