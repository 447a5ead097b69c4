"""Decides which of several steering pages drives the robot, and when it is stopped.

The last page that starts to hold a control drives. `Arbiter` decides; `ThreadSafeArbiter` publishes
the commands, for a server and a node on different threads.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from onebot_bringup.steering.limits import Limits
from onebot_bringup.steering.protocol import Drive, Release, SetLimits, Stop, Velocity

COMMAND_TIMEOUT = 0.25  # s without a message from the driver until the robot is stopped
MAX_AGE = 0.5  # s since the stamp of a command, which is the round trip, until it is too late
ZEROS = 3  # zero commands after the last one, in case one gets lost


@dataclass
class _Page:
    holding: bool = False  # it holds a control: it drives, or has to release first
    moved: bool = False  # it commanded a velocity other than zero since its last release
    late: bool = False  # its commands are too old, or come no more


class Arbiter:
    """Converts the messages of pages to commands. Does not read a clock: times are arguments, in s.

    A page that lost control, for any reason, has to release before it can drive again.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits  # of commands
        self.driver: str | None = None  # the page that drives
        self.timeouts = 0  # how often a driver timed out
        self.stops = 0  # how often the stop button was pressed
        self.starts = 0  # how often a page that took control began to move the robot
        self.moving = False  # commands are published, even if their velocity is zero
        self._pages: dict[str, _Page] = {}
        self._velocity = Velocity()
        self._deadline = 0.0  # until when the driver's command holds
        self._zeros = 0

    @property
    def pages(self) -> int:
        """The number of open pages."""
        return len(self._pages)

    @property
    def command(self) -> Velocity:
        """The present command, within the limits."""
        return self.limits.clamp(self._velocity) if self.moving else Velocity()

    @property
    def busy(self) -> bool:
        """Whether commands are left to publish."""
        return self.moving or self._zeros > 0

    def join(self, page: str) -> None:
        """Add a page that was opened."""
        self._pages[page] = _Page()

    def leave(self, page: str) -> None:
        """Remove a page that was closed or lost its connection."""
        self._drop(page)
        self._pages.pop(page, None)

    def drive(self, page: str, velocity: Velocity, stamp: float, now: float) -> None:
        """Handle a held control; the first message in time after a release takes control.

        Args:
            page: its name.
            velocity: the command.
            stamp: when the server sent what the page had received last; it is older than that.
            now: the time.
        """
        known = self._pages[page]
        deadline = min(now + COMMAND_TIMEOUT, stamp + MAX_AGE)
        known.late = now > deadline
        if known.late:
            return  # what the page drove has met its own deadline before
        if not known.holding:
            known.holding = True
            if self.driver is not None:
                self._halt()  # discard the last driver's command
            self._set_driver(page)
        if self.driver == page:
            self.starts += not known.moved and velocity != Velocity()
            known.moved |= velocity != Velocity()
            self._velocity, self._deadline, self.moving, self._zeros = (
                velocity,
                deadline,
                True,
                ZEROS,
            )

    @property
    def late(self) -> frozenset[str]:
        """The pages whose connection is too slow to drive."""
        return frozenset(page for page, known in self._pages.items() if known.late)

    def release(self, page: str) -> None:
        """Handle the release of a control."""
        self._drop(page)
        self._pages[page] = _Page()

    def stop(self) -> None:
        """Stop the robot, regardless of which page drives, or whether any does."""
        self.stops += 1
        self._set_driver(None)
        self._halt()
        self._zeros = ZEROS

    def reject(self, page: str) -> None:
        """Handle an invalid message: the page loses control."""
        self._drop(page)
        self._pages[page].holding = True

    def check_timeout(self, now: float) -> None:
        """Stop the robot if its driver is silent or late; it drives on when it is in time again."""
        if self.moving and self.driver is not None and now > self._deadline:
            self._halt()
            self._pages[self.driver].late = True
            self.timeouts += 1

    def next_command(self) -> Velocity | None:
        """Return the command to publish now; None for none."""
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

    def _set_driver(self, page: str | None) -> None:
        self.driver = page
        for known in self._pages.values():  # who is late took hold before that
            known.holding |= known.late

    def _halt(self) -> None:
        self._velocity, self.moving = Velocity(), False


@dataclass(frozen=True)
class DrivingState:
    """A snapshot of the arbiter."""

    driver: str | None  # the page that drives
    pages: int  # the number of open pages
    late: frozenset[str]  # those whose connection is too slow to drive
    limits: Limits
    command: Velocity  # the present command, within the limits


class ThreadSafeArbiter:
    """An Arbiter with a lock that publishes its commands: stops and new drivers at once."""

    def __init__(
        self, limits: Limits, publish: Callable[[Velocity], None], lock: Callable[[bool], None]
    ) -> None:
        """Start without pages.

        Args:
            limits: of commands.
            publish: called with each command, from any thread, one call at a time.
            lock: called likewise, with True when a page stops the robot, and with False before the
                first velocity other than zero of a page that took control.
        """
        self._lock = threading.Lock()
        self._arbiter = Arbiter(limits)
        self._publish, self._lock_robot = publish, lock
        self.changed: Callable[[], None] = lambda: None  # called when pages need a new state

    @property
    def state(self) -> DrivingState:
        """The present state."""
        with self._lock:
            return self._state()

    def join(self, page: str) -> None:
        """Add a page that was opened."""
        with self._update():
            self._arbiter.join(page)

    def leave(self, page: str) -> bool:
        """Remove a page; if it drove, the robot stops. Return whether it did."""
        with self._update():
            drove = self._arbiter.driver == page
            self._arbiter.leave(page)
        return drove

    def handle(self, page: str, message: Drive | Release | Stop | SetLimits) -> None:
        """Handle a message of a page."""
        with self._update():
            if isinstance(message, Drive):
                self._arbiter.drive(page, message.velocity, message.stamp, time.monotonic())
            elif isinstance(message, Release):
                self._arbiter.release(page)
            elif isinstance(message, Stop):
                self._arbiter.stop()
            else:
                self._arbiter.limits = replace(self._arbiter.limits, chosen=message)

    def reject(self, page: str) -> bool:
        """Handle an invalid message; if the page drove, the robot stops. Return whether it did."""
        with self._update():
            drove = self._arbiter.driver == page
            self._arbiter.reject(page)
        return drove

    def set_limits(self, limits: Limits) -> None:
        """Set what the robot may do; what an operator chose stays."""
        with self._update():
            self._arbiter.limits = replace(limits, chosen=self._arbiter.limits.chosen)

    def check_timeout(self) -> None:
        """Stop the robot if its driver has timed out; to be called every 50 ms."""
        with self._update():
            self._arbiter.check_timeout(time.monotonic())

    def tick(self) -> None:
        """Publish the present command, if any; to be called at the fixed rate.

        Not of a driver that has timed out: after a stall, this may come before the check.
        """
        self.check_timeout()
        with self._lock:
            self._publish_next()

    def halt(self) -> None:
        """Take control from the driver and publish all zero commands, if the robot was driven."""
        with self._lock:
            driven = self._arbiter.busy
            self._arbiter.stop()
            while (velocity := self._arbiter.next_command()) is not None:
                if driven:
                    self._publish(velocity)
        self.changed()

    @property
    def timeouts(self) -> int:
        """How often a driver timed out."""
        return self._arbiter.timeouts

    @contextmanager
    def _update(self) -> Iterator[None]:
        """Lock for a change; publish at once if it matters, and notify pages of a new state."""
        with self._lock:
            before, moving = self._state(), self._arbiter.moving
            stops, starts = self._arbiter.stops, self._arbiter.starts
            yield
            after = self._state()
            if stops != self._arbiter.stops:
                self._lock_robot(True)
            elif starts != self._arbiter.starts:
                self._lock_robot(False)
            if (before.driver, moving) != (after.driver, self._arbiter.moving) or (
                stops != self._arbiter.stops
            ):
                self._publish_next()
        if (before.driver, before.pages, before.limits) != (
            after.driver,
            after.pages,
            after.limits,
        ):
            self.changed()

    def _publish_next(self) -> None:
        velocity = self._arbiter.next_command()
        if velocity is not None:
            self._publish(velocity)

    def _state(self) -> DrivingState:
        arbiter = self._arbiter
        return DrivingState(
            arbiter.driver, arbiter.pages, arbiter.late, arbiter.limits, arbiter.command
        )
