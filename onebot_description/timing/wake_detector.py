"""Detects that this process woke from a stop: robots brake, and earlier input is outdated."""

import math
import sys
import time
from collections.abc import Callable

_LONGEST_GAP = 0.5  # s between two checks; a longer one means that the process did not run
# A shorter gap may be a stop or an overloaded computer. SIGCONT distinguishes them, but other
# threads may run before the one that handles it.
_DOUBTFUL_GAP, _SIGNAL_DELAY = 0.15, 0.05  # s
_SAME_SIGNAL = 0.25  # s within which two threads notice one SIGCONT
_QUEUED = 0.25  # s after waking during which earlier messages or key presses still arrive
_POLL = 0.001  # s


def boot_time() -> float:
    """Return the seconds since the computer started, on a clock that cannot be set."""
    if sys.platform == "linux":
        # Unlike the monotonic clock, it includes time in which the computer is suspended.
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


class WakeDetector:
    """Detects that this process was stopped: by SIGSTOP, a suspended computer, or no CPU time.

    Attributes:
        woke: when the process last woke, by ``boot_time``; -inf if it was never stopped.
    """

    def __init__(self, clock: Callable[[], float] = boot_time) -> None:
        self._clock = clock
        self._checked = clock()
        self.woke = self._resumed = self._doubt_began = self._doubt_ends = -math.inf

    def check(self) -> float:
        """Update and return ``woke``; call it several times a second, from any thread."""
        now = self._clock()
        gap = now - self._checked
        if gap > _LONGEST_GAP:
            self.woke = now
        elif gap > _DOUBTFUL_GAP:
            self._doubt_began, self._doubt_ends = self._checked, now + _SIGNAL_DELAY
        self._checked = now
        return self.woke

    def certain(self) -> float:
        """Return ``woke`` as ``check``, but wait a moment if a SIGCONT may be about to be handled.

        Call it to decide about a message, which may be handled before an earlier signal.
        """
        self.check()
        while self._clock() < self._doubt_ends and self.woke < self._doubt_began:
            time.sleep(_POLL)
        return self.woke

    def just_woke(self) -> bool:
        """Return whether input that arrives now may have been sent before the process woke."""
        return self.certain() > self._clock() - _QUEUED

    def resumed(self) -> None:
        """Note a SIGCONT, which also follows a stop too short for ``check``."""
        now = self._clock()
        if now - self._resumed > _SAME_SIGNAL:
            self.woke = self._resumed = now


WAKE = WakeDetector()
"""The wake detector of this process; ``run_node`` notifies it of each SIGCONT."""
