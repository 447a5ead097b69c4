"""Estimates how old a message is, and whether it was sent before this process woke from a stop.

DDS may deliver messages that waited while the process was stopped, at any time after that.
"""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

from onebot_description.ros.wire.cdr import NS_PER_S

_LONGEST_GAP = 0.5  # s between two checks; a longer one means that the process did not run
_SAME_SIGNAL = 0.25  # s within which two threads notice one SIGCONT
_STEADY_NS = NS_PER_S // 10  # transit times of one sender differ by less
# A sender's clock is known from so many messages over this time.
_SAMPLES, _SPAN_NS = 5, NS_PER_S // 2
_LONGEST_TRANSIT = 10.0  # s; assumed if no stamp shows how long a message was under way
# Unlike the monotonic clock, it includes time in which the computer is suspended.
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def boot_time() -> float:
    """Return the seconds since the computer started, by a clock that nobody can set."""
    return time.clock_gettime(_CLOCK)


class WakeDetector:
    """Detects that this process was stopped: by SIGSTOP, a suspended computer, or no CPU time.

    Attributes:
        woke: when the process last woke, by ``boot_time``; -inf if it was never stopped.
    """

    def __init__(self, clock: Callable[[], float] = boot_time) -> None:
        self._clock = clock
        self._checked = clock()
        self.woke = self._resumed = -math.inf

    def check(self) -> float:
        """Update and return ``woke``; call it several times a second, from any thread."""
        now = self._clock()
        if now - self._checked > _LONGEST_GAP:
            self.woke = now
        self._checked = now
        return self.woke

    def resumed(self) -> None:
        """Note a SIGCONT, which also follows a stop too short for ``check``."""
        now = self._clock()
        if now - self._resumed > _SAME_SIGNAL:
            self.woke = self._resumed = now


WAKE = WakeDetector()
"""The wake detector of this process; ``run_node`` notifies it of each SIGCONT."""


class Delivery(NamedTuple):
    """The times of a message, and its number, as DDS reports them."""

    source_ns: int  # time of sending, by the sender's system clock
    received_ns: int  # time of receiving, by this computer's system clock
    number: int | None  # the publisher's count of its messages; None if DDS has none


class Age(NamedTuple):
    """Bounds of a message's age, s."""

    least: float  # certain
    most: float  # possible; equal to ``least`` if the sender's clock is known


class SenderClock:
    """Learns how far the clock of a topic's sender is behind this computer's.

    It takes a steady stream of messages. Until then, a message with an old stamp may be old, or
    from a computer whose clock is wrong.
    """

    def __init__(self) -> None:
        self._behind: int | None = None  # ns; the shortest transit is part of it
        self._number = 0  # sequence number of the last message
        # A run of messages whose transit times, with the clocks' difference, are alike.
        self._least = self._most = self._since_ns = self._count = 0

    def age(self, delivery: Delivery, now_ns: int) -> Age:
        """Return how old a message is at ``now_ns`` (system time)."""
        behind = delivery.received_ns - delivery.source_ns
        self._learn(behind, delivery)
        waited = max(0, now_ns - delivery.received_ns) / NS_PER_S
        if self._behind is not None:
            age = waited + (behind - self._behind) / NS_PER_S
            return Age(age, age)
        # An own clock that was set back meanwhile, and another's that is fast, look alike.
        transit = behind / NS_PER_S if behind > -_STEADY_NS else _LONGEST_TRANSIT
        return Age(waited, waited + max(0.0, transit))

    def _learn(self, behind: int, delivery: Delivery) -> None:
        if delivery.number is not None:
            if delivery.number <= self._number:  # another publisher's
                self._behind, self._count = None, 0
            self._number = delivery.number
        least, most = min(self._least, behind), max(self._most, behind)
        if self._count == 0 or most - least > _STEADY_NS:
            least = most = behind
            self._since_ns, self._count = delivery.received_ns, 0
        self._least, self._most = least, most
        self._count += 1
        if self._count >= _SAMPLES and delivery.received_ns - self._since_ns >= _SPAN_NS:
            self._behind = least
        elif self._behind is not None and behind < self._behind:
            # By much: one of the clocks was set.
            self._behind = behind if self._behind - behind <= _STEADY_NS else None
