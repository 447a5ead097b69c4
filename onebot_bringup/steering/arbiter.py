"""Who drives: of several pages, the last one to take hold; and nobody who does not say so."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from onebot_bringup.steering.protocol import Drive, Release, SetLimits, Stop, Velocity

DEAD_MAN = 0.25  # s without a word from the driver until the robot is stopped
GRIP = 1.0  # s without a word until the driver has to let go and take hold again
ZEROS = 3  # commands of zero that follow the last one, in case one gets lost


@dataclass
class _Page:
    holding: bool = False  # it has taken hold and not let go, whether it drives or not


class Arbiter:
    """Turns what pages say into commands. Pure: the time is always handed in, in seconds.

    A page that lost the wheel, for whatever reason, has to let go before it can take hold again.

    Attributes:
        driver: the page that drives; None if none does.
        limits: the most that is commanded.
        lapses: how often a driver fell silent while it held the wheel.
        stops: how often the stop button was pressed.
        moving: the robot is being told to move, if only at a speed of zero.
    """

    def __init__(self, limits: Velocity) -> None:
        """Start without pages."""
        self.limits = limits
        self.driver: str | None = None
        self.lapses = 0
        self.stops = 0
        self.moving = False
        self._pages: dict[str, _Page] = {}
        self._wanted = Velocity()
        self._received_at = 0.0
        self._zeros = 0

    @property
    def pages(self) -> int:
        """How many there are."""
        return len(self._pages)

    @property
    def command(self) -> Velocity:
        """What the robot is told now."""
        return self._wanted.clamped(self.limits) if self.moving else Velocity()

    @property
    def busy(self) -> bool:
        """There is something left to publish."""
        return self.moving or self._zeros > 0

    def join(self, page: str) -> None:
        """A page was opened."""
        self._pages[page] = _Page()

    def leave(self, page: str) -> None:
        """A page was closed, or its connection lost."""
        self._drop(page)
        self._pages.pop(page, None)

    def drive(self, page: str, velocity: Velocity, now: float) -> None:
        """A page holds something; the first time after letting go, it takes the wheel."""
        known = self._pages[page]
        if not known.holding:
            known.holding = True
            if self.driver is not None:
                self._halt()  # nothing of the last driver's is left over
            self.driver = page
        if self.driver == page:
            self._wanted, self._received_at, self.moving, self._zeros = velocity, now, True, ZEROS

    def release(self, page: str) -> None:
        """A page let go."""
        self._drop(page)
        self._pages[page].holding = False

    def stop(self) -> None:
        """Stop, whoever drives; also when nobody does."""
        self.stops += 1
        self.driver = None
        self._halt()
        self._zeros = ZEROS

    def refuse(self, page: str) -> None:
        """A page said what it must not: it loses the wheel."""
        self._drop(page)
        self._pages[page].holding = True

    def check(self, now: float) -> None:
        """Stop the robot when its driver has fallen silent."""
        silence = now - self._received_at
        if self.moving and silence > DEAD_MAN:
            self._halt()
            self.lapses += 1
        if self.driver is not None and silence > GRIP:
            self.driver = None

    def take(self) -> Velocity | None:
        """Return the command to publish now; None if there is nothing to say."""
        if self.moving:
            return self.command
        if self._zeros > 0:
            self._zeros -= 1
            return Velocity()
        return None

    def _drop(self, page: str) -> None:
        if self.driver == page:
            self.driver = None
            self._halt()

    def _halt(self) -> None:
        self._wanted, self.moving = Velocity(), False


# Between the pages, whose words come on one thread, and the robot, served by another.

_NO_CEILING = Velocity(math.inf, math.inf)


@dataclass(frozen=True)
class Helmsman:
    """Who drives, how many could, and what the robot is told."""

    driver: str | None
    pages: int
    limits: Velocity
    command: Velocity


class Helm:
    """An Arbiter for several threads: whatever has to happen at once, happens at once."""

    def __init__(
        self,
        limits: Velocity,
        publish: Callable[[Velocity], None],
        ceiling: Velocity = _NO_CEILING,
    ) -> None:
        """Start without pages.

        Args:
            limits: the most that is commanded.
            publish: sends a command to the robot; called from any thread, one at a time.
            ceiling: the most that the limits can be set to.
        """
        self._lock = threading.Lock()
        self._arbiter = Arbiter(limits.clamped(ceiling))
        self._publish = publish
        self._ceiling = ceiling
        self.changed: Callable[[], None] = lambda: None

    @property
    def now(self) -> Helmsman:
        """How things are."""
        with self._lock:
            return self._helmsman()

    def join(self, page: str) -> None:
        """A page was opened."""
        with self._at_once():
            self._arbiter.join(page)

    def leave(self, page: str) -> None:
        """A page was closed, or its connection lost: if it drove, the robot stops."""
        with self._at_once():
            self._arbiter.leave(page)

    def take(self, page: str, message: Drive | Release | Stop | SetLimits) -> None:
        """Do as a page says."""
        with self._at_once():
            if isinstance(message, Drive):
                self._arbiter.drive(page, message.velocity, time.monotonic())
            elif isinstance(message, Release):
                self._arbiter.release(page)
            elif isinstance(message, Stop):
                self._arbiter.stop()
            else:
                self._arbiter.limits = message.limits.clamped(self._ceiling)

    def refuse(self, page: str) -> None:
        """A page said what it must not: if it drove, the robot stops."""
        with self._at_once():
            self._arbiter.refuse(page)

    def set_limits(self, limits: Velocity) -> None:
        """Set the most that is commanded."""
        self.take("", SetLimits(limits))

    def check(self) -> None:
        """Stop the robot when its driver has fallen silent; to be called every 50 ms."""
        with self._at_once():
            self._arbiter.check(time.monotonic())

    def tick(self) -> None:
        """Send what is to be sent at the fixed rate."""
        with self._lock:
            self._send()

    def halt(self) -> None:
        """Take the wheel from whoever drives, and stop a robot that was driven, all at once."""
        with self._lock:
            driven = self._arbiter.busy
            self._arbiter.stop()
            while (velocity := self._arbiter.take()) is not None:
                if driven:
                    self._publish(velocity)
        self.changed()

    @property
    def lapses(self) -> int:
        """How often a driver fell silent while it held the wheel."""
        return self._arbiter.lapses

    @contextmanager
    def _at_once(self) -> Iterator[None]:
        """Tell the robot, and then the pages, if what is done within makes a difference."""
        with self._lock:
            before, moving = self._helmsman(), self._arbiter.moving
            asked = self._arbiter.stops
            yield
            after = self._helmsman()
            if (before.driver, moving) != (after.driver, self._arbiter.moving) or (
                asked != self._arbiter.stops
            ):
                self._send()
        if (before.driver, before.pages, before.limits) != (
            after.driver,
            after.pages,
            after.limits,
        ):
            self.changed()

    def _send(self) -> None:
        velocity = self._arbiter.take()
        if velocity is not None:
            self._publish(velocity)

    def _helmsman(self) -> Helmsman:
        arbiter = self._arbiter
        return Helmsman(arbiter.driver, arbiter.pages, arbiter.limits, arbiter.command)
