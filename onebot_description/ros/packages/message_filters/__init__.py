"""Filters that match messages by time, as in the package message_filters.

A filter calls the callbacks registered with it; callbacks of a synchronizer get one message of each
input.
"""

import itertools
import threading
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.time import Time


class SimpleFilter:
    """Calls callbacks with the messages that it is given."""

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., None], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., None], *args: Any) -> int:  # noqa: N802
        """Register ``cb``, to call with the output and then ``args``; return its number."""
        number = len(self.callbacks)
        self.callbacks[number] = cb, args
        return number

    def signalMessage(self, *msg: Any) -> None:  # noqa: N802
        """Call the callbacks."""
        for callback, arguments in list(self.callbacks.values()):
            callback(*msg, *arguments)


class Subscriber(SimpleFilter):
    """Passes on the messages of a topic.

    Its arguments are a node and those of its ``create_subscription``, without a callback.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__()
        self.node, _, self.topic = args[:3]
        kwargs.setdefault("qos_profile", 10)
        self.sub = self.node.create_subscription(*args[1:], self.callback, **kwargs)

    def callback(self, msg: Any) -> None:
        """Pass a message on."""
        self.signalMessage(msg)

    def getTopic(self) -> str:  # noqa: N802
        """Return the name of the topic, as it was given."""
        return str(self.topic)

    def __getattr__(self, key: str) -> Any:
        """Return an attribute of the subscription."""
        return getattr(vars(self)["sub"], key)


class Cache(SimpleFilter):
    """Keeps the last messages of a filter, in order of arrival, and passes them on.

    Args:
        f: the filter.
        cache_size: how many messages are kept.
        allow_headerless: keep messages without a stamp, at the time of their arrival.
    """

    def __init__(self, f, cache_size=1, allow_headerless=False) -> None:
        super().__init__()
        self.cache_size, self.allow_headerless = cache_size, allow_headerless
        self.cache_msgs: list[Any] = []
        self.cache_times: list[Time] = []
        self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:  # noqa: N802
        """Receive the messages of a filter."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Keep a message, and pass it on."""
        stamp = _stamp(msg, self.allow_headerless)
        if stamp is None:
            return
        self.cache_times.append(stamp)
        self.cache_msgs.append(msg)
        del self.cache_times[: -self.cache_size], self.cache_msgs[: -self.cache_size]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Time, to_stamp: Time) -> list[Any]:  # noqa: N802
        """Return the messages between two times, both inclusive."""
        assert from_stamp <= to_stamp
        return self._select(lambda stamp: from_stamp <= stamp <= to_stamp)

    def getElemAfterTime(self, stamp: Time) -> Any:  # noqa: N802
        """Return the first message that is not older than a time; None if there is none."""
        return next(iter(self._select(lambda time: time >= stamp)), None)

    def getElemBeforeTime(self, stamp: Time) -> Any:  # noqa: N802
        """Return the last message that is not newer than a time; None if there is none."""
        return next(reversed(self._select(lambda time: time <= stamp)), None)

    def getLastestTime(self) -> Time | None:  # noqa: N802
        """Return the stamp of the last message; None if there is none."""
        return self.cache_times[-1] if self.cache_times else None

    def getOldestTime(self) -> Time | None:  # noqa: N802
        """Return the stamp of the first message; None if there is none."""
        return self.cache_times[0] if self.cache_times else None

    def getLast(self) -> Any:  # noqa: N802
        """Return the first message that is not older than the last one; None if there is none."""
        return self.getElemAfterTime(self.cache_times[-1]) if self.cache_times else None

    def _select(self, is_wanted: Callable[[Time], bool]) -> list[Any]:
        pairs = zip(self.cache_msgs, self.cache_times, strict=True)
        return [message for message, stamp in pairs if is_wanted(stamp)]


class TimeSynchronizer(SimpleFilter):
    """Passes on sets of messages, one of each filter, that have the same stamp.

    Args:
        fs: the filters.
        queue_size: how many messages of each filter wait for the others.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.lock = threading.RLock()
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:  # noqa: N802
        """Receive the messages of filters; ``queues`` holds them by stamp, nanoseconds."""
        self.queues: list[dict[int, Any]] = [{} for _ in fs]
        self.input_connections = [
            signal.registerCallback(self.add, queue, index)
            for index, (signal, queue) in enumerate(zip(fs, self.queues, strict=True))
        ]

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Add a message to a queue, and pass on the sets that are complete."""
        with self.lock:
            self._enqueue(msg, my_queue, Time.from_msg(msg.header.stamp).nanoseconds)
            for stamp in sorted(set.intersection(*map(set, self.queues))):
                self._pass_on([stamp] * len(self.queues))

    def _enqueue(self, msg: Any, queue: dict[int, Any], stamp: int) -> None:
        queue[stamp] = msg
        while len(queue) > self.queue_size:
            del queue[min(queue)]

    def _pass_on(self, stamps: Sequence[int]) -> None:
        pairs = list(zip(self.queues, stamps, strict=True))
        messages = [queue[stamp] for queue, stamp in pairs]
        try:
            self.signalMessage(*messages)
        finally:
            for queue, stamp in pairs:
                queue.pop(stamp, None)


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Passes on sets of messages, one of each filter, whose stamps differ by less than ``slop``.

    Args:
        fs: the filters.
        queue_size: how many messages of each filter wait for the others.
        slop: how much the stamps may differ, s.
        allow_headerless: take messages without a stamp, at the time of their arrival.
    """

    def __init__(self, fs, queue_size, slop, allow_headerless=False) -> None:
        super().__init__(fs, queue_size)
        self.slop, self.allow_headerless = Duration(seconds=slop), allow_headerless

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Add a message to a queue, and pass on the first set that is near enough to it."""
        time = _stamp(msg, self.allow_headerless)
        if time is None:
            return
        stamp, slop = time.nanoseconds, self.slop.nanoseconds
        with self.lock:
            self._enqueue(msg, my_queue, stamp)
            candidates = []  # stamps of each queue, the nearest first
            for queue in self.queues:
                reach = 0 if queue is my_queue else slop
                near = [other for other in queue if abs(other - stamp) <= reach]
                candidates.append(sorted(near, key=lambda other: abs(other - stamp)))
            for stamps in itertools.product(*candidates):
                if max(stamps) - min(stamps) < slop:
                    self._pass_on(stamps)
                    break


def _stamp(msg: Any, allow_headerless: bool) -> Time | None:
    """Return the stamp of a message; None, with a warning, if it has none but needs it."""
    stamp = getattr(getattr(msg, "header", None), "stamp", None)
    if stamp is not None:
        return stamp if hasattr(stamp, "nanoseconds") else Time.from_msg(stamp)
    if allow_headerless:
        return ROSClock().now()
    text = f"a {type(msg).__name__} without a stamp is ignored; allow_headerless=True accepts it"
    get_logger("message_filters").warning(text)
    return None
