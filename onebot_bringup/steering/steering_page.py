#!/usr/bin/env python3
"""A page in the browser to drive a robot from, with its 3D view: like rqt_robot_steering.

The robot stops as soon as no control is held. If this node dies, the robot's controller stops
it after its cmd_vel_timeout.

Publishes:
    the parameter topic (geometry_msgs/Twist or TwistStamped, as the robot subscribes, reliable,
        depth 10): linear.x in m/s and angular.z in rad/s, at ``rate`` while a control is held; then
        three zero commands, and nothing more, so that other nodes can drive.

Subscribes:
    odometry (nav_msgs/Odometry, best effort, depth 1): see odom_topic.
    the parameter viewer_page (std_msgs/String, latched): the address of rerun_viewer's page.

Calls:
    get_parameters of the robot's controller, for its limits.

Parameters:
    host (string, "127.0.0.1"): the address to serve the page on. If other computers can reach it,
        the page's address has a token.
    port (int, 8080): another one if it is in use, 0 for any.
    token (string, ""): required in the page's address; generated where one is needed.
    topic (string, "velocity_controller/cmd_vel"): the initial command topic.
    odom_topic (string, ""): "" for the sibling "odom" of the topic, or else the only Odometry.
    rate (double, 20.0 Hz): of commands; 5 to 100.
    max_linear (double, 0.0 m/s), max_angular (double, 0.0 rad/s): the upper bound of commands; 0.0
        for the controller's linear.x.max_velocity and angular.z.max_velocity, or else 1.0 and 2.0,
        as initial limits.
    viewer_page (string, "rerun_viewer/page"): the topic with the address of the view.
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

from onebot_bringup.serving.http_server import ServerThread
from onebot_bringup.serving.ports import is_loopback, listen, reachable_as
from onebot_bringup.steering.access import Access, new_token
from onebot_bringup.steering.arbiter import ZEROS, ThreadSafeArbiter
from onebot_bringup.steering.protocol import Velocity
from onebot_bringup.steering.server import (
    RobotStatus,
    ServerContext,
    SteeringServer,
)
from onebot_bringup.steering.view_proxy import View, ViewProxy
from onebot_bringup.viewer.display_server import has_display
from onebot_control.poses import yaw_of
from onebot_description.errors import OneBotError
from onebot_description.node import LATCHED, run_node
from onebot_description.parameters.reader import declare, parameter, read, refuse_undeclared
from onebot_description.parameters.values import MAX_PORT
from onebot_description.topic_subscription import RCLError, TopicSubscription, TypeConflictError
from onebot_description.wire.messages import odometry_sample

DEFAULT_LIMITS = Velocity(1.0, 2.0)  # if neither a parameter nor the controller sets them
_MIN_RATE, _MAX_RATE = 5.0, 100.0  # Hz
_TIMEOUT_PERIOD = 0.05  # s between checks of the driver's timeout
_GRAPH_PERIOD = 0.25  # s between polls of the ROS graph
_WARN_EVERY = 5.0  # s
_SHORT_TOKEN = 8  # characters; a token shorter than this can be guessed

_TOPICS = ("topic", "odom_topic", "viewer_page")  # parameters that are names of topics
_TYPES = {"geometry_msgs/msg/Twist": Twist, "geometry_msgs/msg/TwistStamped": TwistStamped}
_DEPTH = 10
_OBSERVERS = (  # they subscribe to commands, but are not robots
    "rerun_viewer",
    "steering_viewer",
    "bag_recorder",
    "rosbag2_recorder",
    "rosbag2_player",
)

_RESPONSE_TIMEOUT = 5.0  # s; a running controller responds at once
_LIMITS = ("linear.x.max_velocity", "angular.z.max_velocity")
_DOUBLE, _INTEGER = 3, 2  # rcl_interfaces/msg/ParameterType

_ODOMETRY = "nav_msgs/msg/Odometry"
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def _limit(unit: str) -> Any:
    description = f"upper bound of commands, {unit}; 0: the controller's limit"
    return parameter(0.0, description, at_least=0.0, read_only=True)


@dataclass(frozen=True)
class SteeringParameters:
    """The parameters of the node; topics are full names, "" for none."""

    host: str = parameter(
        "127.0.0.1",
        "address to serve the page on; 0.0.0.0: for other computers, too",
        read_only=True,
    )
    port: int = parameter(
        8080, "another one if it is in use; 0: any", at_least=0, at_most=MAX_PORT, read_only=True
    )
    token: str = parameter(
        "", "required in the page's address; generated where one is needed", read_only=True
    )
    topic: str = parameter(
        "velocity_controller/cmd_vel",
        "initial command topic, Twist or TwistStamped",
        not_empty=True,
        write="the name of the topic to steer",
        read_only=True,
    )
    odom_topic: str = parameter("", "Odometry to show; empty: the robot's own", read_only=True)
    rate: float = parameter(
        20.0, "of commands, Hz", at_least=_MIN_RATE, at_most=_MAX_RATE, read_only=True
    )
    max_linear: float = _limit("m/s")
    max_angular: float = _limit("rad/s")
    viewer_page: str = parameter(
        "rerun_viewer/page", "the topic with the address of the view", read_only=True
    )
    open_browser: bool = parameter(True, "open the page, if there is a display", read_only=True)

    @classmethod
    def of(cls, node: Node) -> "SteeringParameters":
        """Declare the parameters on ``node`` and return their values.

        Raises:
            OneBotError: a value is invalid.
        """
        given = read(cls, declare(node, cls))
        refuse_undeclared(node, cls)
        topics: dict[str, Any] = {n: _topic(node, n, getattr(given, n)) for n in _TOPICS}
        return replace(given, **topics)

    @property
    def fixed(self) -> Velocity:
        """The upper bound of commands, m/s and rad/s; 0 for the controller's limit."""
        return Velocity(self.max_linear, self.max_angular)

    @property
    def ceiling(self) -> Velocity:
        """The upper bound of the limits that pages can set."""
        return Velocity(self.fixed.linear or math.inf, self.fixed.angular or math.inf)

    def limits(self, found: Velocity = DEFAULT_LIMITS) -> Velocity:
        """Return the initial limits: the parameters, the controller's, or the default ones.

        Args:
            found: the controller's limits, m/s and rad/s; NaN where it has none.
        """
        return Velocity(
            self.fixed.linear
            or (DEFAULT_LIMITS.linear if math.isnan(found.linear) else found.linear),
            self.fixed.angular
            or (DEFAULT_LIMITS.angular if math.isnan(found.angular) else found.angular),
        )


def _topic(node: Node, name: str, text: str) -> str:
    try:
        return str(node.resolve_topic_name(text)) if text else ""
    except Exception as error:  # rclpy raises several types, none of them public
        reason = " ".join(str(error).split("\n")[0].split())
        raise OneBotError(f"{name}: {text} is not a valid topic name: {reason}") from None


@dataclass(frozen=True)
class CommandSubscriber:
    """A node that subscribes to commands."""

    node: str  # full name
    kind: str  # the type that it subscribes to


def command_subscribers(node: Node, topic: str) -> list[CommandSubscriber]:
    """Return the nodes that subscribe to commands on ``topic``, without observers."""
    found = []
    for end in node.get_subscriptions_info_by_topic(topic):
        observes = end.node_name.startswith("_") or end.node_name in _OBSERVERS
        if end.topic_type in _TYPES and not observes:
            name = f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            found.append(CommandSubscriber(name, end.topic_type))
    return found


def command_topics(node: Node) -> tuple[str, ...]:
    """Return all topics of commands, those with subscribers first."""
    named = [
        name
        for name, kinds in node.get_topic_names_and_types()
        if any(kind in _TYPES for kind in kinds)
    ]
    return tuple(sorted(named, key=lambda name: (not command_subscribers(node, name), name)))


def foreign_type(node: Node, topic: str) -> str:
    """Return the type of a topic that exists only with other types than commands; else "".

    The publisher of ``node`` itself does not count.
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
    """Publishes commands with the type that the robot subscribes to; from any thread.

    A node can publish only one type on a topic, and a second type on a topic confuses other tools.
    So the publisher is created when the robot's type is known, or when a page drives.
    """

    def __init__(self, node: Node, topic: str) -> None:
        """Start with ``topic``, a full name."""
        self._node = node
        self._lock = threading.Lock()
        self._publisher: Any = None
        self._driven = False  # a page has driven
        self.topic = topic
        self.kind = "geometry_msgs/msg/Twist"
        self.subscribers: list[CommandSubscriber] = []  # the nodes that subscribe to the topic

    def publish(self, velocity: Velocity) -> None:
        """Publish a command, if there is a publisher."""
        with self._lock:
            self._driven = True
            if self._publisher is not None:
                self._publisher.publish(self._message(velocity))

    def choose(self, topic: str) -> None:
        """Switch to another topic; the robot of the old one is stopped."""
        self._destroy_publisher()
        self.topic, self.subscribers, self._driven = topic, [], False
        self.update()

    def update(self) -> None:
        """Adapt to the type that the robot subscribes to; to be called several times per second."""
        self.subscribers = command_subscribers(self._node, self.topic)
        foreign = foreign_type(self._node, self.topic)
        if foreign:  # do not add a second type to the topic
            self._destroy_publisher()
            if self._driven:
                self._warn_foreign_type(foreign)
            return
        kinds = {robot.kind for robot in self.subscribers}
        if kinds and self.kind not in kinds:
            self._destroy_publisher()
            self.kind = min(kinds)
        if self._publisher is None and (kinds or self._driven):
            self._create_publisher()

    def flush(self) -> None:
        """Wait shortly until all commands are acknowledged."""
        publisher = self._publisher
        if publisher is not None and publisher.get_subscription_count():
            publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _warn_foreign_type(self, kind: str) -> None:
        self._node.get_logger().warning(
            f"{self.topic} has the type {kind}, not Twist or TwistStamped: nothing is published",
            throttle_duration_sec=_WARN_EVERY,
        )

    def _create_publisher(self) -> None:
        try:
            publisher = self._node.create_publisher(_TYPES[self.kind], self.topic, _DEPTH)
        except RCLError:
            # The last publisher, of the other type, still exists; the next update tries again.
            return
        with self._lock:
            self._publisher = publisher

    def _destroy_publisher(self) -> None:
        publisher = self._publisher
        if publisher is None:
            return
        if self._driven:
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


class ControllerLimits:
    """Requests the velocity limits of the robot's controller, from its parameters."""

    def __init__(self, node: Node) -> None:
        """Start without a controller."""
        self._node = node
        self._controller = ""
        self._since = 0.0
        self._client: Any = None
        self._answer: Any = None

    def update(self, robots: Iterable[CommandSubscriber]) -> Velocity | None:
        """Request the limits of a new robot; return them once, when they are received.

        A limit that is not set, or not above zero, is NaN.
        """
        names = [robot.node for robot in robots]
        if not names:  # the next one is a new one, even with the same name
            self._drop()
            self._controller = ""
        elif self._controller not in names:
            self._drop()
            self._controller = names[0]
            service = f"{self._controller}/get_parameters"
            self._client = self._node.create_client(GetParameters, service)
        if self._client is None:
            return None
        if self._answer is not None and time.monotonic() - self._since > _RESPONSE_TIMEOUT:
            self._forget()  # the controller may have been restarted since then
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


class OdometryTopic:
    """Subscribes to the robot's odometry."""

    def __init__(self, node: Node, fixed: str) -> None:
        """Subscribe to ``fixed``, a full name, or else ("") to what ``update`` finds."""
        self._node, self._fixed = node, fixed
        self._subscription: TopicSubscription | None = None
        self._data: tuple[bytes, float] | None = None
        self.topic = ""  # full name; "" for none

    def update(self, commands: str) -> None:
        """Follow the robot that subscribes to ``commands``; to be called several times per second.

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
        """Return the latest odometry for the page's state: m, rad, m/s, rad/s, and its age in s.

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


class SteeringPage(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        """Serve the page.

        Raises:
            OneBotError: a parameter is invalid.
        """
        super().__init__("steering_page")
        self._server: ServerThread | None = None
        self._show_error: Callable[[str, str], None] = lambda page, why: None
        self._settings = settings = SteeringParameters.of(self)
        self._commands = CommandTopic(self, settings.topic)
        self._odometry = OdometryTopic(self, settings.odom_topic)
        self._controller = ControllerLimits(self)
        self._topics: tuple[str, ...] = ()
        self._requests: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()  # page, topic
        self._arbiter = ThreadSafeArbiter(DEFAULT_LIMITS, self._commands.publish, settings.ceiling)
        self._arbiter.set_limits(settings.limits())
        self._view = ViewProxy()
        self._rejected = 0
        self._page_topic = settings.viewer_page
        self.create_subscription(String, self._page_topic, self._on_viewer, LATCHED)
        self._serve()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / settings.rate, self._arbiter.tick, clock=steady)
        self.create_timer(_TIMEOUT_PERIOD, self._check_driver, clock=steady)
        self.create_timer(_GRAPH_PERIOD, self._poll_graph, clock=steady)

    def _serve(self) -> None:
        wanted, rate = self._settings.port, self._settings.rate
        listener = listen(self._settings.host, wanted)
        address, port = listener.getsockname()[:2]
        if wanted not in (0, port):
            self.get_logger().warning(f"port {wanted} is in use; using {port} instead")
        access = Access(self._token(address), address, port)
        context = ServerContext(
            self._arbiter,
            access,
            self._view,
            self._robot,
            self._request_topic,
            self._report_rejected,
            rate,
        )
        server = SteeringServer(context)
        self._server = thread = ServerThread(server.app, listener, "steering")
        self._arbiter.changed = lambda: thread.call(server.notify)
        self._show_error = lambda page, why: thread.call(lambda: server.show_error(page, why))
        query = f"/?token={quote(access.token, safe='')}" if access.token else ""
        url = f"http://{reachable_as(listener)}{query}"
        # Not by the logger, which publishes on /rosout: the token must not get there.
        print(f"open {url}", flush=True)
        if self._settings.open_browser and has_display():
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    def _token(self, address: str) -> str:
        given = self._settings.token
        if is_loopback(address):
            return given
        if given and len(given) < _SHORT_TOKEN:
            self.get_logger().warning(
                "the token is short: anyone who guesses it can drive the robot"
            )
        self.get_logger().warning(
            "other computers can reach the page: anyone with its address can drive the robot, and"
            " the address is not encrypted on the network (use an SSH tunnel to keep it private)"
        )
        return given or new_token()

    def _request_topic(self, page: str, topic: str) -> None:
        self._requests.put((page, topic))

    def _report_rejected(self, problem: str) -> None:
        self._rejected += 1
        self.get_logger().warning(
            f"rejected a message of a page ({self._rejected} so far): {problem}",
            throttle_duration_sec=_WARN_EVERY,
        )

    def _robot(self) -> RobotStatus:
        commands = self._commands
        return RobotStatus(
            commands.topic,
            commands.kind,
            self._topics,
            len(commands.subscribers),
            self._odometry.fields(),
        )

    def _check_driver(self) -> None:
        timeouts = self._arbiter.timeouts
        self._arbiter.check_timeout()
        if self._arbiter.timeouts > timeouts:
            self.get_logger().warning(
                "stopped: no message from the page that drives", throttle_duration_sec=_WARN_EVERY
            )
        while not self._requests.empty():
            self._choose(*self._requests.get())

    def _choose(self, page: str, name: str) -> None:
        topic = str(self.resolve_topic_name(name))
        if topic == self._commands.topic:
            return
        kind = foreign_type(self, topic)
        if kind:
            self._show_error(
                page, f"{topic} has the type {kind}, not Twist or TwistStamped: choose another."
            )
        else:
            self._arbiter.halt()
            self._commands.choose(topic)
            self._poll_graph()

    def _poll_graph(self) -> None:
        """Update topics, subscribers and limits from the ROS graph."""
        before = self._commands.kind, self._commands.topic, len(self._commands.subscribers)
        self._commands.update()
        self._odometry.update(self._commands.topic)
        self._topics = command_topics(self)
        found = self._controller.update(self._commands.subscribers)
        if found is not None:
            self._arbiter.set_limits(self._settings.limits(found))
        if self._view.view is not None and not self.count_publishers(self._page_topic):
            self._set_view(None)
        after = self._commands.kind, self._commands.topic, len(self._commands.subscribers)
        if before != after:
            self._arbiter.changed()

    def _on_viewer(self, message: String) -> None:
        view = View.parse(message.data)
        if message.data and view is None:
            self.get_logger().warning(
                f"{self._page_topic} has no address of a page on this computer",
                throttle_duration_sec=_WARN_EVERY,
            )
        self._set_view(view)

    def _set_view(self, view: View | None) -> None:
        self._view.view = view
        self._arbiter.changed()

    def destroy_node(self) -> None:
        """Stop the robot, then the server and the node."""
        if self._server is not None:
            self._server.stop()
            self._arbiter.halt()
            self._commands.flush()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(SteeringPage, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
