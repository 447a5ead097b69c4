"""The thread that runs the control cycles, and the only one that touches the robot."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, TypeVar

from onebot_control.drive import Drive, Snapshot
from onebot_control.pacing import Pacer, SystemStamps, wake_exactly
from onebot_description.errors import OneBotError
from onebot_description.stamps import NANO

T = TypeVar("T")
_PATIENCE = 10.0  # s for the loop to answer
_PAUSED_WAIT = 0.01  # s between looks at the inbox where nothing else sets a pace


class ControlLoop:
    """Drives a robot at a fixed pace in a thread of its own.

    Others hand it functions to call between two cycles, so that there is nothing to lock.

    Attributes:
        drive: the robot; for other threads to read, not to change.
        simulated: whether stamps are simulated time, else the system's.
        paused: whether simulated time stands still.
    """

    def __init__(
        self,
        drive: Drive,
        publish: Callable[[Snapshot, int], None],
        *,
        simulated: bool = False,
        late: Callable[[float], None] = lambda lag: None,
        failed: Callable[[BaseException], None] = lambda error: None,
    ) -> None:
        """Get ready; ``start`` starts.

        Args:
            drive: the robot.
            publish: called in each cycle with the robot's state and its stamp in ns, before the
                robot moves on.
            simulated: whether stamps are simulated time.
            late: called with the seconds that cycles were left out for.
            failed: called with what ended the loop, if it was not ``stop``.
        """
        self.drive, self.simulated, self.paused = drive, simulated, False
        self._publish, self._late, self._failed = publish, late, failed
        self._inbox: SimpleQueue[Callable[[], Any]] = SimpleQueue()
        self._stopped = False
        # Held as long as the loop runs. To wait for it is one call, and so much cheaper than
        # waiting for an Event, most of all with the processor's caches cold, as they are then.
        self._running = threading.Lock()
        self._running.acquire()
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self) -> None:
        """Start with the first cycle."""
        config = self.drive.config
        self._pacer = Pacer(1.0 / config.update_rate, config.real_time_factor)
        self._stamps = SystemStamps()
        self._thread.start()

    def stop(self) -> None:
        """End the loop after the cycle it is in, and wait for that."""
        if not self._stopped:
            self._stopped = True
            self._running.release()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def post(self, function: Callable[[], Any]) -> None:
        """Have ``function`` called before the next cycle."""
        self._inbox.put(function)

    def call(self, function: Callable[[], T]) -> T:
        """Have ``function`` called before the next cycle; return what it returns.

        Raises:
            OneBotError: it raised that, or the loop has ended.
        """
        done = threading.Event()
        result: list[T] = []
        refused: list[OneBotError] = []

        def job() -> None:
            try:
                result.append(function())
            except OneBotError as error:
                refused.append(error)
            finally:
                done.set()

        self.post(job)
        if not done.wait(_PATIENCE):
            raise OneBotError("the control loop does not answer")
        if refused:
            raise refused[0]
        if not result:
            raise OneBotError("the control loop has failed")
        return result[0]

    def use(self, drive: Drive) -> None:
        """Go on with another robot (call it by ``post`` or ``call``)."""
        self.drive.plant.close()
        self.drive = drive

    def set_factor(self, factor: float) -> None:
        """Change the real-time factor (call it by ``post`` or ``call``)."""
        self._pacer.set(self.drive.period, factor)

    def step(self) -> None:
        """Do one cycle although paused (call it by ``call``)."""
        if not self.paused:
            raise OneBotError("step is for a paused simulation; pause it first")
        self._cycle(self.now_ns())

    def now_ns(self) -> int:
        """Return the current cycle's stamp, ns."""
        if self.simulated:
            # One period ahead, because a stamp of 0 means "not known" in ROS.
            return round((self.drive.ticks + 1) * NANO / self.drive.config.update_rate)
        return self._stamps.at(self._pacer.due)

    def _run(self) -> None:
        try:
            wake_exactly()
            while not self._stopped:
                self._do_jobs()
                if not self.paused:
                    self._cycle(self.now_ns())
                elif not self.simulated:
                    # Time goes on and whoever listens needs transforms of now.
                    self._publish(self.drive.snapshot(), self.now_ns())
                self._pacer.next(self._wait)
                if self._pacer.lag:
                    self._late(self._pacer.lag)
        except BaseException as error:
            self._failed(error)
        finally:
            self.drive.plant.close()

    def _cycle(self, stamp: int) -> None:
        snapshot = self.drive.begin()
        self._publish(snapshot, stamp)
        self.drive.finish()

    def _do_jobs(self) -> None:
        while not self._inbox.empty():
            self._inbox.get()()

    def _wait(self, seconds: float) -> None:
        if self.paused:
            seconds = max(seconds, _PAUSED_WAIT)
        if self._running.acquire(timeout=seconds):
            self._running.release()
