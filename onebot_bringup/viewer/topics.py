"""The topics of a robot that drives, heard for the viewer: Odometry, Twist and TwistStamped."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from onebot_bringup.viewer.robot_view import LiveView
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.errors import OneBotError
from onebot_description.node import SENSOR
from onebot_description.wire.messages import (
    BAD_MESSAGE,
    TwistSample,
    joint_state_batch,
    odometry_sample,
    tf_batch,
    twist_sample,
    twist_stamped_sample,
)

# Keeps the raw messages of /tf and joint_states until they are shown, and decodes them together.

_STAMP = slice(4, 12)  # of a message that begins with a header
_NO_STAMP = bytes(8)


class Inbox:
    """What has come for a view since it was handed over last."""

    def __init__(
        self,
        live: LiveView,
        complain: Callable[[str, Exception], object],
        now_ns: Callable[[], int],
        joint_topic: str = "joint_states",
    ) -> None:
        """Hand over to ``live``.

        Args:
            live: the view.
            complain: is told of a message that is none: its topic, and what is wrong.
            now_ns: the time now, nanoseconds, for JointStates without one.
            joint_topic: how to name that topic.
        """
        self._live, self._complain, self._now_ns = live, complain, now_ns
        self._joint_topic = joint_topic
        self._tf: list[bytes] = []
        self._joints: list[bytes] = []
        self._came: dict[int, int] = {}  # place among the JointStates -> when, if it does not say

    def add_transforms(self, data: bytes) -> None:
        """Take in a serialized TFMessage of /tf."""
        self._tf.append(data)

    def add_joints(self, data: bytes) -> None:
        """Take in a serialized JointState."""
        if data[_STAMP] == _NO_STAMP:
            self._came[len(self._joints)] = self._now_ns()
        self._joints.append(data)

    def hand_over(self, *, joints: bool = True) -> None:
        """Give the view what has come; without ``joints`` those stay until the next time."""
        messages, self._tf = self._tf, []
        for transforms in tf_batch(messages, lambda error: self._complain("/tf", error)):
            if transforms is not None:
                self._live.add_transforms(transforms)
        if joints:
            self._hand_over_joints()

    def _hand_over_joints(self) -> None:
        messages, self._joints = self._joints, []
        came, self._came = self._came, {}
        states = joint_state_batch(messages, lambda error: self._complain(self._joint_topic, error))
        for at, state in enumerate(states):
            if state is not None:
                stamp = state.stamp_ns or came.get(at, 0) or self._now_ns()
                self._live.add_joints(stamp, state.names, state.positions, state.velocities)


RCLError = rclpy_implementation.RCLError

_ODOMETRY, _AUTO = "Odometry", "auto"
_KINDS = {"Twist": Twist, "TwistStamped": TwistStamped, _ODOMETRY: Odometry}
_KIND_OF = {
    "geometry_msgs/msg/Twist": "Twist",
    "geometry_msgs/msg/TwistStamped": "TwistStamped",
    "nav_msgs/msg/Odometry": _ODOMETRY,
}


def wanted_topics(view: ViewConfig) -> dict[str, str]:
    """Return the topics that ``view`` names and the type of each, "auto" where it is open."""
    topics = {trail.topic: _ODOMETRY for trail in view.trails.values()}
    topics |= {item.topic: _ODOMETRY for item in view.covariance.values()}
    for line in view.speeds.lines.values():
        if topics.get(line.topic, _AUTO) == _AUTO:
            topics[line.topic] = line.type
    return topics


@dataclass
class _Heard:
    """A subscription, and the type it is of."""

    kind: str
    subscription: Any


class DriveTopics:
    """Subscribes to what the view asks for, each topic once."""

    def __init__(
        self,
        node: Node,
        live: LiveView,
        view: ViewConfig,
        complain: Callable[[str, Exception], object],
    ) -> None:
        """Subscribe on ``node``, feed ``live``.

        Args:
            node: it hears the topics.
            live: what they are shown in.
            view: names them.
            complain: is told of a message that is none: its topic, and what is wrong.

        Raises:
            OneBotError: the viewer hears one of the topics already, as another type.
        """
        self._node = node
        self._live = live
        self._complain = complain
        self._heard: dict[str, _Heard] = {}
        self._wanted: dict[str, str] = {}
        self.set_view(view)

    def set_view(self, view: ViewConfig) -> None:
        """Hear what ``view`` asks for, and nothing else.

        Raises:
            OneBotError: the viewer hears one of the topics already, as another type; the others
                are heard.
        """
        self._wanted = wanted_topics(view)
        for topic in set(self._heard) - set(self._wanted):
            self._drop(topic)
        said = [topic for topic, kind in self._wanted.items() if kind != _AUTO]
        self._hear({topic: self._wanted[topic] for topic in said if topic not in self._heard})

    def _hear(self, topics: Mapping[str, str]) -> None:
        """Subscribe to topics as the types given; what does not work is raised at the end."""
        problems = []
        for topic, kind in topics.items():
            try:
                self._listen(topic, kind)
            except OneBotError as error:
                problems.append(str(error))
        if problems:
            raise OneBotError("; ".join(problems))

    def watch(self) -> None:
        """Hear each topic as what the view says, or else as what is there; call it now and then."""
        new: dict[str, str] = {}
        for topic, said in self._wanted.items():
            kind = self._type_of(topic) if said == _AUTO else said
            heard = self._heard.get(topic)
            if heard is None and kind is not None:
                new[topic] = kind
            elif heard is not None and kind not in (None, heard.kind):
                # A node can hear a topic as one type only, and the executor lets go of the old
                # subscription after this callback: the new one is made when we are called again.
                self._drop(topic)
        self._hear(new)

    def _drop(self, topic: str) -> None:
        self._node.destroy_subscription(self._heard.pop(topic).subscription)

    def _type_of(self, topic: str) -> str | None:
        """The type on ``topic``: its publishers', or else its subscribers', so as to be early."""
        name = self._node.resolve_topic_name(topic)
        heard = self._heard.get(topic)
        for ends in (
            self._node.get_publishers_info_by_topic(name),
            self._node.get_subscriptions_info_by_topic(name),
        ):
            kinds = {_KIND_OF[end.topic_type] for end in ends if end.topic_type in _KIND_OF}
            if heard is not None and heard.kind in kinds:
                return heard.kind
            if kinds:
                return min(kinds)
        return None

    def _listen(self, topic: str, kind: str) -> None:
        on_message = self._on_odometry if kind == _ODOMETRY else self._on_twist
        try:
            subscription = self._node.create_subscription(
                _KINDS[kind], topic, on_message(topic, kind), SENSOR, raw=True
            )
        except RCLError as error:
            raise OneBotError(
                f'the view\'s topic "{topic}" cannot be heard as {kind}: the viewer hears it as '
                "another type"
            ) from error
        self._heard[topic] = _Heard(kind, subscription)

    def _on_odometry(self, topic: str, _: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            sample = odometry_sample(data)
            self._live.add_odometry(topic, sample.stamp_ns or self._now(), sample)

        return self._guarded(topic, take)

    def _on_twist(self, topic: str, kind: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            sample = _TWIST_READERS[kind](data)
            self._live.add_command(topic, sample.stamp_ns or self._now(), sample)

        return self._guarded(topic, take)

    def _guarded(self, topic: str, take: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """A strange message must not end the viewer."""

        def guarded(data: bytes) -> None:
            try:
                take(data)
            except BAD_MESSAGE as error:
                self._complain(topic, error)

        return guarded

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


_TWIST_READERS: Mapping[str, Callable[[bytes], TwistSample]] = {
    "Twist": twist_sample,
    "TwistStamped": twist_stamped_sample,
}
