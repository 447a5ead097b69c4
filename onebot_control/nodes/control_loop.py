"""The thread that runs the control cycles, and the only one that touches the robots.

A ``Pacer`` makes the cycles due on a monotonic clock; ``SystemStamps`` gives them stamps of the
system clock that are as evenly spaced.
"""

import ctypes
import math
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent import futures
from operator import itemgetter
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from onebot_control.driven_robot import Snapshot
from onebot_control.fleet import Fleet
from onebot_control.nodes.real_time import PaceMeter
from onebot_description.errors import OneBotError
from onebot_description.ros.message_age import WAKE, WakeDetector
from onebot_description.ros.wire.cdr import NANO

T = TypeVar("T")

# The system clock is followed when it is this far from the cycles' own count, ns.
_DRIFT = 2_000_000
_COMPARISONS = 10  # comparisons of clocks at the start; the most exact one counts
_SET_BACK = NANO  # ns that the system clock goes back at least when somebody sets it
_PATIENCE = 10.0  # s for the loop to answer
_LONGEST_WAIT = 0.1  # s between looks whether anything was posted
_PAUSED_WAIT = 0.01  # s at least between messages while paused on the system's time
# Of Linux's <sys/prctl.h>.
_PR_SET_TIMERSLACK = 29


class Pacer:
    """A fixed grid of deadlines on a monotonic clock.

    Cycles that were missed are left out, not caught up in a burst: the grid begins anew.

    Attributes:
        due: monotonic time of the current cycle, s.
        lag: seconds that the last cycle was late, if the grid had to begin anew; else 0.
        missed: cycles that were left out for that.
    """

    def __init__(
        self,
        period: float,
        factor: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make the first cycle due now; see ``set``."""
        self._clock = clock
        self.due = clock()
        self.lag, self.missed = 0.0, 0
        self.set(period, factor)

    def set(self, period: float, factor: float) -> None:
        """Change the period, and the simulated seconds a second; 0 is as fast as possible.

        The next cycle is due no later than a new period from now.
        """
        self._interval = period / factor if factor else 0.0
        self.due = min(self.due, self._clock() + self._interval)

    @property
    def left(self) -> float:
        """Seconds until the current cycle is due; 0 if it is."""
        return max(0.0, self.due - self._clock())

    def next(self, wait: Callable[[float], object]) -> None:
        """Wait for the next cycle.

        ``wait`` gets the seconds; it may return early, to stop, or where the pace has changed.
        """
        self.due += self._interval
        self.lag, self.missed = 0.0, 0
        now = self._clock()
        if self._interval == 0.0:
            self.due = now
            wait(0.0)
            return
        if now < self.due:
            wait(self.due - now)
            now = self._clock()  # much later, if the process was stopped meanwhile
        if 0.0 < self._interval <= now - self.due:
            self.lag, self.due = now - self.due, now
            self.missed = int(self.lag / self._interval)


class SystemStamps:
    """Stamps of the system clock for cycles on a monotonic one, as evenly spaced as the cycles.

    Reading the system clock in each cycle would put the jitter of waking up into every velocity
    that somebody computes from stamps. It is followed when it is set or has drifted, though.

    Stamps do not go back, unless the system clock is set back by a second or more: where the system
    clock goes back by less, they advance at half speed until it has caught up.
    """

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        system_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._monotonic, self._system = monotonic_ns, system_ns
        comparisons = [self._compare() for _ in range(_COMPARISONS)]
        self._offset, _ = min(comparisons, key=itemgetter(1))
        self._last_due, self._last = 0, -(2**63)

    def at(self, due: float) -> int:
        """Return the system time, ns, of the monotonic time ``due``, s."""
        offset, uncertainty = self._compare()
        if uncertainty <= _DRIFT < abs(offset - self._offset):
            self._offset = offset
        due_ns = round(due * NANO)
        stamp = due_ns + self._offset
        least = self._last + (due_ns - self._last_due) // 2
        if least - _SET_BACK < stamp:
            stamp = max(stamp, least)
        self._last_due, self._last = due_ns, stamp
        return stamp

    def _compare(self) -> tuple[int, int]:
        """Return how far the system clock is ahead of the monotonic one, and the error's bound, ns.

        On a busy machine the thread may be off the processor for long between two readings.
        """
        start = self._monotonic()
        system = self._system()
        end = self._monotonic()
        return system - (start + end) // 2, end - start


class ControlLoop:
    """Drives the robots of a world at a fixed pace in a thread of its own.

    Other threads pass it functions to call between two cycles, so that there is nothing to lock.

    Attributes:
        fleet: the robots; for other threads to read, not to change.
        simulated: whether stamps are simulated time, else the system's.
        paused: whether simulated time is stopped.
        wake: when the process last woke from a stop; the robots brake then.
    """

    def __init__(
        self,
        fleet: Fleet,
        publish: Callable[[Sequence[Snapshot], int], None],
        *,
        simulated: bool = False,
        meter: PaceMeter | None = None,
        wake: WakeDetector = WAKE,
        measured: Callable[[], object] = lambda: None,
        missing: Callable[[], str] = lambda: "",
        failed: Callable[[BaseException], None] = lambda error: None,
    ) -> None:
        """Get ready; ``start`` starts.

        ``publish`` is called in each cycle with the robots' states and their stamp in ns, before
        the robots move on; ``failed`` with the error that ends the loop. A step waits in
        ``measured`` until all measurements are published, and until ``missing`` returns "".
        """
        self.fleet, self.simulated, self.paused = fleet, simulated, False
        self._publish, self._failed = publish, failed
        self._measured, self._missing = measured, missing
        self._meter, self.wake = meter or PaceMeter(), wake
        self._inbox: SimpleQueue[Callable[[], Any]] = SimpleQueue()
        self._stopped = False
        # Held as long as the loop runs: waiting for a lock is much cheaper than for an Event.
        self._running = threading.Lock()
        self._running.acquire()
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self) -> None:
        """Start with the first cycle."""
        config = self.fleet.robots[0].config
        factor, self.paused = config.real_time_factor, config.paused
        self._pacer = Pacer(self.fleet.period, factor)
        self._stamps = SystemStamps()
        self._meter.set(self._pacer.due, factor)
        self._woke = self.wake.check()
        self._thread.start()

    def stop(self) -> None:
        """End the loop after the cycle it is in, and wait for that."""
        if not self._stopped:
            self._stopped = True
            self._running.release()
            self.post(lambda: None)  # for what waits for the inbox
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def post(self, function: Callable[[], Any]) -> None:
        """Have ``function`` called before the next cycle."""
        self._inbox.put(function)

    def call(self, function: Callable[[], T], patience: float | None = _PATIENCE) -> T:
        """Have ``function`` called before the next cycle; return what it returns.

        ``patience``: s to wait for that; None: as long as the loop lives.

        Raises:
            OneBotError: it raised that, or the loop has ended.
        """
        answer = futures.Future[T]()

        def call() -> None:
            try:
                answer.set_result(function())
            except OneBotError as error:
                answer.set_exception(error)
            except BaseException:
                answer.set_exception(OneBotError("the control loop has failed"))
                raise

        self.post(call)
        deadline = math.inf if patience is None else time.monotonic() + patience
        while True:
            try:
                return answer.result(_LONGEST_WAIT)
            except futures.TimeoutError:
                ended = not (self._thread.is_alive() or answer.done())
                if ended or time.monotonic() > deadline:
                    raise OneBotError("the control loop does not answer") from None

    @property
    def left(self) -> float:
        """Seconds of the system's time until what is called now takes effect."""
        return self._pacer.left

    def set_factor(self, factor: float) -> None:
        """Change the real-time factor (call it by ``post`` or ``call``)."""
        self._pacer.set(self.fleet.period, factor)
        if factor != self._meter.wanted:
            self._meter.set(self._pacer.due, factor)

    def pause(self, paused: bool) -> None:
        """Stop simulated time, or let it go on (call it by ``call``)."""
        self.paused = paused

    def step(self, cycles: int = 1) -> None:
        """Do cycles although paused (call it by ``call``); their measurements are published then.

        Raises:
            OneBotError: it is not paused, it was resumed or stopped meanwhile, or what it waits for
                did not come.
        """
        if not self.paused:
            raise OneBotError("step is for a paused simulation; pause it first")
        for done in range(cycles):
            self._wait_for_missing()
            if self._stopped or not self.paused:
                raise OneBotError(f"stopped or resumed after {done} of {cycles} cycles")
            self._cycle(self.fleet.stamp if self.simulated else self._stamps.at(time.monotonic()))
            self._measured()
            self._call_posted()
        self._wait_for_missing()

    def _wait_for_missing(self) -> None:
        """Call what is posted until nothing is missing.

        Raises:
            OneBotError: something is after the ``step_timeout``; the text names it.
        """
        if not (text := self._missing()):
            return
        timeout = self.fleet.robots[0].config.step_timeout
        deadline = time.monotonic() + timeout
        while text := self._missing():
            left = deadline - time.monotonic()
            if left <= 0.0 or self._stopped:
                raise OneBotError(f"{text} within {timeout:g} s (step_timeout)")
            self._call_next(min(left, _LONGEST_WAIT))

    def now_ns(self) -> int:
        """Return the current cycle's stamp, ns."""
        if self.simulated:
            return self.fleet.stamp
        return self._stamps.at(self._pacer.due)

    def _run(self) -> None:
        try:
            wake_exactly()
            while not self._stopped:
                self._call_posted()
                paused = self.paused
                if not paused:
                    self._cycle(self.now_ns())
                elif not self.simulated:
                    self._publish_paused()
                self._pacer.next(self._wait)
                if self._pacer.lag and not self.simulated:  # else it has not passed
                    for robot in self.fleet.robots:
                        robot.controller.stalled(self._pacer.lag)
                if paused:
                    self._meter.skip(self._pacer.due)
                else:
                    self._meter.cycle(self._pacer.due, self.fleet.period, self._pacer.missed)
        except BaseException as error:
            self._failed(error)
        finally:
            self.fleet.close()

    def _publish_paused(self) -> None:
        """Publish although paused: the system's time goes on, for transforms of now, too."""
        for robot in self.fleet.robots:
            robot.controller.wait(robot.period)
        self._publish([robot.snapshot() for robot in self.fleet.robots], self.now_ns())

    def _cycle(self, stamp: int) -> None:
        snapshots = self.fleet.begin(stamp)
        self._publish(snapshots, stamp)
        self.fleet.finish()

    def _call_posted(self) -> None:
        if self.wake.check() > self._woke:
            self._woke = self.wake.woke
            for robot in self.fleet.robots:
                robot.accept(0.0, 0.0)
        while not self._inbox.empty():
            self._inbox.get()()

    def _call_next(self, timeout: float) -> None:
        """Call what was posted first, or is within ``timeout``, s."""
        try:
            function = self._inbox.get(timeout=timeout)
        except Empty:
            return
        function()

    def _wait(self, seconds: float) -> None:
        if self.paused:
            self._wait_paused(_LONGEST_WAIT if self.simulated else max(seconds, _PAUSED_WAIT))
            return
        while seconds > _LONGEST_WAIT and not self._stopped:
            self._sleep(_LONGEST_WAIT)
            self._call_posted()
            seconds = self._pacer.left
        self._sleep(seconds)

    def _wait_paused(self, seconds: float) -> None:
        """Wait, and call at once what is posted: a step takes no longer than its cycle."""
        end = time.monotonic() + seconds
        while self.paused and not self._stopped and (left := end - time.monotonic()) > 0.0:
            self._call_next(left)
        if not self.paused:
            self._sleep(self._pacer.left)

    def _sleep(self, seconds: float) -> None:
        if self._running.acquire(timeout=seconds):
            self._running.release()


def wake_exactly() -> None:
    """Have the calling thread's waits end on time, not up to 50 us later as Linux's usually do.

    Elsewhere, and where it is not allowed, nothing happens.
    """
    if sys.platform == "linux":
        one_ns = ctypes.c_ulong(1)  # 0 would be the default again
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, one_ns)
