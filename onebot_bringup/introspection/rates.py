"""Rate and bandwidth of messages, printed like ``ros2 topic hz`` and ``bw``."""

import math
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class Statistics:
    """Statistics of samples, in their unit."""

    mean: float
    low: float  # minimum
    high: float  # maximum
    deviation: float  # standard deviation of the samples themselves (divided by n)
    count: int  # of samples


class Window:
    """The last samples of a measurement."""

    def __init__(self, size: int | None) -> None:
        self._samples: deque[float] = deque(maxlen=size)
        self._new = False

    def add(self, sample: float) -> None:
        """Add one sample."""
        self._samples.append(sample)
        self._new = True

    def clear(self) -> None:
        """Drop all samples."""
        self._samples.clear()

    def statistics(self) -> Statistics | None:
        """Return the statistics; None without new samples since the last call."""
        count = len(self._samples)
        if not count or not self._new:
            return None
        self._new = False
        mean = math.fsum(self._samples) / count
        variance = math.fsum((sample - mean) ** 2 for sample in self._samples) / count
        return Statistics(mean, min(self._samples), max(self._samples), math.sqrt(variance), count)


class Intervals:
    """The time between messages, for ``topic hz``."""

    def __init__(self, size: int | None) -> None:
        self._window = Window(size)
        self._last: float | None = None

    def arrived(self, seconds: float) -> None:
        """Add a message by its time of reception; restart if the clock goes backwards."""
        if self._last is not None and seconds >= self._last:
            self._window.add(seconds - self._last)
        elif self._last is not None:
            self._window.clear()
        self._last = seconds

    def report(self) -> str | None:
        """Return the report of the rate; None without messages since the last report."""
        found = self._window.statistics()
        if found is None:
            return None
        rate = 1.0 / found.mean if found.mean > 0.0 else 0.0
        return f"average rate: {rate:.3f}\n{_details(found)}"


class Bandwidth:
    """Bytes received per second, for ``topic bw``."""

    def __init__(self, size: int | None) -> None:
        self._sizes = Window(size)
        self._times: deque[float] = deque(maxlen=size)

    def arrived(self, seconds: float, size: int) -> None:
        """Add a message of ``size`` bytes by its time of reception."""
        self._times.append(seconds)
        self._sizes.add(size)

    def report(self, now: float) -> str | None:
        """Return the report of the bandwidth; None without two messages or new ones."""
        if len(self._times) < 2 or now <= self._times[0]:
            return None
        found = self._sizes.statistics()
        if found is None:
            return None
        rate = found.mean * found.count / (now - self._times[0])
        return (
            f"{_bytes(rate)}/s from {found.count} messages\n"
            f"\tMessage size mean: {_bytes(found.mean)} "
            f"min: {_bytes(found.low)} max: {_bytes(found.high)}"
        )


def _details(found: Statistics) -> str:
    return (
        f"\tmin: {found.low:.3f}s max: {found.high:.3f}s "
        f"std dev: {found.deviation:.5f}s window: {found.count}"
    )


def _bytes(number: float) -> str:
    for unit, factor in (("MB", 1e6), ("KB", 1e3)):
        if number >= factor:
            return f"{number / factor:.2f} {unit}"
    return f"{number:.0f} B"
