"""Estimates how old a message is.

DDS may deliver messages that waited while the process was stopped, at any later time.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from onebot_description.timing import NS_PER_S

_STEADY_NS = NS_PER_S // 10  # transit times of one sender differ by less
# A sender's clock is known after this many messages over this time.
_SAMPLES, _SPAN_NS = 5, NS_PER_S // 2
_LONGEST_TRANSIT = 10.0  # s; assumed if stamps do not show how long a message was in transit


class Delivery(NamedTuple):
    """The times and sequence number of a message, as reported by DDS."""

    source_ns: int  # time of sending, on the sender's system clock
    received_ns: int  # time of receiving, on this computer's system clock
    number: int | None  # the publisher's sequence number; None if DDS has none

    @classmethod
    def from_info(cls, info: Mapping[str, Any]) -> "Delivery":
        """Return the delivery that rclpy's info of a message describes."""
        number = info["publication_sequence_number"]
        return cls(info["source_timestamp"], info["received_timestamp"], number)


class Age(NamedTuple):
    """Bounds of a message's age, s."""

    minimum: float
    maximum: float  # equal to ``minimum`` if the sender's clock is known


class SenderClock:
    """Learns how far the clock of a topic's sender is behind this computer's.

    It needs a steady stream of messages. Until then, a message with an old stamp may be old, or
    come from a computer with a wrong clock.
    """

    def __init__(self) -> None:
        self._behind: int | None = None  # ns; the shortest transit is part of it
        self._number = 0  # sequence number of the last message
        # A run of messages with similar transit times, which include the clocks' difference.
        self._minimum = self._maximum = self._since_ns = self._count = 0

    def age(self, delivery: Delivery, now_ns: int) -> Age:
        """Return how old a message is at ``now_ns`` (system time)."""
        behind = delivery.received_ns - delivery.source_ns
        self._learn(behind, delivery)
        waited = max(0, now_ns - delivery.received_ns) / NS_PER_S
        if self._behind is not None:
            age = waited + (behind - self._behind) / NS_PER_S
            return Age(age, age)
        # Setting back this computer's clock looks the same as a sender's fast clock.
        transit = behind / NS_PER_S if behind > -_STEADY_NS else _LONGEST_TRANSIT
        return Age(waited, waited + max(0.0, transit))

    def _learn(self, behind: int, delivery: Delivery) -> None:
        if delivery.number is not None:
            if delivery.number <= self._number:  # it comes from another publisher
                self._behind, self._count = None, 0
            self._number = delivery.number
        minimum, maximum = min(self._minimum, behind), max(self._maximum, behind)
        if self._count == 0 or maximum - minimum > _STEADY_NS:
            minimum = maximum = behind
            self._since_ns, self._count = delivery.received_ns, 0
        self._minimum, self._maximum = minimum, maximum
        self._count += 1
        if self._count >= _SAMPLES and delivery.received_ns - self._since_ns >= _SPAN_NS:
            self._behind = minimum
        elif self._behind is not None and behind < self._behind:
            # A large change means that one of the clocks was set.
            self._behind = behind if self._behind - behind <= _STEADY_NS else None
