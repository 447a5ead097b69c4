"""When control cycles are due, and their stamps: both evenly spaced, however the thread wakes up.

``Pacer`` schedules the cycles on a monotonic clock; ``SystemStamps`` gives them stamps of the
system clock that are as evenly spaced. ``Divider`` picks the cycles in which something happens.
"""

import ctypes
import sys
import time
from collections.abc import Callable
from operator import itemgetter

from onebot_description.timing import NS_PER_S

# Stamps follow the system clock when it has drifted this far from them, ns.
_DRIFT = 2_000_000
_COMPARISONS = 10  # comparisons of the clocks at the start; the most exact one is used
_SET_BACK = NS_PER_S  # ns; if the system clock goes back by this much or more, somebody has set it
# From Linux's <sys/prctl.h>.
_PR_SET_TIMERSLACK = 29


class Pacer:
    """Schedules cycles at evenly spaced deadlines on a monotonic clock.

    Missed cycles are left out, not caught up in a burst: the deadlines start again from now.

    Attributes:
        due: monotonic time at which the current cycle is due, s.
        lag: seconds by which the current cycle was late, if the deadlines started again; else 0.
        missed: number of cycles that were left out then.
    """

    def __init__(
        self,
        period: float,
        factor: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make the first cycle due now; ``clock`` returns monotonic seconds. See ``set``."""
        self._clock = clock
        self.due = clock()
        self.lag, self.missed = 0.0, 0
        self.set(period, factor)

    def set(self, period: float, factor: float) -> None:
        """Change the pace; the next cycle is due no later than one new period from now.

        Args:
            period: simulated duration of a cycle, s.
            factor: simulated seconds per second; 0: as fast as possible.
        """
        self._interval = period / factor if factor else 0.0
        self.due = min(self.due, self._clock() + self._interval)

    @property
    def left(self) -> float:
        """Seconds until the current cycle is due; 0 if it is."""
        return max(0.0, self.due - self._clock())

    def next(self, wait: Callable[[], object]) -> None:
        """Wait until the next cycle is due.

        Args:
            wait: waits until ``due``; it may return early, when the loop stops, or much later, if
                the process was stopped meanwhile.
        """
        self.due = self.due + self._interval if self._interval else self._clock()
        self.lag, self.missed = 0.0, 0
        wait()
        now = self._clock()
        if 0.0 < self._interval <= now - self.due:  # the wait may have changed the pace
            self.lag, self.due = now - self.due, now
            self.missed = int(self.lag / self._interval)


class Divider:
    """Picks evenly spaced control cycles, so that something happens ``rate`` times a second."""

    def __init__(self, rate: float, cycles: float) -> None:
        """Pick the first cycle.

        Args:
            rate: cycles to pick per second, Hz; above ``cycles``, every cycle is picked.
            cycles: control cycles per second, Hz.
        """
        self._share = rate / cycles
        self.restart()

    def restart(self) -> None:
        """Pick the next cycle."""
        self._phase = 1.0

    def due(self) -> bool:
        """Return whether this cycle is picked; call it once per cycle."""
        # The threshold is just below 1, so that rounding errors of the sum drop no cycle.
        picked = self._phase >= 1.0 - 1e-9
        self._phase += self._share - (1.0 if picked else 0.0)
        return picked


class SystemStamps:
    """Converts due times on the monotonic clock to stamps of the system clock.

    The stamps are as evenly spaced as the cycles. Reading the system clock in each cycle would put
    the jitter of waking up into every velocity that somebody computes from stamps. When the system
    clock is set or has drifted, the stamps follow it.

    Stamps do not go back, unless the system clock is set back by a second or more: when it goes
    back by less, they advance at half speed until it has caught up.
    """

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        system_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._monotonic, self._system = monotonic_ns, system_ns
        comparisons = [self._compare() for _ in range(_COMPARISONS)]
        self._offset, _ = min(comparisons, key=itemgetter(1))
        self._last_due = self._last = 0  # 1970, before every stamp

    def at(self, due: float) -> int:
        """Return the system time, ns, of the monotonic time ``due``, s."""
        offset, uncertainty = self._compare()
        if uncertainty <= _DRIFT < abs(offset - self._offset):
            self._offset = offset
        due_ns = round(due * NS_PER_S)
        stamp = due_ns + self._offset
        least = self._last + (due_ns - self._last_due) // 2
        if least - _SET_BACK < stamp:
            stamp = max(stamp, least)
        self._last_due, self._last = due_ns, stamp
        return stamp

    def _compare(self) -> tuple[int, int]:
        """Return how far the system clock is ahead of the monotonic one, and its uncertainty, ns.

        On a busy machine, the thread may be preempted for long between two readings.
        """
        start = self._monotonic()
        system = self._system()
        end = self._monotonic()
        return system - (start + end) // 2, end - start


def wake_exactly(exactly: bool = True) -> None:
    """Make waits of the calling thread end on time; by default, Linux may end them 50 us late.

    On other systems, and where it is not allowed, it does nothing.

    Args:
        exactly: False for the default again.
    """
    if sys.platform == "linux":
        slack = ctypes.c_ulong(exactly)  # ns; 0 stands for the default
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, slack)
