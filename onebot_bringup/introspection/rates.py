"""Measures rate and bandwidth of messages, and prints them like ``ros2 topic hz`` and ``bw``."""

import statistics
from collections import deque
from itertools import pairwise


class Arrivals:
    """The last messages of a topic: when each arrived (s, monotonic), and its size in bytes."""

    def __init__(self, number: int) -> None:
        self.messages: deque[tuple[float, int]] = deque(maxlen=number)
        self._reported = True

    def add(self, seconds: float, size: int = 0) -> None:
        """Add a message by its receive time."""
        self.messages.append((seconds, size))
        self._reported = False

    def rate(self) -> float | None:
        """Return the rate, Hz; None with fewer than two messages, or no new ones since."""
        if len(self.messages) < 2 or self._reported:
            return None
        self._reported = True
        seconds = self.messages[-1][0] - self.messages[0][0]
        return (len(self.messages) - 1) / seconds if seconds > 0.0 else 0.0

    def rate_report(self) -> str | None:
        """Return the report of ``topic hz``; None where ``rate`` has none."""
        if (rate := self.rate()) is None:
            return None
        intervals = [end - start for (start, _), (end, _) in pairwise(self.messages)]
        return (
            f"average rate: {rate:.3f}\n"
            f"\tmin: {min(intervals):.3f}s max: {max(intervals):.3f}s "
            f"std dev: {statistics.pstdev(intervals):.5f}s window: {len(intervals)}"
        )

    def bandwidth_report(self, now: float) -> str | None:
        """Return the report of ``topic bw`` at ``now``, s; None where ``rate`` has none."""
        if self.rate() is None:
            return None
        count, sizes = len(self.messages), [size for _, size in self.messages]
        return (
            f"{_bytes(sum(sizes) / (now - self.messages[0][0]))}/s from {count} messages\n"
            f"\tMessage size mean: {_bytes(sum(sizes) / count)} "
            f"min: {_bytes(min(sizes))} max: {_bytes(max(sizes))}"
        )


def _bytes(number: float) -> str:
    for unit, factor in (("MB", 1e6), ("KB", 1e3)):
        if number >= factor:
            return f"{number / factor:.2f} {unit}"
    return f"{number:.0f} B"
