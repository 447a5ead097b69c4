"""Times as ROS messages have them, and as one number of nanoseconds."""

from typing import Protocol

NANO = 1_000_000_000  # nanoseconds in a second


class Stamp(Protocol):
    """A builtin_interfaces/Time."""

    sec: int
    nanosec: int


def nanoseconds(stamp: Stamp) -> int:
    """Return builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)
