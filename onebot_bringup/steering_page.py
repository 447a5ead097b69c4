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

import queue
import sys
import threading
import webbrowser
from collections.abc import Callable
from urllib.parse import quote

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import String

from onebot_bringup.steering.access import Access, new_token
from onebot_bringup.steering.addresses import is_loopback, listen, reachable_as
from onebot_bringup.steering.helm import Helm
from onebot_bringup.steering.server import Cockpit, Robot, SteeringServer
from onebot_bringup.steering.serving import ServerThread
from onebot_bringup.steering.view_proxy import View, ViewProxy
from onebot_bringup.steering_limits import ControllerLimits
from onebot_bringup.steering_odometry import OdometryTopic
from onebot_bringup.steering_parameters import USUAL, SteeringParameters
from onebot_bringup.steering_topics import CommandTopic, command_topics, foreign_type
from onebot_bringup.viewer.serving import has_display
from onebot_description.qos import LATCHED
from onebot_description.ros import run_node

_WATCH_PERIOD = 0.05  # s between looks at whether the driver is still there
_LOOK_PERIOD = 0.25  # s between looks at the ROS graph
_WARN_EVERY = 5.0  # s
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
        self.create_timer(_WATCH_PERIOD, self._watch, clock=steady)
        self.create_timer(_LOOK_PERIOD, self._look, clock=steady)

    # --- the page -------------------------------------------------------------------------------

    def _serve(self) -> None:
        wanted, rate = self._settings.port, self._settings.rate
        listener = listen(self._settings.host, wanted)
        address, port = listener.getsockname()[:2]
        if wanted not in (0, port):
            self.get_logger().warning(f"port {wanted} is in use; using {port} instead")
        access = Access(self._token(address), address, port)
        cockpit = Cockpit(
            self._helm, access, self._view, self._robot, self._wish, self._complain, rate
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

    def _complain(self, problem: str) -> None:
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
            len(commands.listeners),
            self._odometry.fields(),
        )

    # --- the robot ------------------------------------------------------------------------------

    def _watch(self) -> None:
        lapses = self._helm.lapses
        self._helm.watch()
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
            self._look()

    def _look(self) -> None:
        """Follow what comes and goes on the ROS graph."""
        before = self._commands.kind, self._commands.topic, len(self._commands.listeners)
        self._commands.look()
        self._odometry.look(self._commands.topic)
        self._topics = command_topics(self)
        found = self._controller.look(self._commands.listeners)
        if found is not None:
            self._helm.set_limits(self._settings.limits(found))
        if self._view.view is not None and not self.count_publishers(self._page_topic):
            self._show(None)
        after = self._commands.kind, self._commands.topic, len(self._commands.listeners)
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
