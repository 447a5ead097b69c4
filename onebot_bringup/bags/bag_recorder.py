#!/usr/bin/env python3
"""Records topics as ``ros2 bag record`` does: a rosbag2 in MCAP that survives being killed.

The folder is completed about once a second: whatever ends the recorder, everything except the last
second can be read by ``ros2 bag info`` and ``play`` (Jazzy or newer), Foxglove and
``onebot replay``.

The recorder warns about lost messages.

Subscribes:
    every topic that appears, except hidden ones, /rosout and /parameter_events; its QoS is adapted
        to what its publishers offer.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import re
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile

from onebot_bringup.bags.writer import BagWriter, Qos, RecordedTopic
from onebot_bringup.introspection.interfaces import is_hidden, message_class
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import REQUIRED, parameter, read
from onebot_description.ros.node_parameters import declare, refuse_undeclared
from onebot_description.ros.run_node import ends_node, run_node, steady_timer
from onebot_description.ros.topic_qos import (
    compatible_qos,
    exceeds,
    is_reliable,
    is_transient_local,
)
from onebot_description.ros.topic_subscription import (
    TopicSubscription,
    TypeConflictError,
    choose_type,
    offers,
)
from onebot_description.ros.wire.interface_text import full_definition
from onebot_description.timing.throttled import Throttled

_POLL_PERIOD = 0.2  # seconds between looking for topics
_WRITE_PERIOD = 1.0  # minimum seconds between checkpoints
_MIN_PAUSE = 10.0  # pause between checkpoints, as a multiple of a checkpoint's duration
_DEPTH = 1000  # messages that can queue up while the disk is slow: 10 s at 100 Hz
_LEFT_OUT = ("/rosout", "/parameter_events")
COMPRESSIONS = ("zstd", "none")


@dataclass(frozen=True)
class RecorderParameters:
    """The parameters of the node."""

    folder: str = parameter(
        REQUIRED,
        "where to record to, a new folder",
        not_empty=True,
        write="where to record to, as in -p folder:=run1",
        read_only=True,
    )
    topics: tuple[str, ...] = parameter((), "record only these; empty: all", read_only=True)
    regex: str = parameter("", "record only topics whose name it matches", read_only=True)
    exclude_regex: str = parameter("", "record no topics whose name it matches", read_only=True)
    compression: str = parameter(
        "zstd", "compression of the messages", choices=COMPRESSIONS, read_only=True
    )


@dataclass
class _Recorded:
    """A topic that is subscribed to; its first message adds it to the recording."""

    subscription: TopicSubscription
    number: int | None = None  # the topic's number in the recording
    lost: int = 0  # number of messages lost


def _pattern(name: str, text: str) -> re.Pattern[str] | None:
    try:
        return re.compile(text) if text else None
    except re.error as error:
        raise OneBotError(f"{name}:={text} is not a regular expression: {error}") from None


class BagRecorder(Node):
    """The node; see the module's docstring.

    The QoS of its subscriptions is as strict as all publishers of a topic allow, and is relaxed
    when a publisher appears that offers less.
    """

    def __init__(self) -> None:
        super().__init__("bag_recorder")
        self._bag: BagWriter | None = None
        parameters = read(RecorderParameters, declare(self, RecorderParameters))
        refuse_undeclared(self, RecorderParameters)
        self._names = {self.resolve_topic_name(name) for name in parameters.topics}
        self._pattern = _pattern("regex", parameters.regex)
        self._excluded = _pattern("exclude_regex", parameters.exclude_regex)
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self._recorded: dict[str, _Recorded] = {}
        self._warn = Throttled(self.get_logger().warning)
        self._next_write = 0.0
        folder = Path(parameters.folder).expanduser().absolute()
        self._bag = BagWriter(folder, compress=parameters.compression == "zstd")
        steady_timer(self, _POLL_PERIOD, self._poll)
        steady_timer(self, _WRITE_PERIOD, self._write)
        self.get_logger().info(f"recording to {folder}")
        self._poll()

    @ends_node
    def _write(self) -> None:
        assert self._bag is not None
        start = time.monotonic()
        if start >= self._next_write:
            self._bag.checkpoint()
            now = time.monotonic()
            self._next_write = now + _MIN_PAUSE * (now - start) - _WRITE_PERIOD

    def destroy_node(self) -> None:
        bag, self._bag = self._bag, None
        try:
            if bag is not None and bag.open:
                signal.alarm(0)  # a slow disk has its time (see ``run_node``)
                bag.close()
                text = f"recorded {bag.message_count} messages of {len(bag.topics)} topics"
                lost = sum(recorded.lost for recorded in self._recorded.values())
                end = f", {lost} were lost" if lost else ""
                self.get_logger().info(f"{text} to {bag.folder}{end}")
        finally:
            super().destroy_node()

    def _poll(self) -> None:
        """Subscribe to new topics, and again to topics whose publishers have changed.

        Nothing is subscribed to before simulated time is known: otherwise latched messages would be
        stamped with 0, and playing the recording would take decades.
        """
        if not self._now():
            self._warn.once("waiting for the first message on /clock, as use_sim_time is true")
            return
        for topic, _ in self.get_topic_names_and_types():
            if self._is_wanted(topic):
                self._update(topic)

    def _is_wanted(self, topic: str) -> bool:
        """Names and pattern add up; without any, all but hidden topics and ROS's own are wanted."""
        if self._excluded and self._excluded.search(topic):
            return False
        if self._names or self._pattern:
            return topic in self._names or bool(self._pattern and self._pattern.search(topic))
        return not is_hidden(topic) and topic not in _LEFT_OUT

    def _update(self, topic: str) -> None:
        """Subscribe with the type and QoS of a topic's publishers, or else of its subscribers.

        Once a message was recorded, only the QoS can be relaxed.
        """
        if topic not in self._recorded:
            self._record(topic)
        recorded, offered = self._recorded[topic], offers(self, topic)
        types, current = self._installed(topic, offered), recorded.subscription.type
        kind = choose_type(types, current) if recorded.number is None else current
        if kind is None:
            return
        for other_type in types:
            if other_type != kind:
                self._warn.once(f"{topic} is recorded as {kind}, not as {other_type}")
        publishers = offered.get(kind, [])
        qos = compatible_qos(publishers, _DEPTH)
        if recorded.number is None:
            # The executor may still hold the previous type; the next poll tries again.
            with suppress(TypeConflictError):
                recorded.subscription.update(kind, qos)
        elif publishers and exceeds(recorded.subscription.qos, qos):
            recorded.subscription.update(kind, qos)

    def _installed(self, topic: str, types: Iterable[str]) -> list[str]:
        """Return those types that are installed, sorted; warn about the others."""
        installed = []
        for kind in sorted(types):
            try:
                message_class(kind)
                full_definition(kind)
                installed.append(kind)
            except OneBotError as error:
                self._warn.once(f"{topic} is not recorded: {error}")
        return installed

    def _record(self, topic: str) -> None:
        bag = self._bag
        assert bag is not None

        @ends_node
        def received(kind: str, data: bytes) -> None:
            now = self._now()
            if recorded.number is None:
                recorded.number = bag.add_topic(self._described(topic, kind))
            bag.write(recorded.number, now, data)

        def lost(count: int) -> None:
            recorded.lost += count
            self._warn(topic, f"{topic}: {recorded.lost} messages lost so far")

        subscription = TopicSubscription(self, topic, received, message_class, lost=lost)
        recorded = self._recorded[topic] = _Recorded(subscription)

    def _described(self, name: str, kind: str) -> RecordedTopic:
        """Return the topic to add to the recording, with the QoS that its publishers offer now."""
        publishers = self.get_publishers_info_by_topic(name)
        publishers = [end for end in publishers if end.topic_type == kind]
        # Our own subscription also has the type's hash, if the publisher is already gone.
        ends = [*publishers, *self.get_subscriptions_info_by_topic(name)]
        hashes = [str(end.topic_type_hash) for end in ends if end.topic_type == kind]
        type_hash = next((text for text in hashes if text.startswith("RIHS")), "")
        offered = tuple(dict.fromkeys(offered_qos(end.qos_profile) for end in publishers))
        return RecordedTopic(name, kind, type_hash, offered)

    def _now(self) -> int:
        """Return the receive time of a message, ns, by this computer's clock or simulated time."""
        if self._simulated:
            return int(self.get_clock().now().nanoseconds)
        return time.time_ns()


def offered_qos(profile: QoSProfile) -> Qos:
    """Return a publisher's QoS in rosbag2's terms."""
    return Qos(
        reliability="reliable" if is_reliable(profile) else "best_effort",
        durability="transient_local" if is_transient_local(profile) else "volatile",
    )


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(BagRecorder, args, whole_graph=True)


if __name__ == "__main__":
    sys.exit(main())
