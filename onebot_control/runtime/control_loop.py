"""Runs the control cycles in a thread, which is the only one that changes the robots."""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent import futures
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.fleet import Fleet
from onebot_control.runtime.pacing import PaceMeter, Pacer, SystemStamps, wake_exactly
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Triple
from onebot_description.timing import NS_PER_S
from onebot_description.timing.wake_detector import WAKE, WakeDetector, boot_time

T = TypeVar("T")

_PATIENCE = 10.0  # s to wait for the end of the loop
_MAX_WAIT = 0.1  # s, maximum time between checks for posted functions
_PAUSED_WAIT = 0.01  # s, minimum time between messages while paused on system time
_WOKE = "Current goal cancelled: the controller was stopped meanwhile, or had no processor time."


class ControlLoop:
    """Runs the control cycles of a world's robots at a fixed pace, in its own thread.

    Other threads post functions, which the loop calls between two cycles, so no locks are needed.

    Attributes:
        fleet: the robots; other threads may read them, but not change them.
        simulated: whether stamps are simulated time; otherwise they are system time.
        paused: whether simulated time is paused.
        wake: detects when the process wakes from a stop; then robots brake and hold their joints.
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
        """Prepare; ``start`` starts the thread.

        Args:
            fleet: the robots.
            publish: called in each cycle with the robots' states and the stamp, ns, before the
                robots move.
            simulated: whether stamps are simulated time.
            meter: measures the pace.
            wake: detects when the process wakes from a stop.
            measured: waits until all measurements of a step are published.
            missing: returns what a step is still waiting for; "" for nothing.
            failed: called with the error that ends the loop.
        """
        self.fleet, self.simulated, self.paused = fleet, simulated, False
        self._publish, self._failed = publish, failed
        self._measured, self._missing = measured, missing
        self._meter, self.wake = meter or PaceMeter(), wake
        self._inbox: SimpleQueue[Callable[[], Any]] = SimpleQueue()
        self._stopped = False
        self._woke = self._started = wake.woke
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self) -> None:
        """Start with the first cycle."""
        config = self.fleet.robots[0].config
        factor, self.paused = config.real_time_factor, config.paused
        self._pacer = Pacer(self.fleet.period, factor)
        self._stamps = SystemStamps()
        self._meter.set(self._pacer.due, factor)
        self._woke = self._started = self.wake.check()  # there were no commands before
        self._thread.start()

    def stop(self) -> None:
        """End the loop after its current cycle, and wait for the end."""
        if not self._stopped:
            self._stopped = True
            self.post(lambda: None)  # wakes the loop
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def post(self, function: Callable[[], Any]) -> None:
        """Call ``function`` in the loop's thread, before the next cycle."""
        self._inbox.put(function)

    def call(self, function: Callable[[], T]) -> T:
        """Call ``function`` in the loop's thread, before the next cycle; return its result.

        Raises:
            OneBotError: the function raised it, or the loop has ended.
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
        while True:
            try:
                return answer.result(_MAX_WAIT)
            except futures.TimeoutError:
                if not (self._thread.is_alive() or answer.done()):
                    raise OneBotError("the control loop has ended") from None

    def predates_wake(self, sent: float) -> bool:
        """Return whether the process woke from a stop after a time, in ``boot_time``."""
        return sent < self.wake.certain() > self._started

    @property
    def just_woke(self) -> bool:
        """Whether messages that arrive now may predate the process's wake from a stop."""
        return self.wake.just_woke() and self.wake.woke > self._started

    @property
    def left(self) -> float:
        """Seconds of system time until the next cycle, in which a call made now takes effect."""
        return self._pacer.left

    def set_factor(self, factor: float) -> None:
        """Change the real-time factor (call it with ``post`` or ``call``)."""
        self._pacer.set(self.fleet.period, factor)
        if factor != self._meter.wanted:
            self._meter.set(self._pacer.due, factor)

    def pause(self, paused: bool) -> None:
        """Pause or resume simulated time (call it with ``call``)."""
        self.paused = paused

    def step(self, cycles: int = 1) -> None:
        """Run cycles of a paused simulation (call it with ``call``).

        When it returns, all measurements of these cycles have been published.

        Raises:
            OneBotError: the loop is not paused, was resumed or stopped meanwhile, or the wait for
                a message timed out.
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
        """Call posted functions until nothing is missing.

        Raises:
            OneBotError: something is still missing after ``step_timeout``; the text names it.
        """
        timeout = max(robot.config.step_timeout for robot in self.fleet.robots)
        deadline = time.monotonic() + timeout
        while text := self._missing():
            left = deadline - time.monotonic()
            if left <= 0.0 or self._stopped:
                raise OneBotError(f"{text} within {timeout:g} s (step_timeout)")
            self._call_next(min(left, _MAX_WAIT))

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
                if self._pacer.lag and not self.simulated:  # simulated time has lost nothing
                    for robot in self.fleet.robots:
                        robot.wait(self._pacer.lag, stalled=True)
                if paused:
                    self._meter.skip(self._pacer.due)
                else:
                    self._meter.cycle(self._pacer.due, self.fleet.period, self._pacer.missed)
        except BaseException as error:
            self._failed(error)
        finally:
            self.fleet.close()

    def _publish_paused(self) -> None:
        """Publish while paused: system time continues, and transforms must be up to date."""
        for robot in self.fleet.robots:
            robot.wait(robot.period)
        self._publish([robot.snapshot() for robot in self.fleet.robots], self.now_ns())

    def _cycle(self, stamp: int) -> None:
        snapshots = self.fleet.begin(stamp)
        self._publish(snapshots, stamp)
        self.fleet.finish()

    def _brake_if_woken(self) -> None:
        if self.wake.check() > self._woke:
            self._woke = self.wake.woke
            for robot in self.fleet.robots:
                robot.stop(_WOKE)

    def _call_posted(self) -> None:
        self._brake_if_woken()
        while not self._inbox.empty():
            self._inbox.get()()

    def _call_next(self, timeout: float) -> None:
        """Call the next posted function, for which it waits up to ``timeout`` s."""
        try:
            function = self._inbox.get(timeout=timeout)
        except Empty:
            function = None
        self._brake_if_woken()
        if function is not None:
            function()

    def _wait(self) -> None:
        """Wait until the next cycle is due, and call posted functions immediately."""
        until = time.monotonic() + (_MAX_WAIT if self.simulated else _PAUSED_WAIT)
        while not self._stopped:
            left = self._pacer.left
            if self.paused:
                left = max(left, until - time.monotonic())
            if left <= 0.0:
                return
            self._call_next(min(left, _MAX_WAIT))


class SteppedLoop(ControlLoop):
    """A control loop without a thread; its cycles are run by ``Simulation.run``."""

    def __init__(self, fleet: Fleet, publish: Callable[[Sequence[Snapshot], int], None]) -> None:
        """See ``ControlLoop``."""
        super().__init__(fleet, publish, simulated=True, wake=WakeDetector(lambda: 0.0))

    def start(self) -> None:
        """Do nothing: ``Simulation.run`` runs the cycles."""

    def post(self, function: Callable[[], object]) -> None:
        """Call ``function`` now: it is between two cycles."""
        function()

    def call(self, function: Callable[[], T]) -> T:
        """Call ``function`` now: it is between two cycles."""
        return function()

    def set_factor(self, factor: float) -> None:
        """Ignore the pace: a Simulation always runs as fast as possible."""

    def pause(self, paused: bool) -> None:
        """Reject a pause, like ``step``."""
        if paused:
            self.step()

    def step(self, cycles: int = 1) -> None:
        """Reject a step.

        Raises:
            OneBotError: always.
        """
        raise OneBotError("time only passes in Simulation.run")


class LoopSlot:
    """The place of one robot in the control loop; the threads of its nodes use the robot here.

    Attributes:
        row: index of the robot in its fleet.
        loop: the control loop; None until the descriptions of all robots are known.
        answered: stamp of the latest command, ns.
    """

    def __init__(self, row: int) -> None:
        self.row, self.answered = row, 0
        self.loop: ControlLoop | None = None

    @property
    def robot(self) -> ControlledRobot:
        """The robot, which is replaced when its description changes."""
        return self.running.fleet.robots[self.row]

    @property
    def running(self) -> ControlLoop:
        """The control loop.

        Raises:
            OneBotError: there is no loop yet.
        """
        if self.loop is None:
            raise OneBotError("there is no robot yet")
        return self.loop

    def fault(self, action: Callable[[], object]) -> str:
        """Run ``action`` in the loop's thread; return why it failed, or ""."""
        try:
            self.running.call(action)
        except OneBotError as error:
            return str(error)
        return ""

    def command(
        self,
        velocity: Triple,
        ignored: Callable[[str], object],
        *,
        stamp: int,
        given: float,
        sent: float,
    ) -> None:
        """Command the robot from the next cycle on.

        Args:
            velocity: forward, m/s, to the left, m/s, and turning to the left, rad/s.
            ignored: gets the reason if the command is ignored.
            stamp: time in its header, ns; 0 for none.
            given: time at which it was given, s, in ``boot_time``, a clock that cannot be set.
            sent: earliest possible time of sending, s, in ``boot_time``.
        """

        def accept() -> None:
            self.answered = max(self.answered, stamp)
            refused: str | None = "it was sent before this process woke from a stop"
            if sent >= self.running.wake.certain():
                linear, lateral, angular = velocity
                age = self._age(stamp, given)
                refused = self.robot.accept(linear, angular, age, lateral=lateral)
            if refused:
                ignored(refused)

        self.running.post(accept)

    def brake(self, reason: str) -> None:
        """Stop the robot, if there is one yet; goals of its joints end with this reason."""
        if self.loop is not None:
            self.loop.post(lambda: self.robot.stop(reason))

    def hold_joints(self, reason: str) -> None:
        """Hold the robot's joints, if there is one yet; their goals end with this reason."""
        if self.loop is not None:
            self.loop.post(lambda: self.robot.hold_joints(reason))

    def _age(self, stamp: int, given: float) -> float | None:
        """Return the age of a command, s, when it takes effect; None if it is unknown.

        It includes the time that the command waits in this process.
        """
        loop = self.running
        if loop.simulated:
            return (loop.now_ns() - stamp) / NS_PER_S if stamp else None
        return boot_time() - given + (loop.left if stamp else 0.0)
