"""When each joint was last published, and what follows from it: the throttle's rules."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Warn = Callable[[str, str], None]

# Longer than ROS time can count, and far enough from the end of int64 to be added to it.
_FOREVER_NS = 2**61


class PublishedTimes:
    """Decides whether a message is published, by its stamp and its joints' last publication.

    Both ways of a message, the long one and the compiled one, look at the same numbers here.

    Attributes:
        interval_ns: least time between two publications of a joint; 0 for every message.
        ignore_timestamp: publish whatever the stamp says.
        stamps: (joints,) stamp of each joint's last publication in nanoseconds; 0: never.
        newest_call: (1,) the node's clock at the last message.
    """

    def __init__(self, joints: int, interval_ns: int = 0, ignore_timestamp: bool = False) -> None:
        """Start with ``joints`` joints never published."""
        self.interval_ns = min(max(interval_ns, 0), _FOREVER_NS)
        self.ignore_timestamp = ignore_timestamp
        self.stamps: NDArray[np.int64] = np.zeros(joints, np.int64)
        self.newest_call: NDArray[np.int64] = np.zeros(1, np.int64)

    def forget(self) -> None:
        """Start afresh, after the clock was set back."""
        self.stamps[:] = 0

    def due(self, rows: NDArray[np.intp], stamp_ns: int, now_ns: int, warn: Warn) -> bool:
        """Whether a message may be published; if so, note it as published.

        Args:
            rows: the joints it moves.
            stamp_ns: its stamp.
            now_ns: the node's clock.
            warn: told why it is not, unless it is only early.
        """
        if now_ns < self.newest_call[0]:
            warn("clock", "the clock was set back; publishing the joints' transforms afresh")
            self.forget()
        self.newest_call[0] = now_ns
        if len(rows) == 0:
            return False
        if not self.ignore_timestamp:
            if stamp_ns == 0:
                warn(
                    "stamp",
                    "joint states with stamp 0 are not published: set header.stamp, or the "
                    "parameter ignore_timestamp to true",
                )
                return False
            if stamp_ns < int(self.stamps[rows].min()) + self.interval_ns:
                return False
        self.stamps[rows] = stamp_ns
        return True
