"""Decides which of several steering pages drives the robot, and when it is stopped.

The last page to start holding a control drives. A page that lost control, for any reason, has to
release before it can drive again. A lowered limit applies at once, a raised limit from the driver's
next press on.
"""

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from onebot_bringup.steering.command_limits import Limits
from onebot_bringup.steering.protocol import Command, DriveMessage, Parts, Release, SetLimits, Stop
from onebot_description.timing.wake_detector import boot_time

COMMAND_TIMEOUT = 0.25  # s without a message from the driver after which the robot is stopped
MAX_AGE = 0.5  # s since a command's stamp (the round trip) after which it is rejected
# Minimum duration of a press, s: its release may arrive with it, and a controller takes only the
# last of several commands within one cycle.
STEP = 0.05
ZEROS = 3  # zero commands published after the last command, in case one gets lost


@dataclass
class _Page:
    holding: bool = False  # holds a control: it drives, or has to release first
    moved: Parts = Parts.NONE  # parts that it has commanded to move since its last release
    late: bool = False  # its commands are too old, or have stopped


@dataclass(frozen=True)
class ArbiterState:
    """A snapshot of the arbiter's state."""

    driver: str | None  # the page that drives
    pages: int  # the number of open pages
    late: frozenset[str]  # the pages whose connection is too slow to drive
    limits: Limits
    command: Command  # the current command, within the limits


class Arbiter:
    """Turns the messages of pages into commands; publishes stops and new drivers at once.

    A server and a node may call it from different threads.

    Attributes:
        timeouts: how often a silent or late driver was stopped.
    """

    def __init__(
        self,
        limits: Limits,
        publish: Callable[[Command], None],
        lock: Callable[[bool, Parts], None],
        clock: Callable[[], float] = boot_time,
        woke: Callable[[], float] = lambda: -math.inf,
    ) -> None:
        """Start without pages.

        Args:
            limits: the limits of commands.
            publish: called with each command, from any thread, one call at a time.
            lock: called likewise: with True and all parts when a page stops the robot, and with
                False and the parts that are about to move, before their first motion after a page
                has taken control.
            clock: returns the time, s; the stamps of commands are times of this clock.
            woke: returns when this process last woke from a stop, by that clock; commands sent
                before that do not drive.
        """
        self._publish, self._lock_robot, self._clock, self._woke = publish, lock, clock, woke
        self._lock = threading.Lock()
        self.timeouts = 0
        self._limits = limits
        self._pages: dict[str, _Page] = {}
        self._driver: str | None = None
        self._latest = Command()  # the driver's command, not clamped
        self._moving = False  # whether commands are published, even if they are zero
        self._granted = limits.range  # the range at the driver's press, or lower
        self._stamp = 0.0  # stamp of the driver's command
        self._deadline = 0.0  # until when that command applies
        self._step_end = 0.0  # until when it applies although its page has released
        self._zeros = 0  # zero commands left to publish
        self._stops = 0  # presses of the stop button so far

    @property
    def state(self) -> ArbiterState:
        with self._lock:
            late = frozenset(name for name, page in self._pages.items() if page.late)
            return ArbiterState(self._driver, len(self._pages), late, self._limits, self._command())

    def join(self, page: str) -> None:
        with self._update():
            self._pages[page] = _Page()

    def leave(self, page: str) -> bool:
        """Remove a page; if it drove, stop the robot. Return whether it drove."""
        with self._update():
            drove = self._drop(page)
            self._pages.pop(page, None)
        return drove

    def handle(self, page: str, message: DriveMessage | Release | Stop | SetLimits) -> None:
        with self._update():
            if isinstance(message, DriveMessage):
                self._drive(page, message)
            elif isinstance(message, Release):
                if self._driver == page and self._clock() < self._step_end:
                    self._driver, self._deadline = None, self._step_end
                self._drop(page)
                self._pages[page] = _Page()
            elif isinstance(message, Stop):
                self._stops += 1
                self._take_control()
                self._lock_robot(True, Parts.ALL)
            else:
                self._limits = replace(self._limits, chosen=message)

    def reject(self, page: str) -> bool:
        """Handle an invalid message; if the page drove, stop the robot. Return whether it drove."""
        with self._update():
            drove = self._drop(page)
            self._pages[page].holding = True
        return drove

    def set_limits(self, limits: Limits) -> None:
        """Set the robot's limits; the limits that an operator chose stay."""
        with self._update():
            self._limits = replace(limits, chosen=self._limits.chosen)

    def check_timeout(self) -> None:
        """Stop the robot if its driver is silent or late; call this every 50 ms.

        The driver continues when its commands are in time again.
        """
        with self._update():
            # Call ``woke`` even while nobody drives: it notices a stop by gaps between its calls.
            is_late = self._stamp < self._woke() or self._clock() > self._deadline
            if self._moving and is_late:
                self._end_command()
                if self._driver is not None:
                    self._pages[self._driver].late = True
                    self.timeouts += 1

    def tick(self) -> None:
        """Publish the current command, if any; call this at the fixed rate."""
        self.check_timeout()  # after a stall, this may run before the timer's check
        with self._lock:
            self._publish_next()

    def halt(self) -> None:
        """Take control from the driver, and publish all zero commands if the robot was driven."""
        with self._lock:
            driven = self._moving or self._zeros > 0
            self._take_control()
            while driven and self._zeros:
                self._publish_next()
            self._zeros = 0

    def _drive(self, page: str, message: DriveMessage) -> None:
        """Handle a held control; the first timely message after a release takes control."""
        sender, now = self._pages[page], self._clock()
        # The stamp is from the server, so the page sent the message after it.
        deadline = min(now + COMMAND_TIMEOUT, message.stamp + MAX_AGE)
        sender.late = now > deadline or message.stamp < self._woke()
        if sender.late:
            return  # its previous command has its own deadline
        if not sender.holding:
            sender.holding = True
            self._set_driver(page)
            self._granted = self._limits.range
            self._step_end = now + STEP
        if self._driver != page:
            return
        if moving := message.command.parts & ~sender.moved:
            sender.moved |= moving
            self._lock_robot(False, moving)
        self._latest, self._stamp, self._deadline = message.command, message.stamp, deadline
        self._moving, self._zeros = True, ZEROS

    def _drop(self, page: str) -> bool:
        """Take control from a page; return whether it had it."""
        drove = self._driver == page
        if drove:
            self._driver = None
            self._end_command()
        return drove

    def _take_control(self) -> None:
        self._set_driver(None)
        self._end_command()
        self._zeros = ZEROS

    def _set_driver(self, page: str | None) -> None:
        self._driver = page
        for connected_page in self._pages.values():  # presses of late pages came earlier
            connected_page.holding |= connected_page.late

    def _end_command(self) -> None:
        self._latest, self._moving = Command(), False

    @contextmanager
    def _update(self) -> Iterator[None]:
        """Publish the effect of a change at once."""
        with self._lock:
            acts = self._driver, self._moving, self._stops
            yield
            self._granted = self._granted.within(self._limits.range)
            if acts != (self._driver, self._moving, self._stops):
                self._publish_next()

    def _publish_next(self) -> None:
        if self._moving:
            self._publish(self._command())
        elif self._zeros > 0:
            self._zeros -= 1
            self._publish(Command())

    def _command(self) -> Command:
        latest = self._latest
        return replace(latest, velocity=self._granted.clamp(latest.velocity))
