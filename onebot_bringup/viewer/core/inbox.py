"""The inbox: queues messages until they are decoded in batches and passed to the displays.

A message is shown at the time of its stamp (``Stamps``). If more messages arrive than can be drawn,
old ones are dropped (``LoadLimit``), or if they build on each other, they are drawn less often.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from onebot_description.ros.wire.cdr import SYSTEM_TIME_NS, nanoseconds
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, known_schema
from onebot_description.ros.wire.schema import Schema

T = TypeVar("T")

_MAX_BYTES = 64_000_000  # a queue's, if its messages build on each other
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
    # Stamps are close to the sending time; False for types such as maps and plans, which are often
    # latched: a late subscriber gets them long after their stamp.
    stamped_when_sent: bool = True
    # False for types such as map updates and markers, which change what earlier messages have
    # shown: none may be dropped.
    replaces_previous: bool = True


@lru_cache(maxsize=256)
def message_type(
    name: str, definition: str, *, stamped_when_sent: bool = True, replaces_previous: bool = True
) -> "MessageType[Any]":
    """Return a message type whose messages are decoded by its definition; see ``Schema``.

    Args:
        name: the type's name, such as "nav_msgs/msg/Odometry".
        definition: the text of its definition, with the definitions of the types in it.
        stamped_when_sent: see ``MessageType``.
        replaces_previous: see ``MessageType``.

    Raises:
        ValueError: the definition cannot be read.
    """
    kind = _read_by(name, Schema.from_definition(name, definition))
    return replace(kind, stamped_when_sent=stamped_when_sent, replaces_previous=replaces_previous)


def known_type(name: str) -> "MessageType[Any]":
    """Return a message type with our own copy of its definition, whatever is installed."""
    return _read_by(name, known_schema(name))


def _read_by(name: str, schema: Schema) -> "MessageType[Any]":
    return MessageType(name, schema.read, _stamp_of(schema))


def _stamp_of(schema: Schema) -> Callable[[Any], int]:
    """Return a function that reads a message's stamp: its header's, or its own."""
    fields = schema.numeric_fields()
    if "header.stamp.nanosec" in fields:
        return lambda message: nanoseconds(message.header.stamp)
    if "stamp.nanosec" in fields:
        return lambda message: nanoseconds(message.stamp)
    return lambda message: 0


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
        )


# --- queues ---------------------------------------------------------------------------------------


class Receiver(Protocol):
    """An object that messages are passed to: a display."""

    limit: "LoadLimit | None"  # drops messages if too many arrive

    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[tuple[int, Any]]) -> None:
        """Add messages of a topic, as it is called in its subscription, each with its time."""


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
        for (name, kind_name), queue in queues.items():
            limits = [receiver.limit for receiver, *_ in queue.receivers]
            if all(limits):
                queue.limits = [limit for limit in limits if limit]
            if all(kind.replaces_previous for *_, kind in queue.receivers):
                queue.max_count = topics[name].depth
            previous_queue = self._queues.get((name, kind_name))
            if previous_queue is not None:
                for data, time_ns in zip(*previous_queue.empty(), strict=True):
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
            if not queue.messages or due.isdisjoint(receiver for receiver, *_ in queue.receivers):
                continue
            messages, times = queue.empty()
            decoded: dict[MessageType[Any], Sequence[tuple[int, Any]]] = {}
            for receiver, name, kind in queue.receivers:
                if kind not in decoded:
                    decoded[kind] = self._decoded(topic, kind, messages, times)
                admitted = decoded[kind]
                if receiver.limit is not None:
                    sizes = map(len, messages)
                    admitted = receiver.limit.admit(admitted, sizes, thin=kind.replaces_previous)
                receiver.add(name, kind, admitted)

    def descriptions(self, topic: str) -> Sequence[tuple[int, str]]:
        """Remove and return the descriptions queued for a topic, with their times."""
        return self._decoded(topic, DESCRIPTION, *self._queues[topic, DESCRIPTION.name].empty())

    def _decoded(
        self, topic: str, kind: MessageType[Any], messages: Sequence[bytes], times: Sequence[int]
    ) -> list[tuple[int, Any]]:
        decoded = []
        for data, received_ns in zip(messages, times, strict=True):
            try:
                message = kind.read(data)
            except BAD_MESSAGE as error:
                self.report(topic, error)
                continue
            stamp_ns = kind.stamp_ns(message)
            time_ns = self.stamps.display_time(stamp_ns, received_ns, topic, kind)
            decoded.append((time_ns, message))
        return decoded


@dataclass
class _Queue:
    """The queued messages of one topic and type, and who receives them."""

    messages: list[bytes] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    # A receiver, its name for the topic, and the type that decodes its messages.
    receivers: list[tuple[Receiver, str, MessageType[Any]]] = field(default_factory=list)
    # Set if each receiver has a limit. Then the oldest messages are dropped when there are more
    # than ``max_count``, or if that is None, when they have too many bytes.
    limits: "list[LoadLimit]" = field(default_factory=list)
    max_count: int | None = None
    size: int = 0  # bytes

    def append(self, data: bytes, time_ns: int) -> None:
        self.messages.append(data)
        self.times.append(time_ns)
        self.size += len(data)
        count = len(self.messages)
        is_full = self.size > _MAX_BYTES if self.max_count is None else count > self.max_count
        if self.limits and is_full and count > 1:
            self.size -= len(self.messages[0])
            del self.messages[0], self.times[0]
            for limit in self.limits:
                limit.dropped += 1

    def empty(self) -> tuple[list[bytes], list[int]]:
        """Remove and return the messages and their receive times."""
        waiting = self.messages, self.times
        self.messages, self.times, self.size = [], [], 0
        return waiting


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

    def display_time(
        self, stamp_ns: int, time_ns: int, topic: str = "", kind: MessageType[Any] | None = None
    ) -> int:
        """Return the time at which to show a message, nanoseconds.

        Args:
            stamp_ns: its stamp, nanoseconds; 0 for none.
            time_ns: when it was received, nanoseconds.
            topic: its full name.
            kind: its type.
        """
        if SYSTEM_TIME_NS < time_ns < stamp_ns - OTHER_CLOCK_NS:
            ahead = f"{(stamp_ns - time_ns) * 1e-9:.0f} s ahead of their receive time"
            self.warnings.setdefault("", f"stamps {ahead} are ignored: is a clock wrong?")
            stamp_ns = 0
        if not stamp_ns:
            return time_ns + self._shift
        if kind is not None and kind.stamped_when_sent:
            self._compare(stamp_ns - time_ns, time_ns, topic, is_tf=kind.name == _TF)
        return stamp_ns

    def _compare(self, shift: int, time_ns: int, topic: str, *, is_tf: bool) -> None:
        """Set the shift, or compare a topic's shift with it and warn if they differ."""
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


# --- load -----------------------------------------------------------------------------------------

# Share of its time that the viewer may spend on one display, and how many seconds it can save up.
_SHARE, _SAVED = 0.25, 0.5
_FADING, _FEW = 0.7, 0.1  # decay of earlier messages' weight per call, and the minimum weight
_BYTES_PER_SECOND = 400e6  # rate at which Rerun copies, encodes and sends in its own threads


class LoadLimit:
    """Drops old messages of a display if more arrive than can be shown.

    The display gets a share of each second; the time per message is measured.
    """

    def __init__(self) -> None:
        self._left = _SAVED  # seconds
        self._seconds = self._messages = 0.0  # the time that recent messages took, and their number
        self._at: float | None = None
        self._bytes = 0
        self._count = 0
        self.dropped = 0  # messages dropped so far

    def ready(self, now: float) -> bool:
        """Whether there is time to draw a message at ``now``, seconds."""
        if self._at is not None:
            self._left = min(_SAVED, self._left + _SHARE * max(0.0, now - self._at))
        self._at = now
        return self._left > 0.0

    def admit(
        self, messages: Sequence[T], sizes: Iterable[int], *, thin: bool = True
    ) -> Sequence[T]:
        """Return the newest messages, as many as there is time to draw but at least one.

        Args:
            messages: the received messages, oldest first.
            sizes: their sizes, bytes.
            thin: drop messages; False: return all, so that the display is ready later.
        """
        cost = self._seconds / self._messages if thin and self._messages else 0.0
        room = max(1, int(self._left / cost)) if cost else len(messages)
        self.dropped += max(0, len(messages) - room)
        admitted = messages[-room:]
        self._count += len(admitted)
        self._bytes += sum(list(sizes)[-room:])
        return admitted

    def spent(self, seconds: float) -> None:
        """Record the time that admitted messages took, seconds.

        It may come from messages admitted earlier, since some wait for a transform.
        """
        seconds += self._bytes / _BYTES_PER_SECOND
        self._left -= seconds
        if self._count or self._messages > _FEW:
            self._seconds = _FADING * self._seconds + seconds
            self._messages = _FADING * self._messages + self._count
        self._bytes = self._count = 0
