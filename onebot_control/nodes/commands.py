"""Receives the velocity commands of a robot on ~/cmd_vel, and passes them to the control loop."""

import math
import time
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

from geometry_msgs.msg import Twist
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from onebot_control.drive.parameters import DriveParameters
from onebot_control.nodes.velocity_messages import TWIST, VELOCITY_TYPES
from onebot_control.runtime.control_loop import LoopSlot
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Triple
from onebot_description.ros.message_age import Age, Delivery, SenderClock
from onebot_description.ros.node_graph import Lasting
from onebot_description.ros.stamp_check import StampCheck
from onebot_description.ros.topic_qos import DEPTH, LATCHED
from onebot_description.ros.topic_subscription import (
    TopicSubscription,
    TypeConflictError,
    choose_type,
    offers,
)
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled, Warn
from onebot_description.timing.wake_detector import boot_time

_QOS = QoSProfile(depth=DEPTH)
_JOINTS = "controller_manager/cmd_vel"  # lock of the joints, also of a mobile robot
_STEERED = "drive"  # the topic of AckermannDriveStamped, as of F1TENTH's cars
_USUAL = "cmd_vel"  # tutorials publish commands there
_LOCKED = "Current goal cancelled: the robot is locked."
_LOCKED_EVERY = 60.0  # s between two warnings that a command is ignored because of the lock
_SETTLED = 2.0  # s after which a subscriber of cmd_vel would have been discovered


class CommandLock:
    """A lock of the robot as in twist_mux: ~/cmd_vel_lock sets it, ~/cmd_vel_locked is its state.

    The last message from any node counts, and does not expire: if the node that locked the robot
    dies, it stays locked. Remapping ~/cmd_vel renames both topics, too.
    """

    def __init__(
        self, node: Node, name: str, brake: Callable[[], None], above: "CommandLock | None" = None
    ) -> None:
        """Start unlocked.

        Args:
            node: node of the robot.
            name: name of the locked commands.
            brake: called when they are locked.
            above: a lock that also locks these commands; unlocking them leaves it locked.
        """
        self._node, self._brake = node, brake
        commands = node.resolve_topic_name(name)
        self._topic = f"{commands}_lock"
        topics = [self._topic] if above is None else [self._topic, above._topic]
        # The topics on which they were locked and not unlocked.
        self._lockers = {above._topic} if above is not None and above.locked else set()
        drives = "presses a control that drives in onebot steer, or r in onebot teleop"
        self._unlocks = drives if above is None else "moves a joint in onebot steer"
        self._state = node.create_publisher(Bool, f"{commands}_locked", LATCHED)
        self._state.publish(Bool(data=self.locked))
        for topic in topics:
            node.create_subscription(Bool, topic, partial(self._on_lock, topic), _QOS)

    @property
    def locked(self) -> bool:
        return bool(self._lockers)

    @property
    def reason(self) -> str:
        """Why commands are ignored, and how to unlock the robot."""
        text = f"the robot is locked until false is published on {self._topic}"
        return f"{text}, or until a user {self._unlocks}"

    def _on_lock(self, topic: str, message: Bool) -> None:
        was_locked = self.locked
        if message.data:
            self._lockers.add(topic)
        else:
            self._lockers -= self._lockers if topic == self._topic else {topic}
        if self.locked == was_locked:
            return
        self._state.publish(message)
        if self.locked:
            self._brake()
            self._node.get_logger().warning(f"stopped: {self.reason}")
        else:
            self._node.get_logger().info("unlocked: the robot can be driven again")


class CommandSubscription:
    """The velocity commands, subscribed to as Twist or as TwistStamped, whichever is published."""

    def __init__(
        self, node: Node, topic: str, received: Callable[[Twist, Age, int | None], None], warn: Warn
    ) -> None:
        """Subscribe.

        Args:
            node: the subscriber.
            topic: the topic, such as ~/cmd_vel.
            received: called with each command, the time since it was sent, and its stamp, ns; None
                for a Twist.
            warn: logs a warning, given a key and a text.
        """
        self._node, self._received, self._warn = node, received, warn
        self._name, self._topic = topic, node.resolve_topic_name(topic)
        self._usual = node.resolve_topic_name(_USUAL)
        self._unreceived = Lasting(_SETTLED)
        self._check = StampCheck.from_topic(node, topic)
        self._wanted = TWIST
        self._sender, self._age = SenderClock(), Age(0.0, 0.0)
        self._subscription = TopicSubscription(
            node,
            topic,
            self._on_message,
            VELOCITY_TYPES.__getitem__,
            raw=False,
            delivered=self._on_delivery,
        )
        self._subscription.update(self._wanted, _QOS)

    @property
    def connected(self) -> bool:
        """Whether a publisher of the subscribed type is connected."""
        return self._subscription.publishers > 0

    def follow(self) -> None:
        """Change to the published type; call it several times per second.

        It also reports commands on a topic cmd_vel without subscribers.
        """
        self._look_for_unreceived()
        published = {kind for kind, qos in offers(self._node, self._topic).items() if qos}
        self._wanted = choose_type(published & VELOCITY_TYPES.keys(), self._wanted) or self._wanted
        self._subscription.update(self._wanted, _QOS)
        if ignored := sorted(published - {self._wanted}):
            text = f"{self._name} is also published as {', '.join(ignored)}, which is ignored"
            self._warn("type", f"{text}: stop that publisher, or the {self._wanted} one")

    def adopt(self, topic: str, kind: str) -> None:
        """Change to the type that a node of this context is about to use, if it is a command type.

        Raises:
            OneBotError: another node of this context uses the current type.
        """
        if topic != self._topic or kind not in VELOCITY_TYPES:
            return
        try:
            for _ in range(2):  # a change takes two calls; nothing holds the first subscription
                self._subscription.update(kind, _QOS)
            self._wanted = kind
        except TypeConflictError:
            self._subscription.update(self._wanted, _QOS)
            text = f"{topic} is already used as {self._wanted}, so it cannot be used as {kind}"
            raise OneBotError(f"{text}; in one process, a topic has one type") from None

    def _look_for_unreceived(self) -> None:
        node, name = self._node, self._usual
        topics = [name] if node.count_publishers(name) and not node.count_subscribers(name) else []
        if self._unreceived.new(topics, time.monotonic()):
            text = f"{name} is published, but no node subscribes to it"
            self._warn("unreceived", f"{text}: the topic of this robot's commands is {self._topic}")

    def _on_delivery(self, delivery: Delivery) -> None:
        self._age = self._sender.age(delivery, time.time_ns())

    def _on_message(self, kind: str, message: Any) -> None:
        twist, stamp = message, None
        if kind != TWIST:
            twist, stamp = message.twist, nanoseconds(message.header.stamp)
            self._check.take(stamp, time.time_ns())
        self._received(twist, self._age, stamp)


class CommandGate:
    """Passes the commands of one robot to the control loop, unless the robot is locked.

    Attributes:
        lock: the robot's ~/cmd_vel_lock.
        topic: name of the topic of commands.
        subscription: subscription to it; None for a robot without a drive.
    """

    def __init__(
        self,
        node: Node,
        slot: LoopSlot,
        warn: Throttled,
        topic: str,
        drive: DriveParameters[Any] | None,
    ) -> None:
        """Subscribe.

        Args:
            node: node of the robot.
            slot: slot of the robot, which receives the commands.
            warn: logs warnings.
            topic: name of the topic of commands, in the node's namespace.
            drive: parameters of the drive; None for a robot without one, which receives no
                commands. If it steers, it also receives AckermannDriveStamped.
        """
        self._node, self._slot, self._warn = node, slot, warn
        self.topic = f"~/{topic}"
        # Created before the commands: an unlock sent with a command is then received first.
        self.lock = CommandLock(node, self.topic, lambda: slot.brake(_LOCKED))
        self.subscription: CommandSubscription | None = None
        if drive is not None:
            self.subscription = CommandSubscription(node, self.topic, self._on_twist, warn)
        if drive is not None and drive.steers:
            kind = load_interface("ackermann_msgs/msg/AckermannDriveStamped")
            node.create_subscription(kind, _STEERED, self._on_steered, _QOS)

    @cached_property
    def joint_lock(self) -> CommandLock:
        """The lock of the joints; without a drive, the lock of the robot."""
        if self.subscription is None:
            return self.lock
        hold = partial(self._slot.hold_joints, _LOCKED)
        return CommandLock(self._node, _JOINTS, hold, above=self.lock)

    def _on_steered(self, message: Any) -> None:
        """Receive a speed and a steering angle; the stamp is ignored, as it is old in bags."""
        if self._slot.loop is None:
            return
        speed, angle = message.drive.speed, message.drive.steering_angle
        drive = self._slot.robot.drive
        assert drive is not None
        if not abs(angle) < math.pi / 2.0:  # NaN, or degrees
            text = f"steering_angle {angle:g} rad is not within a quarter turn"
            self._warn("steered", f"{_STEERED} is ignored: {text}")
            return
        turn = drive.geometry.turning(speed, angle)
        self._command((speed, 0.0, turn), Age(0.0, 0.0), None)

    def _on_twist(self, twist: Twist, age: Age, stamp: int | None) -> None:
        self._command((twist.linear.x, twist.linear.y, twist.angular.z), age, stamp)

    def _command(self, velocity: Triple, age: Age, stamp: int | None) -> None:
        loop, now = self._slot.loop, boot_time()
        if loop is None:
            return
        if stamp == 0:
            text = f"{self.topic} has stamp 0, which is replaced by the send time (logged once)"
            self._warn.once(text)
        if self.lock.locked:
            if any(velocity):
                text = f"{self.topic} is ignored: {self.lock.reason}"
                self._warn("locked", text, every=_LOCKED_EVERY)
            return
        given = now - age.minimum
        if stamp and not loop.simulated:
            given = now - (time.time_ns() - stamp) / NS_PER_S
        sent = now - age.maximum
        self._slot.command(velocity, self._on_ignored, stamp=stamp or 0, given=given, sent=sent)

    def _on_ignored(self, reason: str) -> None:
        self._warn("command", f"{self.topic} is ignored: {reason}")
