"""When the control cycles are due, and what their stamps are."""

import ctypes
import sys
import time
from collections.abc import Callable

from onebot_description.stamps import NANO

# The system clock is followed when it is this far from the cycles' own count, ns.
_DRIFT = 2_000_000
# Of Linux's <sys/prctl.h>.
_PR_SET_TIMERSLACK = 29


def wake_exactly() -> None:
    """Have the calling thread's waits end on time, not up to 50 us later as Linux's usually do.

    Elsewhere, and where it is not allowed, nothing happens.
    """
    if sys.platform == "linux":
        one_ns = ctypes.c_ulong(1)  # 0 would be the default again
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, one_ns)


class Pacer:
    """A fixed grid of deadlines on a monotonic clock.

    Cycles that were missed are left out, not caught up in a burst: the grid begins anew.

    Attributes:
        due: monotonic time of the current cycle, s.
        lag: seconds that the last cycle was late, if the grid had to begin anew; else 0.
    """

    def __init__(
        self,
        period: float,
        factor: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make the first cycle due now.

        Args:
            period: s of simulated time between cycles.
            factor: simulated seconds a second; 0 is as fast as possible.
            clock: the monotonic clock, s.
        """
        self._clock = clock
        self.due = clock()
        self.lag = 0.0
        self.set(period, factor)

    def set(self, period: float, factor: float) -> None:
        """Change period and factor (see the constructor) from the next cycle on."""
        self._interval = period / factor if factor else 0.0

    def next(self, wait: Callable[[float], object]) -> None:
        """Wait for the next cycle.

        Args:
            wait: called with the seconds to wait; it may return early, to stop.
        """
        self.due += self._interval
        self.lag = 0.0
        now = self._clock()
        late = now - self.due
        if late < 0.0:
            wait(-late)
        elif self._interval == 0.0:
            self.due = now
            wait(0.0)
        elif late >= self._interval:
            self.lag, self.due = late, now


class SystemStamps:
    """Stamps of the system clock for cycles on a monotonic one, as evenly spaced as the cycles.

    Reading the system clock in each cycle would put the jitter of waking up into every velocity
    that somebody computes from stamps. It is followed when it is set or has drifted, though.
    """

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        system_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Compare the two clocks, both in ns."""
        self._monotonic, self._system = monotonic_ns, system_ns
        self._offset = system_ns() - monotonic_ns()

    def at(self, due: float) -> int:
        """Return the system time, ns, of the monotonic time ``due``, s."""
        offset = self._system() - self._monotonic()
        if abs(offset - self._offset) > _DRIFT:
            self._offset = offset
        return round(due * NANO) + self._offset


class Divider:
    """Picks so many of the cycles a second, evenly, and never more than there are."""

    def __init__(self, rate: float, cycles: float) -> None:
        """Pick ``rate`` of ``cycles`` a second; the first one is picked."""
        self._share = min(rate / cycles, 1.0)
        self._phase = 1.0

    def due(self) -> bool:
        """Return whether this cycle is picked."""
        # A hair's breadth, so that rounding errors of the sum drop no cycle.
        picked = self._phase >= 1.0 - 1e-9
        self._phase += self._share - (1.0 if picked else 0.0)
        return picked
