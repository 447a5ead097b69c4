"""Between the pages, whose words come on one thread, and the robot, served by another."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from onebot_bringup.steering.arbiter import Arbiter
from onebot_bringup.steering.protocol import Drive, Release, SetLimits, Stop, Velocity

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

    def watch(self) -> None:
        """Stop the robot when its driver has fallen silent; to be called every 50 ms."""
        with self._at_once():
            self._arbiter.watch(time.monotonic())

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
