"""Measures rate and bandwidth of messages, and prints them like ``ros2 topic hz`` and ``bw``."""

import statistics
from collections import deque


class Intervals:
    """The time between messages, for ``topic hz``."""

    def __init__(self, size: int) -> None:
        self._intervals: deque[float] = deque(maxlen=size)  # s
        self._last: float | None = None
        self._reported = True

    def arrived(self, seconds: float) -> None:
        """Add a message by its receive time, seconds; restart if the clock goes backwards."""
        if self._last is not None and seconds >= self._last:
            self._intervals.append(seconds - self._last)
            self._reported = False
        elif self._last is not None:
            self._intervals.clear()
        self._last = seconds

    def rate(self) -> float | None:
        """Return the rate, Hz; None without messages since the last call."""
        if self._reported or not self._intervals:
            return None
        self._reported = True
        mean = statistics.fmean(self._intervals)
        return 1.0 / mean if mean > 0.0 else 0.0

    def report(self) -> str | None:
        """Return the report of the rate; None without messages since the last report."""
        rate, samples = self.rate(), self._intervals
        if rate is None:
            return None
        return (
            f"average rate: {rate:.3f}\n"
            f"\tmin: {min(samples):.3f}s max: {max(samples):.3f}s "
            f"std dev: {statistics.pstdev(samples):.5f}s window: {len(samples)}"
        )


class Bandwidth:
    """Bytes received per second, for ``topic bw``."""

    def __init__(self, size: int) -> None:
        self._messages: deque[tuple[float, int]] = deque(maxlen=size)  # time (s) and bytes
        self._reported = True

    def arrived(self, seconds: float, size: int) -> None:
        """Add a message of ``size`` bytes by its receive time, seconds."""
        self._messages.append((seconds, size))
        self._reported = False

    def report(self, now: float) -> str | None:
        """Return the report of the bandwidth; None with fewer than two messages or no new ones."""
        count = len(self._messages)
        if count < 2 or self._reported or now <= self._messages[0][0]:
            return None
        self._reported = True
        sizes = [size for _, size in self._messages]
        return (
            f"{_bytes(sum(sizes) / (now - self._messages[0][0]))}/s from {count} messages\n"
            f"\tMessage size mean: {_bytes(sum(sizes) / count)} "
            f"min: {_bytes(min(sizes))} max: {_bytes(max(sizes))}"
        )


def _bytes(number: float) -> str:
    for unit, factor in (("MB", 1e6), ("KB", 1e3)):
        if number >= factor:
            return f"{number / factor:.2f} {unit}"
    return f"{number:.0f} B"
