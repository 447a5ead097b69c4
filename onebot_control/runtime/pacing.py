"""The due times, stamps and pace of control cycles, evenly spaced despite jitter of the thread.

``Pacer`` schedules the cycles on a monotonic clock; ``SystemStamps`` gives them stamps of the
system clock with the same spacing. ``Divider`` selects the cycles in which something happens.
``PaceMeter`` measures the real-time factor, and detects when it falls and recovers.
"""

import ctypes
import sys
import time
from collections.abc import Callable
from operator import add, itemgetter
from typing import NamedTuple

from onebot_description.timing import NS_PER_S

# Stamps follow the system clock when it has drifted this far from them, ns.
_DRIFT = 2_000_000
_COMPARISONS = 10  # comparisons of the clocks at the start; the most exact one is used
_SET_BACK = NS_PER_S  # ns; the system clock has been set if it goes back by this or more
# From Linux's <sys/prctl.h>.
_PR_SET_TIMERSLACK = 29
_SECOND = 1.0
# Fractions of the wanted factor: a second below _SLOW is slow motion, which ends after _STEADY
# seconds that all reached _BACK. Meanwhile, a line is logged every _LOG_PERIOD seconds.
_SLOW, _BACK, _STEADY, _LOG_PERIOD = 0.9, 0.95, 5, 60.0


class Pacer:
    """Schedules cycles at evenly spaced deadlines on a monotonic clock.

    Missed cycles are skipped, not caught up in a burst: the deadlines restart from the current
    time.

    Attributes:
        due: monotonic time at which the current cycle is due, s.
        lag: seconds by which the current cycle was late, if the deadlines restarted; else 0.
        missed: number of skipped cycles in that case.
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
            wait: waits until ``due``; may return early, when the loop stops, or much later, if the
                process was stopped meanwhile.
        """
        self.due = self.due + self._interval if self._interval else self._clock()
        self.lag, self.missed = 0.0, 0
        wait()
        now = self._clock()
        if 0.0 < self._interval <= now - self.due:  # the wait may have changed the pace
            self.lag, self.due = now - self.due, now
            self.missed = int(self.lag / self._interval)


class Divider:
    """Selects evenly spaced control cycles, so that something happens ``rate`` times per second."""

    def __init__(self, rate: float, cycles: float) -> None:
        """Select the first cycle.

        Args:
            rate: cycles to select per second, Hz; above ``cycles``, every cycle is selected.
            cycles: control cycles per second, Hz.
        """
        self._share = rate / cycles
        self.restart()

    def restart(self) -> None:
        """Select the next cycle."""
        self._phase = 1.0

    def due(self) -> bool:
        """Return whether this cycle is selected; call it once per cycle."""
        # The threshold is just below 1, so that rounding errors of the sum do not drop a cycle.
        picked = self._phase >= 1.0 - 1e-9
        self._phase += self._share - (1.0 if picked else 0.0)
        return picked


class SystemStamps:
    """Converts due times on the monotonic clock to stamps of the system clock.

    The stamps are spaced as evenly as the cycles. Reading the system clock in each cycle would add
    the jitter of the thread to all velocities computed from stamps. When the system clock is set or
    has drifted, the stamps follow it.

    Stamps only go back if the system clock is set back by a second or more: when it goes back by
    less, they advance at half speed until it has caught up.
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
        minimum = self._last + (due_ns - self._last_due) // 2
        if minimum - _SET_BACK < stamp:
            stamp = max(stamp, minimum)
        self._last_due, self._last = due_ns, stamp
        return stamp

    def _compare(self) -> tuple[int, int]:
        """Return the offset of the system clock from the monotonic one and its uncertainty, ns.

        On a busy machine, the thread may be preempted for a long time between two readings.
        """
        start = self._monotonic()
        system = self._system()
        end = self._monotonic()
        return system - (start + end) // 2, end - start


class Pace(NamedTuple):
    """The real-time factor and missed cycles over some seconds."""

    seconds: float = 0.0  # real time, s
    simulated: float = 0.0  # simulated time, s
    cycles: int = 0  # number of control cycles, also missed ones
    missed: int = 0  # number of missed control cycles

    @property
    def factor(self) -> float:
        """Simulated seconds per real second."""
        return self.simulated / self.seconds

    def plus(self, seconds: float, simulated: float, cycles: int, missed: int) -> "Pace":
        """Return the pace with further time and cycles."""
        return Pace(*map(add, self, (seconds, simulated, cycles, missed)))

    def __str__(self) -> str:
        return (
            f"real-time factor {self.factor:.2g} in the last {self.seconds:.0f} s, "
            f"{self.missed} of {self.cycles} control cycles missed"
        )


class PaceMeter:
    """Measures the pace of a control loop each second, and reports when it falls and recovers.

    Attributes:
        wanted: simulated seconds per real second; 0: as fast as possible.
    """

    def __init__(self, report: Callable[[Pace, bool, str], object] = lambda *_: None) -> None:
        """Prepare; call ``set`` afterwards.

        Args:
            report: called each second with its pace, whether the loop is in slow motion, and a line
                to log or "".
        """
        self._report, self._is_slow = report, False

    def set(self, due: float, wanted: float) -> None:
        """Start measuring at the cycle due at ``due`` (monotonic, s), for a wanted factor."""
        self._due, self.wanted = due, wanted
        self._second = self._minute = self._steady = Pace()

    def skip(self, due: float) -> None:
        """Ignore the time until ``due`` (monotonic, s), as simulated time was paused."""
        self._due = due

    def cycle(self, due: float, simulated: float, missed: int) -> None:
        """Count a control cycle.

        Args:
            due: time at which the next cycle is due, monotonic, s.
            simulated: simulated duration of the cycle, s.
            missed: number of missed cycles after it.
        """
        second = self._second.plus(due - self._due, simulated, 1 + missed, missed)
        self._due, self._second = due, second
        if second.seconds >= _SECOND:
            self._second = Pace()
            line = self._line(second)
            self._report(second, self._is_slow, line)

    def _line(self, second: Pace) -> str:
        """Detect the begin and end of slow motion; return a line to log, or ""."""
        is_steady = second.factor >= _BACK * self.wanted
        self._steady = self._steady.plus(*second) if is_steady else Pace()
        self._minute = self._minute.plus(*second)
        if not self._is_slow and second.factor < _SLOW * self.wanted:
            self._is_slow, self._minute = True, Pace()
            return f"slow motion: {second}"
        if self._is_slow and self._steady.seconds >= _STEADY:
            self._is_slow = False
            return f"the pace is back: {self._steady}"
        if self._is_slow and self._minute.seconds >= _LOG_PERIOD:
            minute, self._minute = self._minute, Pace()
            return f"slow motion: {minute}"
        return ""


def wake_exactly(exactly: bool = True) -> None:
    """Make waits of the calling thread end on time; by default, Linux may end them 50 us late.

    On other systems, and without permission, this has no effect.

    Args:
        exactly: False to restore the default.
    """
    if sys.platform == "linux":
        slack = ctypes.c_ulong(exactly)  # ns; 0 stands for the default
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, slack)
