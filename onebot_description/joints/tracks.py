"""Where all joints ought to be at a moment: the motions of N joints as arrays."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from onebot_description.joints.limits import FloatArray
from onebot_description.joints.motions import (
    MINIMUM_JERK,
    Constant,
    Keyframes,
    Motion,
    Sine,
    Sweep,
)

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
        """
        self._base = np.array(
            [motion.position if isinstance(motion, Constant) else 0.0 for motion in motions]
        )
        self._banks: list[_Sines | _Keyframes | _Sweeps] = []
        for bank in (_Sines, _Keyframes, _Sweeps):
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


def _row(motion: Keyframes, start: float) -> tuple[list[float], list[float]]:
    """Times and positions, the lead made into a keyframe of its own."""
    if motion.lead <= 0.0:
        return list(motion.times), list(motion.positions)
    times = [0.0, *(motion.lead + time for time in motion.times)]
    return times, [float(start), *motion.positions]


def _pad(values: list[float], width: int, filler: float) -> list[float]:
    return values + [filler] * (width - len(values))
