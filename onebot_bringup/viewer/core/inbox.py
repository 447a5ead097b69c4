"""The inbox: queues messages until they are decoded in batches and passed to the displays.

A message is shown at the time of its stamp (``Stamps``). If more messages arrive than can be drawn,
old ones are dropped; if they build on each other, only when their queue is very large.
"""

import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Generic, TypeAlias, TypeVar

from onebot_description.ros.wire.cdr import SYSTEM_TIME_NS, nanoseconds
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, known_schema
from onebot_description.ros.wire.schema import Schema

T = TypeVar("T")

_MAX_BYTES = 64_000_000  # bound of a limited queue
OTHER_CLOCK_NS = 10_000_000_000  # times further apart than this come from different clocks
WARN_AFTER = 3.0  # seconds before a missing link, frame or transform is reported
_TF = "tf2_msgs/msg/TFMessage"


# --- messages and topics ------------------------------------------------------------------------


@dataclass(frozen=True)
class MessageType(Generic[T]):
    """A message type, and how its messages are decoded."""

    name: str  # full name, such as "nav_msgs/msg/Odometry"
    # Decodes a message, or raises one of BAD_MESSAGE. Displays that use the same object share its
    # results.
    read: Callable[[bytes], T]
    stamp_ns: Callable[[T], int]  # returns the header's stamp, nanoseconds; 0 for none


@lru_cache(maxsize=256)
def message_type(name: str, definition: str) -> "MessageType[Any]":
    """Return a message type whose messages are decoded by its definition; see ``Schema``.

    Args:
        name: the type's name, such as "nav_msgs/msg/Odometry".
        definition: the text of its definition, with the definitions of the types in it.

    Raises:
        ValueError: the definition cannot be read.
    """
    return _read_by(name, Schema.from_definition(name, definition))


def known_type(name: str) -> "MessageType[Any]":
    """Return a message type with our own copy of its definition, whatever is installed."""
    return _read_by(name, known_schema(name))


def _read_by(name: str, schema: Schema) -> "MessageType[Any]":
    """Return a type whose messages have the stamp of their header, their own, or none."""
    fields = schema.numeric_fields()
    if "header.stamp.nanosec" in fields:
        return MessageType(name, schema.read, lambda message: nanoseconds(message.header.stamp))
    if "stamp.nanosec" in fields:
        return MessageType(name, schema.read, lambda message: nanoseconds(message.stamp))
    return MessageType(name, schema.read, lambda _: 0)


DESCRIPTION: MessageType[str] = MessageType(
    "std_msgs/msg/String",
    lambda data: str(known_schema("std_msgs/msg/String").read(data).data),
    lambda _: 0,
)


@dataclass(frozen=True)
class WantedTopic:
    """A topic to subscribe to, and how."""

    name: str  # relative, so that the robot's namespace applies, or absolute
    types: tuple[MessageType[Any], ...]  # accepted types
    reliable: bool = False  # False: best effort, which matches every publisher
    latched: bool = False  # durability transient_local, which implies reliable
    optional: bool = False  # subscribe once it is published, unless another type of it is shown
    as_published: bool = False  # reliable if all publishers are, which large messages need
    depth: int = 100  # messages queued in DDS; for latched topics also the number of publishers
    # Stamps are close to the sending time; False for types such as maps and plans, which are often
    # latched: a late subscriber gets them long after their stamp.
    stamped_when_sent: bool = True
    # False for types such as map updates and markers, which change what earlier messages have
    # shown: none may be dropped.
    replaces_previous: bool = True

    def merged(self, other: "WantedTopic | None") -> "WantedTopic":
        """Return one subscription for two displays, with the types that both accept.

        Raises:
            ValueError: they have no type in common.
        """
        if other is None:
            return self
        names = [kind.name for kind in self.types]
        common_types = tuple(kind for kind in other.types if kind.name in names)
        if not common_types:
            raise ValueError(
                f'the view\'s topic "{self.name}" cannot be subscribed as {" or ".join(names)}: '
                f"another display already reads it as {other.types[0].name}"
            )
        return WantedTopic(
            self.name,
            common_types,
            reliable=self.reliable or other.reliable,
            latched=self.latched or other.latched,
            optional=self.optional and other.optional,
            as_published=self.as_published or other.as_published,
            depth=max(self.depth, other.depth),
            stamped_when_sent=self.stamped_when_sent and other.stamped_when_sent,
            replaces_previous=self.replaces_previous and other.replaces_previous,
        )


# --- queues ---------------------------------------------------------------------------------------


class Receiver:
    """The base class of objects that messages are passed to: of displays."""

    limited = False  # old messages are dropped if too many arrive
    dropped = False  # whether that has happened
    size = 0  # bytes of the messages since they were last drawn

    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]) -> None:
        """Add messages.

        Args:
            topic: the name of their topic in its subscription.
            kind: one of the topic's types.
            messages: the time of each, nanoseconds (its stamp, or without one its receive time),
                and the result of ``kind.read``.
        """


# A topic's full name, its receiver (None for a description), and how to subscribe.
Subscription: TypeAlias = tuple[str, Receiver | None, WantedTopic]


class Inbox:
    """Queues messages until the displays that receive them are due."""

    def __init__(self, report: Callable[[str, Exception], object]) -> None:
        """Start empty; ``report`` is called with the topic and the error of a bad message."""
        self.topics: Mapping[str, WantedTopic] = {}  # subscriptions by full topic names
        self.stamps = Stamps()
        self.report = report
        self._queues: dict[tuple[str, str], _Queue] = {}

    def subscribe(self, subscriptions: Iterable[Subscription]) -> list[str]:
        """Make a queue for each topic and type; messages already queued for them are kept.

        Returns:
            One sentence per topic that cannot be subscribed.
        """
        queues: dict[tuple[str, str], _Queue] = {}
        topics: dict[str, WantedTopic] = {}
        problems = []
        for name, receiver, topic in subscriptions:
            try:
                topics[name] = replace(topic, name=name).merged(topics.get(name))
            except ValueError as error:
                if not topic.optional:
                    problems.append(str(error))
                continue
            for kind in topic.types:
                queue = queues.setdefault((name, kind.name), _Queue())
                # A display may have several items on one topic.
                if receiver is not None and (receiver, topic.name, kind) not in queue.receivers:
                    queue.receivers.append((receiver, topic.name, kind))
        for key, queue in queues.items():
            waiting = self._queues[key].waiting if key in self._queues else ()
            topic = topics[key[0]]
            if all(receiver.limited for receiver, *_ in queue.receivers):
                queue.max_size = _MAX_BYTES
                queue.max_count = topic.depth if topic.replaces_previous else math.inf
            for data, time_ns in waiting:
                queue.append(data, time_ns)
        self._queues, self.topics = queues, topics
        return problems

    def wants(self, topic: str, type_name: str) -> bool:
        """Whether any display receives messages of this topic (its full name) and type."""
        return (topic, type_name) in self._queues

    def take(self, topic: str, type_name: str, data: bytes, time_ns: int) -> None:
        """Queue a message, unless no display wants it.

        Args:
            topic: its full name.
            type_name: its type's full name, such as "nav_msgs/msg/Odometry".
            data: the serialized message.
            time_ns: when it was received, nanoseconds.
        """
        queue = self._queues.get((topic, type_name))
        if queue is not None:
            queue.append(data, time_ns)

    def deliver(self, receivers: Collection[Receiver]) -> None:
        """Decode the messages queued for these receivers, and pass them on."""
        due = set(receivers)
        for (topic, _), queue in self._queues.items():
            if not queue.waiting or due.isdisjoint(receiver for receiver, *_ in queue.receivers):
                continue
            messages = queue.empty()
            size = sum(len(data) for data, _ in messages)
            decoded: dict[MessageType[Any], Sequence[tuple[int, Any]]] = {}
            for receiver, name, kind in queue.receivers:
                if kind not in decoded:
                    decoded[kind] = self._decoded(topic, kind, messages)
                receiver.size += size
                receiver.add(name, kind, decoded[kind])

    def descriptions(self, topic: str) -> Sequence[tuple[int, str]]:
        """Remove and return the descriptions queued for a topic, with their times."""
        return self._decoded(topic, DESCRIPTION, self._queues[topic, DESCRIPTION.name].empty())

    def _decoded(
        self, topic: str, kind: MessageType[Any], messages: Iterable[tuple[bytes, int]]
    ) -> list[tuple[int, Any]]:
        decoded = []
        for data, received_ns in messages:
            try:
                message = kind.read(data)
            except BAD_MESSAGE as error:
                self.report(topic, error)
                continue
            stamp_ns = kind.stamp_ns(message)
            time_ns = self.stamps.display_time(stamp_ns, received_ns, self.topics[topic])
            decoded.append((time_ns, message))
        return decoded


@dataclass
class _Queue:
    """The queued messages of one topic and type, and who receives them."""

    # A receiver, its name for the topic, and the type that decodes its messages.
    receivers: list[tuple[Receiver, str, MessageType[Any]]] = field(default_factory=list)
    waiting: deque[tuple[bytes, int]] = field(default_factory=deque)  # messages and receive times
    size: int = 0  # bytes of the waiting messages
    max_count: float = math.inf  # the oldest are dropped if more wait
    max_size: float = math.inf

    def append(self, data: bytes, time_ns: int) -> None:
        """Add a message; it is kept, however large it is."""
        self.waiting.append((data, time_ns))
        self.size += len(data)
        while len(self.waiting) > 1 and self._is_full:
            self.size -= len(self.waiting.popleft()[0])
            for receiver, *_ in self.receivers:
                receiver.dropped = True

    @property
    def _is_full(self) -> bool:
        return len(self.waiting) > self.max_count or self.size > self.max_size

    def empty(self) -> list[tuple[bytes, int]]:
        """Remove and return the messages."""
        messages = [*self.waiting]
        self.waiting.clear()
        self.size = 0
        return messages


# --- stamps ---------------------------------------------------------------------------------------


class Stamps:
    """Chooses the time at which a message is shown: its stamp, or without one the receive time.

    The receive time is shifted to simulated time if the stamps of /tf (before any /tf: of other
    topics) differ from it by more than 10 s. Messages from the future also get the receive time: a
    message stamped years ahead would pin the viewer to that time.
    """

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}  # warnings of a wrong clock, by topic
        self._shift = 0  # ns, from receive times to stamps
        self._has_tf = False
        self._other_since: dict[str, int] = {}  # ns, by the topics whose clock differs

    def display_time(self, stamp_ns: int, time_ns: int, topic: WantedTopic | None = None) -> int:
        """Return the time at which to show a message, nanoseconds.

        Args:
            stamp_ns: its stamp, nanoseconds; 0 for none.
            time_ns: when it was received, nanoseconds.
            topic: its topic, with the full name.
        """
        if SYSTEM_TIME_NS < time_ns < stamp_ns - OTHER_CLOCK_NS:
            ahead = f"{(stamp_ns - time_ns) * 1e-9:.0f} s ahead of their receive time"
            self.warnings.setdefault("", f"stamps {ahead} are ignored: is a clock wrong?")
            stamp_ns = 0
        if not stamp_ns:
            return time_ns + self._shift
        if topic is not None and topic.stamped_when_sent:
            self._compare(stamp_ns - time_ns, time_ns, topic)
        return stamp_ns

    def _compare(self, shift: int, time_ns: int, wanted: WantedTopic) -> None:
        """Set the shift, or compare a topic's shift with it and warn if they differ."""
        topic, is_tf = wanted.name, wanted.types[0].name == _TF
        if is_tf or not self._has_tf:
            self._has_tf = is_tf
            self._shift = shift if abs(shift) > OTHER_CLOCK_NS else 0
        elif abs(shift - self._shift) <= OTHER_CLOCK_NS:
            self._other_since.pop(topic, None)
        elif time_ns - self._other_since.setdefault(topic, time_ns) > WARN_AFTER * 1e9:
            self.warnings[topic] = (
                f"the stamps of {topic} are {shift * 1e-9:.0f} s from their receive time, "
                f"those of /tf {self._shift * 1e-9:.0f} s: is a clock wrong?"
            )
