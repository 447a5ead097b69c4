#!/usr/bin/env python3
"""A page to steer a robot from, with the robot's view beside it: rqt_robot_steering in a browser.

It stops the robot as soon as nothing is held any more, whatever the reason; should this node itself
die, the robot's controller does so after its cmd_vel_timeout.

Publishes:
    the parameter topic (geometry_msgs/Twist or TwistStamped, as the robot takes it, reliable, depth
        10): linear.x in m/s and angular.z in rad/s, at ``rate`` while something is held; then zero,
        three times, and nothing more, so that others can drive.

Subscribes:
    odometry (nav_msgs/Odometry, best effort, depth 1): see odom_topic.
    the parameter viewer_page (std_msgs/String, latched): where rerun_viewer's page is.

Calls:
    get_parameters of the robot's controller, for its limits.

Parameters:
    host (string, "127.0.0.1"): where the page is served. Anything that other computers can reach
        takes a token in the page's address.
    port (int, 8080): another if it is in use, 0 for any.
    token (string, ""): asked for in the page's address; made anew where one is needed.
    topic (string, "velocity_controller/cmd_vel"): to steer at first.
    odom_topic (string, ""): "" for the sibling "odom" of the topic, or else the only Odometry.
    rate (double, 20.0 Hz): of the commands; 5 to 100.
    max_linear (double, 0.0 m/s), max_angular (double, 0.0 rad/s): the most that pages can ask for;
        0.0 for the controller's linear.x.max_velocity and angular.z.max_velocity, or else 1.0 and
        2.0, to begin with.
    viewer_page (string, "rerun_viewer/page"): the topic that says where the view is.
    open_browser (bool, true): open the page, if there is a display.
"""

import contextlib
import math
import queue
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import quote

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from onebot_bringup.ports import is_loopback, listen, reachable_as
from onebot_bringup.steering.access import Access, new_token
from onebot_bringup.steering.arbiter import ZEROS, Helm
from onebot_bringup.steering.protocol import Velocity
from onebot_bringup.steering.server import Cockpit, Robot, ServerThread, SteeringServer
from onebot_bringup.steering.view_proxy import View, ViewProxy
from onebot_bringup.viewer.display_server import has_display
from onebot_control.poses import yaw_of
from onebot_description.errors import OneBotError
from onebot_description.node import LATCHED, run_node
from onebot_description.parameters.reader import declare, parameter, read
from onebot_description.parameters.values import MAX_PORT
from onebot_description.topic_subscription import RCLError, TopicSubscription, TypeConflictError
from onebot_description.wire.messages import odometry_sample

# The parameters of the steering page's node -----------------------------------------------------

USUAL = Velocity(1.0, 2.0)  # limits where nothing else gives any
_LEAST_RATE, _MOST_RATE = 5.0, 100.0  # Hz


def _limit(unit: str) -> Any:
    description = f"the most that pages can ask for, {unit}; 0: the controller's limit"
    return parameter(0.0, description, at_least=0.0, read_only=True)


@dataclass(frozen=True)
class SteeringParameters:
    """The values; topics are full names once they are resolved, "" for none."""

    host: str = parameter(
        "127.0.0.1", "where the page is served; 0.0.0.0: to other computers, too", read_only=True
    )
    port: int = parameter(
        8080, "another if it is in use; 0: any", at_least=0, at_most=MAX_PORT, read_only=True
    )
    token: str = parameter(
        "", "asked for in the page's address; made anew where one is needed", read_only=True
    )
    topic: str = parameter(
        "velocity_controller/cmd_vel",
        "to steer, Twist or TwistStamped",
        not_empty=True,
        write="the name of the topic to steer",
        read_only=True,
    )
    odom_topic: str = parameter("", "Odometry to show; empty: the robot's own", read_only=True)
    rate: float = parameter(
        20.0, "of the commands, Hz", at_least=_LEAST_RATE, at_most=_MOST_RATE, read_only=True
    )
    max_linear: float = _limit("m/s")
    max_angular: float = _limit("rad/s")
    viewer_page: str = parameter(
        "rerun_viewer/page", "the topic with the address of the view", read_only=True
    )
    open_browser: bool = parameter(True, "open the page, if there is a display", read_only=True)

    @classmethod
    def of(cls, node: Node) -> "SteeringParameters":
        """Declare them on ``node`` and return their values.

        Raises:
            OneBotError: one is wrong.
        """
        given = read(cls, declare(node, cls))
        topics: dict[str, Any] = {n: _topic(node, n, getattr(given, n)) for n in _TOPICS}
        return replace(given, **topics)

    @property
    def fixed(self) -> Velocity:
        """The most that pages can ask for, m/s and rad/s; 0 for the controller's limit."""
        return Velocity(self.max_linear, self.max_angular)

    @property
    def ceiling(self) -> Velocity:
        """The most that pages can set as limits."""
        return Velocity(self.fixed.linear or math.inf, self.fixed.angular or math.inf)

    def limits(self, found: Velocity = USUAL) -> Velocity:
        """Return the limits to begin with: as fixed, or else as found, or else the usual ones.

        Args:
            found: the controller's, m/s and rad/s; nan where it has none.
        """
        return Velocity(
            self.fixed.linear or (USUAL.linear if math.isnan(found.linear) else found.linear),
            self.fixed.angular or (USUAL.angular if math.isnan(found.angular) else found.angular),
        )


_TOPICS = ("topic", "odom_topic", "viewer_page")


def _topic(node: Node, name: str, text: str) -> str:
    try:
        return str(node.resolve_topic_name(text)) if text else ""
    except Exception as error:  # rclpy raises several kinds, none of them public
        reason = " ".join(str(error).split("\n")[0].split())
        raise OneBotError(f"{name}: {text} is no name of a topic: {reason}") from None


# The topic that the steering page publishes on, and its subscribers.

_TYPES = {"geometry_msgs/msg/Twist": Twist, "geometry_msgs/msg/TwistStamped": TwistStamped}
_DEPTH = 10
_WARN_EVERY = 5.0  # s
_OBSERVERS = (
    "rerun_viewer",
    "steering_viewer",
    "bag_recorder",
    "rosbag2_recorder",
    "rosbag2_player",
)


@dataclass(frozen=True)
class CommandSubscriber:
    """A robot that takes commands: its node's full name, and the type it takes."""

    node: str
    kind: str


def command_subscribers(node: Node, topic: str) -> list[CommandSubscriber]:
    """Return who takes commands on ``topic`` (its full name), without those that only observe."""
    found = []
    for end in node.get_subscriptions_info_by_topic(topic):
        observes = end.node_name.startswith("_") or end.node_name in _OBSERVERS
        if end.topic_type in _TYPES and not observes:
            name = f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            found.append(CommandSubscriber(name, end.topic_type))
    return found


def command_topics(node: Node) -> tuple[str, ...]:
    """Return all topics of commands, the ones with subscribers first."""
    named = [
        name
        for name, kinds in node.get_topic_names_and_types()
        if any(kind in _TYPES for kind in kinds)
    ]
    return tuple(sorted(named, key=lambda name: (not command_subscribers(node, name), name)))


def foreign_type(node: Node, topic: str) -> str:
    """Return the type of a topic, in full, that exists with others than commands' only; or "".

    The commands of ``node`` itself do not count.
    """
    ends = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
    own = node.get_name(), node.get_namespace()
    kinds = {
        end.topic_type
        for end in ends
        if (end.node_name, end.node_namespace) != own or end.topic_type not in _TYPES
    }
    return "" if kinds & _TYPES.keys() else ", ".join(sorted(kinds))


class CommandTopic:
    """Publishes commands, as the type that the robot takes; from any thread.

    One node can publish one type on a topic only, and whoever finds another one there cannot tell
    any more which it is. So there is no publisher before the robot's type is known, unless somebody
    drives already.

    Attributes:
        topic: in full.
        kind: its type.
        subscribers: who takes commands there.
    """

    def __init__(self, node: Node, topic: str) -> None:
        """Begin with ``topic``, a name in full."""
        self._node = node
        self._lock = threading.Lock()
        self._publisher: Any = None
        self._wanted = False  # somebody drives
        self.topic = topic
        self.kind = "geometry_msgs/msg/Twist"
        self.subscribers: list[CommandSubscriber] = []

    def publish(self, velocity: Velocity) -> None:
        """Send a command, if there is anything to send it with."""
        with self._lock:
            self._wanted = True
            if self._publisher is not None:
                self._publisher.publish(self._message(velocity))

    def choose(self, topic: str) -> None:
        """Publish on another topic from now on; the robot of the old one is stopped."""
        self._leave()
        self.topic, self.subscribers, self._wanted = topic, [], False
        self.update()

    def update(self) -> None:
        """Follow the type that the robot takes; to be called some times a second."""
        self.subscribers = command_subscribers(self._node, self.topic)
        foreign = foreign_type(self._node, self.topic)
        if foreign:  # whoever looks there must not find commands' type
            self._leave()
            if self._wanted:
                self._warn_of_type(foreign)
            return
        kinds = {robot.kind for robot in self.subscribers}
        if kinds and self.kind not in kinds:
            self._leave()
            self.kind = min(kinds)
        if self._publisher is None and (kinds or self._wanted):
            self._enter()

    def flush(self) -> None:
        """Wait until what was sent has arrived, but not long."""
        publisher = self._publisher
        if publisher is not None and publisher.get_subscription_count():
            publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _warn_of_type(self, kind: str) -> None:
        self._node.get_logger().warning(
            f"{self.topic} holds {kind}, not Twist or TwistStamped: nothing is sent",
            throttle_duration_sec=_WARN_EVERY,
        )

    def _enter(self) -> None:
        try:
            publisher = self._node.create_publisher(_TYPES[self.kind], self.topic, _DEPTH)
        except RCLError:
            # The last one, of the other type, is not gone yet; the next update tries again.
            return
        with self._lock:
            self._publisher = publisher

    def _leave(self) -> None:
        publisher = self._publisher
        if publisher is None:
            return
        if self._wanted:
            for _ in range(ZEROS):
                self.publish(Velocity())
            self.flush()
        with self._lock:
            self._publisher = None
        self._node.destroy_publisher(publisher)

    def _message(self, velocity: Velocity) -> Any:
        message = _TYPES[self.kind]()
        twist = message
        if isinstance(message, TwistStamped):
            message.header.stamp = self._node.get_clock().now().to_msg()
            twist = message.twist
        twist.linear.x, twist.angular.z = velocity.linear, velocity.angular
        return message


# How fast the steered robot may go, asked of its controller.

_ANSWER_BY = 5.0  # s; a controller that is alive answers at once
_LIMITS = ("linear.x.max_velocity", "angular.z.max_velocity")
_DOUBLE, _INTEGER = 3, 2  # rcl_interfaces/msg/ParameterType


class ControllerLimits:
    """Asks the robot's controller how fast it may go, by its parameters."""

    def __init__(self, node: Node) -> None:
        """Ask nobody yet."""
        self._node = node
        self._asked = ""
        self._since = 0.0
        self._client: Any = None
        self._answer: Any = None

    def update(self, robots: Iterable[CommandSubscriber]) -> Velocity | None:
        """Ask, if it is a new robot; return its limits, once, as soon as they are there.

        A limit that it does not tell, or that is none, comes out as NaN.
        """
        names = [robot.node for robot in robots]
        if not names:  # the next one is a new one, whatever its name
            self._drop()
            self._asked = ""
        elif self._asked not in names:
            self._drop()
            self._asked = names[0]
            service = f"{self._asked}/get_parameters"
            self._client = self._node.create_client(GetParameters, service)
        if self._client is None:
            return None
        if self._answer is not None and time.monotonic() - self._since > _ANSWER_BY:
            self._forget()  # whom it was sent to may have died, and come back, since then
        if self._answer is None and self._client.service_is_ready():
            self._answer = self._client.call_async(GetParameters.Request(names=_LIMITS))
            self._since = time.monotonic()
        if self._answer is None or not self._answer.done():
            return None
        values = [_parameter_number(value) for value in self._answer.result().values]
        self._drop()
        return Velocity(*values) if len(values) == len(_LIMITS) else Velocity(math.nan, math.nan)

    def _forget(self) -> None:
        self._client.remove_pending_request(self._answer)
        self._answer = None

    def _drop(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
        self._client = self._answer = None


def _parameter_number(value: Any) -> float:
    number = {_DOUBLE: value.double_value, _INTEGER: value.integer_value}.get(value.type, math.nan)
    return float(number) if math.isfinite(number) and number > 0.0 else math.nan


# The odometry that the steering page shows.


_ODOMETRY = "nav_msgs/msg/Odometry"
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class OdometryTopic:
    """Subscribes to the robot's odometry.

    Attributes:
        topic: its full name; "" while there is none.
    """

    def __init__(self, node: Node, fixed: str) -> None:
        """Subscribe to ``fixed``, a full name, or else ("") to what ``update`` finds."""
        self._node, self._fixed = node, fixed
        self._subscription: TopicSubscription | None = None
        self._data: tuple[bytes, float] | None = None
        self.topic = ""

    def update(self, commands: str) -> None:
        """Follow the robot that takes ``commands``; to be called some times a second.

        Its odometry is the sibling "odom" of that topic, or else the only Odometry there is.
        """
        wanted = self._fixed or self._found(commands)
        if wanted != self.topic:
            self._change(wanted)
        if self._subscription is not None:
            # A topic of another type may have the right one later.
            with contextlib.suppress(TypeConflictError):
                self._subscription.update(_ODOMETRY, _LATEST)

    def _change(self, topic: str) -> None:
        if self._subscription is not None:
            self._subscription.close()
        self.topic, self._data = topic, None
        self._subscription = (
            TopicSubscription(self._node, topic, self._receive, lambda _: Odometry)
            if topic
            else None
        )

    def fields(self) -> dict[str, Any] | None:
        """Return the latest as the page's state has it: m, rad, m/s, rad/s, and its age in s.

        None if there is none, if it cannot be decoded, or if its numbers are not finite.
        """
        data = self._data
        if data is None:
            return None
        try:
            sample = odometry_sample(data[0])
        except ValueError:
            return None
        values = {
            "x": float(sample.translation[0]),
            "y": float(sample.translation[1]),
            "yaw": yaw_of(*sample.rotation.tolist()),
            "linear": float(sample.linear[0]),
            "angular": float(sample.angular[2]),
            "age": time.monotonic() - data[1],
        }
        if not all(map(math.isfinite, values.values())):
            return None
        rounded = {name: round(value, 6) for name, value in values.items()}
        return {"topic": self.topic, **rounded}

    def _receive(self, _: str, data: bytes) -> None:
        self._data = data, time.monotonic()

    def _found(self, commands: str) -> str:
        known = [
            name
            for name, kinds in self._node.get_topic_names_and_types()
            if _ODOMETRY in kinds and self._node.count_publishers(name)
        ]
        sibling = f"{commands.rpartition('/')[0]}/odom"
        return sibling if sibling in known else known[0] if len(known) == 1 else ""


_CHECK_PERIOD = 0.05  # s between checks that the driver is still there
_UPDATE_PERIOD = 0.25  # s between queries of the ROS graph
_SHORT = 8  # characters of a token that can be guessed


class SteeringPage(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Serve the page.

        Raises:
            OneBotError: a parameter is wrong.
        """
        super().__init__("steering_page")
        self._server: ServerThread | None = None
        self._refuse: Callable[[str, str], None] = lambda page, why: None
        self._settings = settings = SteeringParameters.of(self)
        self._commands = CommandTopic(self, settings.topic)
        self._odometry = OdometryTopic(self, settings.odom_topic)
        self._controller = ControllerLimits(self)
        self._topics: tuple[str, ...] = ()
        self._wishes: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()  # page, topic
        self._helm = Helm(USUAL, self._commands.publish, settings.ceiling)
        self._helm.set_limits(settings.limits())
        self._view = ViewProxy()
        self._viewers = 0
        self._refused = 0
        self._page_topic = settings.viewer_page
        self.create_subscription(String, self._page_topic, self._on_viewer, LATCHED)
        self._serve()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / settings.rate, self._helm.tick, clock=steady)
        self.create_timer(_CHECK_PERIOD, self._check, clock=steady)
        self.create_timer(_UPDATE_PERIOD, self._update, clock=steady)

    # --- the page -------------------------------------------------------------------------------

    def _serve(self) -> None:
        wanted, rate = self._settings.port, self._settings.rate
        listener = listen(self._settings.host, wanted)
        address, port = listener.getsockname()[:2]
        if wanted not in (0, port):
            self.get_logger().warning(f"port {wanted} is in use; using {port} instead")
        access = Access(self._token(address), address, port)
        cockpit = Cockpit(
            self._helm, access, self._view, self._robot, self._wish, self._warn_refused, rate
        )
        server = SteeringServer(cockpit)
        self._server = thread = ServerThread(server.app, listener)
        self._helm.changed = lambda: thread.call(server.tell)
        self._refuse = lambda page, why: thread.call(lambda: server.refuse(page, why))
        query = f"/?token={quote(access.token, safe='')}" if access.token else ""
        url = f"http://{reachable_as(listener)}{query}"
        # Not by the logger: what that says goes to /rosout, and is no place for a token.
        print(f"open {url}", flush=True)
        if self._settings.open_browser and has_display():
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    def _token(self, address: str) -> str:
        given = self._settings.token
        if is_loopback(address):
            return given
        if given and len(given) < _SHORT:
            self.get_logger().warning("the token is short: whoever guesses it can drive the robot")
        self.get_logger().warning(
            "other computers can reach the page: whoever knows its address can drive the robot, and"
            " whoever listens on the network between learns it (an SSH tunnel keeps it private)"
        )
        return given or new_token()

    def _wish(self, page: str, topic: str) -> None:
        self._wishes.put((page, topic))

    def _warn_refused(self, problem: str) -> None:
        self._refused += 1
        self.get_logger().warning(
            f"refused a message of a page ({self._refused} so far): {problem}",
            throttle_duration_sec=_WARN_EVERY,
        )

    def _robot(self) -> Robot:
        commands = self._commands
        return Robot(
            commands.topic,
            commands.kind,
            self._topics,
            len(commands.subscribers),
            self._odometry.fields(),
        )

    # --- the robot ------------------------------------------------------------------------------

    def _check(self) -> None:
        lapses = self._helm.lapses
        self._helm.check()
        if self._helm.lapses > lapses:
            self.get_logger().warning(
                "stopped: the page that drives fell silent", throttle_duration_sec=_WARN_EVERY
            )
        while not self._wishes.empty():
            self._choose(*self._wishes.get())

    def _choose(self, page: str, name: str) -> None:
        topic = str(self.resolve_topic_name(name))
        if topic == self._commands.topic:
            return
        kind = foreign_type(self, topic)
        if kind:
            self._refuse(page, f"{topic} holds {kind}, not Twist or TwistStamped: choose another.")
        else:
            self._helm.halt()
            self._commands.choose(topic)
            self._update()

    def _update(self) -> None:
        """Follow what comes and goes on the ROS graph."""
        before = self._commands.kind, self._commands.topic, len(self._commands.subscribers)
        self._commands.update()
        self._odometry.update(self._commands.topic)
        self._topics = command_topics(self)
        found = self._controller.update(self._commands.subscribers)
        if found is not None:
            self._helm.set_limits(self._settings.limits(found))
        if self._view.view is not None and not self.count_publishers(self._page_topic):
            self._show(None)
        after = self._commands.kind, self._commands.topic, len(self._commands.subscribers)
        if before != after:
            self._helm.changed()

    def _on_viewer(self, message: String) -> None:
        self._viewers += bool(message.data)
        view = View.parse(message.data, self._viewers)
        if message.data and view is None:
            self.get_logger().warning(f"{self._page_topic} names no page on this computer")
        self._show(view)

    def _show(self, view: View | None) -> None:
        self._view.view = view
        self._helm.changed()

    def destroy_node(self) -> None:
        """Stop the robot, then the server and the node."""
        if self._server is not None:
            self._server.stop()
            self._helm.halt()
            self._commands.flush()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(SteeringPage, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
