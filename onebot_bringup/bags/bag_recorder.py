#!/usr/bin/env python3
"""Records topics as ``ros2 bag record`` does: a rosbag2 in MCAP that survives being killed.

The folder is complete about once a second: whatever ends the recorder, all but the last second can
be read, by ``ros2 bag info`` and ``play`` (Jazzy or newer), Foxglove and ``onebot replay``.

Subscribes:
    /tf, /tf_static, joint_states, robot_description, velocity_controller/odom: from the start.
    every other topic that turns up, but hidden ones, /rosout and /parameter_events; its QoS is
        adapted to what its publishers offer.

Parameters:
    folder (string): the recording, a new folder; required.
    topics (string[], []): record only these, absolute or relative names.
    compression (string, "zstd"): of the chunks of messages; or none.
    use_sim_time (bool, false): stamp the messages with simulated time.
"""

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from onebot_bringup.bags.writer import BagWriter, Qos, Topic
from onebot_bringup.introspection.interfaces import full_definition, message_class
from onebot_description.errors import OneBotError
from onebot_description.node import run_node
from onebot_description.parameters.reader import REQUIRED, declare, parameter, read

# How a bag recorder hears a topic: as reliably as all of its publishers offer, and no more.

_DEPTH = 1000  # what may queue up while the disk is slow: 10 s at 100 Hz
_FOREVER = 2**63 - 1  # ns; how DDS says that there is no limit
_LIVELINESS = {
    LivelinessPolicy.AUTOMATIC: "automatic",
    LivelinessPolicy.MANUAL_BY_TOPIC: "manual_by_topic",
}


def offered_qos(profile: QoSProfile) -> Qos:
    """Return what a publisher offers in rosbag2's words; DDS does not tell its history."""
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return Qos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
        liveliness=_LIVELINESS.get(profile.liveliness, "automatic"),
        deadline=_limit(profile.deadline),
        lifespan=_limit(profile.lifespan),
        lease=_limit(profile.liveliness_lease_duration),
    )


def _limit(duration: Any) -> int | None:
    return int(duration.nanoseconds) if 0 < duration.nanoseconds < _FOREVER else None


@dataclass(frozen=True)
class Wish:
    """How a topic is heard.

    Attributes:
        type: of its messages.
        reliable: a message that is lost on the way is sent again.
        latched: late comers get the last message.
    """

    type: str
    reliable: bool = True
    latched: bool = False

    @classmethod
    def of(cls, kind: str, offers: Iterable[Qos]) -> "Wish":
        """Return how to hear all who offer this: who asks for more hears nothing of some."""
        known = list(offers)
        return cls(
            kind,
            all(offer.reliability == "reliable" for offer in known),
            all(offer.durability == "transient_local" for offer in known),
        )

    def asks_more_than(self, other: "Wish") -> bool:
        """Return whether a publisher that offers just what ``other`` asks for is not heard."""
        return (self.reliable and not other.reliable) or (self.latched and not other.latched)

    @property
    def profile(self) -> QoSProfile:
        """The same for a subscription."""
        reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        return QoSProfile(
            depth=_DEPTH,
            reliability=reliable if self.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=latched if self.latched else DurabilityPolicy.VOLATILE,
        )


# The topics that a bag recorder hears: found as they turn up, each with a QoS that suits it.

# What a robot of ours publishes. It is heard from the start, so that nothing is missed while the
# recorder finds out who publishes it; the value says if late comers get the last message.
_KNOWN = {
    "/tf": ("tf2_msgs/msg/TFMessage", False),
    "/tf_static": ("tf2_msgs/msg/TFMessage", True),
    "joint_states": ("sensor_msgs/msg/JointState", False),
    "robot_description": ("std_msgs/msg/String", True),
    "velocity_controller/odom": ("nav_msgs/msg/Odometry", False),
}
_LEFT_OUT = ("/rosout", "/parameter_events")
_LOOK_AGAIN = 8  # looks; everything is looked at anew, also where the counts have not changed


class _Heard:
    """A subscription; its topic enters the recording with its first message."""

    def __init__(
        self,
        wish: Wish,
        subscribe: Callable[[Callable[[bytes], None]], Any],
        take: Any,
        number: int | None = None,
    ) -> None:
        """Hear as ``wish`` says; ``number`` is the topic's where the recording has it already."""
        self.wish = wish
        self._take = take
        self.number = number
        self.subscription = subscribe(self._on_message)

    @property
    def used(self) -> bool:
        """A message has come."""
        return self.number is not None

    def _on_message(self, data: bytes) -> None:
        self.number = self._take(self, self.number, data)


class BagTopics:
    """Records topics into a bag: the wanted ones, or else all that turn up."""

    def __init__(self, node: Node, bag: BagWriter, wanted: Sequence[str] = ()) -> None:
        """Subscribe on ``node`` to what is known already; ``watch`` does the rest.

        Args:
            node: hears.
            bag: where messages go.
            wanted: names, absolute or relative; empty for /tf, /tf_static and every other topic
                but hidden ones, /rosout and /parameter_events.
        """
        self._node = node
        self._bag = bag
        self._simulated = bool(node.get_parameter("use_sim_time").value)
        self._wanted = {node.resolve_topic_name(name) for name in wanted}
        self._heard: dict[str, _Heard] = {}
        self._seen: dict[str, Any] = {}
        self._looks = 0
        self._said: set[str] = set()
        self._me = (node.get_name(), node.get_namespace())
        for name, (kind, latched) in _KNOWN.items():
            topic = node.resolve_topic_name(name)
            if not self._wanted or topic in self._wanted:
                self._listen(topic, Wish(kind, latched=latched))

    def watch(self) -> None:
        """Subscribe to what is new, and anew to what has changed; call it some times a second."""
        self._looks += 1
        if self._looks % _LOOK_AGAIN == 0:
            self._seen.clear()
        for topic, types in self._node.get_topic_names_and_types():
            if self._is_wanted(topic):
                seen = (
                    types,
                    self._node.count_publishers(topic),
                    self._node.count_subscribers(topic),
                )
                if self._seen.get(topic) != seen:
                    self._seen[topic] = seen
                    self._look_at(topic)

    def _is_wanted(self, topic: str) -> bool:
        if self._wanted:
            return topic in self._wanted
        hidden = any(part.startswith("_") for part in topic.split("/"))
        return not hidden and topic not in _LEFT_OUT

    def _look_at(self, topic: str) -> None:
        heard = self._heard.get(topic)
        wish = self._wish(topic, heard)
        if wish is None or (heard is not None and heard.wish == wish):
            return
        if heard is None:
            self._listen(topic, wish)
        elif heard.wish.type != wish.type:
            self._change_type(topic, heard, wish)
        elif heard.wish.asks_more_than(wish) or not heard.used:
            self._node.destroy_subscription(self._heard.pop(topic).subscription)
            self._listen(topic, wish, heard.number)

    def _change_type(self, topic: str, heard: _Heard, wish: Wish) -> None:
        if heard.used:
            self._say(f"{topic} is recorded as {heard.wish.type}, not as {wish.type} as well")
            return
        # A process can hear a topic as one type only, and the executor lets go of the old
        # subscription after this callback: the new one is made at the next look.
        self._node.destroy_subscription(self._heard.pop(topic).subscription)
        del self._seen[topic]

    def _wish(self, topic: str, heard: _Heard | None) -> Wish | None:
        """How to hear ``topic``: by its publishers, or else by who else waits for it."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        ends = publishers or [
            end
            for end in self._node.get_subscriptions_info_by_topic(topic)
            if (end.node_name, end.node_namespace) != self._me
        ]
        types = self._usable(topic, {end.topic_type for end in ends})
        if not types:
            return None
        kind = heard.wish.type if heard is not None and heard.wish.type in types else types[0]
        if len(types) > 1:
            self._say(f"{topic} has several types ({', '.join(types)}); it is recorded as {kind}")
        offers = [offered_qos(end.qos_profile) for end in publishers if end.topic_type == kind]
        if not offers:
            return heard.wish if heard is not None and heard.wish.type == kind else Wish(kind)
        return Wish.of(kind, offers)

    def _usable(self, topic: str, types: Iterable[str]) -> list[str]:
        """The types that are installed, sorted; it says which ones are not."""
        found = []
        for kind in sorted(types):
            try:
                message_class(kind)
                full_definition(kind)
            except OneBotError as error:
                self._say(f"{topic} is not recorded: {error}")
                continue
            found.append(kind)
        return found

    def _listen(self, topic: str, wish: Wish, number: int | None = None) -> None:
        def subscribe(on_message: Callable[[bytes], None]) -> Any:
            kind = message_class(wish.type)
            return self._node.create_subscription(kind, topic, on_message, wish.profile, raw=True)

        def take(heard: _Heard, number: int | None, data: bytes) -> int:
            now = self._now()
            if number is None:
                number = self._bag.add_topic(self._topic(topic, heard.wish.type))
            self._bag.write(number, now, data)
            return number

        self._heard[topic] = _Heard(wish, subscribe, take, number)

    def _topic(self, name: str, kind: str) -> Topic:
        """The topic as it enters the recording, with what its publishers offer now."""
        publishers = self._node.get_publishers_info_by_topic(name)
        publishers = [end for end in publishers if end.topic_type == kind]
        # Our own end knows the hash, too, should the publisher's have gone already.
        ends = [*publishers, *self._node.get_subscriptions_info_by_topic(name)]
        hashes = [str(end.topic_type_hash) for end in ends if end.topic_type == kind]
        known = next((text for text in hashes if text.startswith("RIHS")), "")
        offered = tuple(dict.fromkeys(offered_qos(end.qos_profile) for end in publishers))
        return Topic(name, kind, known, offered)

    def _now(self) -> int:
        """When a message came, ns: on this computer's clock, or else in simulated time."""
        if self._simulated:
            return int(self._node.get_clock().now().nanoseconds)
        return time.time_ns()

    def _say(self, text: str) -> None:
        """Warn, once."""
        if text not in self._said:
            self._said.add(text)
            self._node.get_logger().warning(text)


COMPRESSIONS = ("zstd", "none")
_LOOK_EVERY = 0.2  # seconds
_WRITE_EVERY = 1.0  # seconds, and rarer where writing takes long:
_LEAST_IDLE = 10.0  # 9/10 of the time at least are left for messages


@dataclass(frozen=True)
class RecorderParameters:
    """The parameters."""

    folder: str = parameter(
        REQUIRED,
        "where to record to, a new folder",
        not_empty=True,
        write="where to record to, as in -p folder:=run1",
        read_only=True,
    )
    topics: tuple[str, ...] = parameter((), "record only these; empty: all", read_only=True)
    compression: str = parameter(
        "zstd", "of the chunks of messages", choices=COMPRESSIONS, read_only=True
    )


class BagRecorder(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Make the recording and start to listen.

        Raises:
            OneBotError: a parameter is wrong, or the folder cannot be made.
        """
        super().__init__("bag_recorder")
        self._bag: BagWriter | None = None
        given = read(RecorderParameters, declare(self, RecorderParameters))
        folder = Path(given.folder).expanduser().absolute()
        self._bag = BagWriter(folder, compress=given.compression == "zstd")
        self._topics = BagTopics(self, self._bag, given.topics)
        self._next_write = 0.0
        # Not ROS time: it may stand still or run fast.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_EVERY, self._topics.watch, clock=steady)
        self.create_timer(_WRITE_EVERY, self._write, clock=steady)
        self._topics.watch()
        self.get_logger().info(f"recording to {self._bag.folder}")

    def _write(self) -> None:
        assert self._bag is not None
        start = time.monotonic()
        if start >= self._next_write:
            self._bag.checkpoint()
            now = time.monotonic()
            self._next_write = now + _LEAST_IDLE * (now - start) - _WRITE_EVERY

    def destroy_node(self) -> None:
        """Write what is left, say how much it was, and end the node."""
        if self._bag is not None:
            self._finish(self._bag)
            self._bag = None
        super().destroy_node()

    def _finish(self, bag: BagWriter) -> None:
        if not bag.open:
            return  # it failed, and that was said
        try:
            bag.close()
        except OneBotError as error:
            self.get_logger().error(str(error))
            return
        said = f"recorded {bag.message_count} messages of {bag.topic_count} topics"
        self.get_logger().info(f"{said} to {bag.folder}")


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(BagRecorder, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
