"""How often messages come, how large and how late: the numbers behind ``topic hz, bw, delay``."""

import math
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class Spread:
    """What a number of samples amounts to, in their unit.

    Attributes:
        mean: their mean.
        low: the least.
        high: the greatest.
        deviation: the standard deviation, of the samples themselves (divided by n).
        count: how many there are.
    """

    mean: float
    low: float
    high: float
    deviation: float
    count: int


class Window:
    """The last so many samples."""

    def __init__(self, size: int | None) -> None:
        """Keep ``size`` samples; None for all."""
        self._samples: deque[float] = deque(maxlen=size)
        self._news = False

    def add(self, sample: float) -> None:
        """Take one more."""
        self._samples.append(sample)
        self._news = True

    def clear(self) -> None:
        """Forget all."""
        self._samples.clear()

    def spread(self) -> Spread | None:
        """Return what they amount to; None without samples, or none new since the last call."""
        count = len(self._samples)
        if not count or not self._news:
            return None
        self._news = False
        mean = math.fsum(self._samples) / count
        variance = math.fsum((sample - mean) ** 2 for sample in self._samples) / count
        return Spread(mean, min(self._samples), max(self._samples), math.sqrt(variance), count)


class Intervals:
    """The time between messages, for ``topic hz``."""

    def __init__(self, size: int | None) -> None:
        """Measure over ``size`` intervals at most."""
        self._window = Window(size)
        self._last: float | None = None

    def arrived(self, seconds: float) -> None:
        """Note that a message came at a time; a clock that goes back starts anew."""
        if self._last is not None and seconds >= self._last:
            self._window.add(seconds - self._last)
        elif self._last is not None:
            self._window.clear()
        self._last = seconds

    def report(self) -> str | None:
        """Return what ``ros2 topic hz`` prints; None if nothing came since the last report."""
        found = self._window.spread()
        if found is None:
            return None
        rate = 1.0 / found.mean if found.mean > 0.0 else 0.0
        return f"average rate: {rate:.3f}\n{_details(found)}"


class Delays:
    """The age of messages as they come, by the time in their header, for ``topic delay``."""

    def __init__(self, size: int | None) -> None:
        """Measure over ``size`` messages at most."""
        self._window = Window(size)

    def arrived(self, delay: float) -> None:
        """Note a message that is so many seconds old."""
        self._window.add(delay)

    def report(self) -> str | None:
        """Return what ``ros2 topic delay`` prints; None if nothing came since the last report."""
        found = self._window.spread()
        return f"average delay: {found.mean:.3f}\n{_details(found)}" if found else None


class Bandwidth:
    """How many bytes come in a second, for ``topic bw``."""

    def __init__(self, size: int | None) -> None:
        """Measure over ``size`` messages at most."""
        self._sizes = Window(size)
        self._times: deque[float] = deque(maxlen=size)

    def arrived(self, seconds: float, size: int) -> None:
        """Note that a message of ``size`` bytes came at a time."""
        self._times.append(seconds)
        self._sizes.add(size)

    def report(self, now: float) -> str | None:
        """Return what ``ros2 topic bw`` prints; None before the second message and without news."""
        if len(self._times) < 2 or now <= self._times[0]:
            return None
        found = self._sizes.spread()
        if found is None:
            return None
        rate = found.mean * found.count / (now - self._times[0])
        return (
            f"{_bytes(rate)}/s from {found.count} messages\n"
            f"\tMessage size mean: {_bytes(found.mean)} "
            f"min: {_bytes(found.low)} max: {_bytes(found.high)}"
        )


def _details(found: Spread) -> str:
    return (
        f"\tmin: {found.low:.3f}s max: {found.high:.3f}s "
        f"std dev: {found.deviation:.5f}s window: {found.count}"
    )


def _bytes(number: float) -> str:
    for unit, factor in (("MB", 1e6), ("KB", 1e3)):
        if number >= factor:
            return f"{number / factor:.2f} {unit}"
    return f"{number:.0f} B"
