#!/usr/bin/env python3
"""Serves a page in the browser to drive a robot from, with its 3D view, like rqt_robot_steering.

The robot stops as soon as no control is held. Stop also locks it, so that it ignores other nodes'
commands, too, until a page drives again. If this node dies, the robot's controller stops
the robot after its cmd_vel_timeout. Joints that a joint_trajectory_controller moves have a slider
each; they are sent trajectories of 0.3 s, which end at rest.

Publishes:
    the parameter topic (geometry_msgs/Twist or TwistStamped, as the robot subscribes, reliable,
        depth 10): linear.x in m/s and angular.z in rad/s, and linear.y in m/s for a drive that goes
        sideways, at ``rate`` while a control is held; then three zero commands, and nothing more,
        so that other nodes can drive.
    the same topic with the suffix _lock (std_msgs/Bool): true while a page stops the robot, false
        before a page drives a locked one; likewise controller_manager/cmd_vel_lock, if it exists,
        before a page moves joints.
    joint_trajectory (trajectory_msgs/JointTrajectory) of each joint_trajectory_controller in the
        robot's namespace: at ``rate`` while a slider of its joints is held, then three to stop.
    goal_pose (geometry_msgs/PoseStamped), initialpose (PoseWithCovarianceStamped), clicked_point
        (PointStamped), in the namespace of the robot that is steered: the page's tools.
    page_cameras (std_msgs/String, latched) of the viewer: see rerun_viewer.

Subscribes:
    the parameter topic with the suffix _locked (std_msgs/Bool, latched): whether the robot is
        locked; likewise controller_manager/cmd_vel_locked.
    controller_state (control_msgs/JointTrajectoryControllerState) of each
        joint_trajectory_controller in the robot's namespace: while there is a page.
    odometry (nav_msgs/Odometry): see odom_topic.
    the parameter viewer_page (std_msgs/String, latched): the address of rerun_viewer's page.
    displays (std_msgs/String, latched) of the same node: the topics that the view shows.
    /tf, /tf_static, map (nav_msgs/OccupancyGrid), each LaserScan in the robot's namespace: while a
        page shows its map.
    robot_description (std_msgs/String), each LaserScan and Range in the robot's namespace: while
        there is a page. Each Image there: while a page shows it, and once to read its encoding.

Calls:
    list_parameters and get_parameters of the nodes that subscribe to commands, every two seconds:
        nodes with velocity limits, or a drive's lengths, are the robot's controllers.
    the parameter services of the viewer, and of the node whose parameters a page shows.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any
from urllib.parse import quote

from rclpy.node import Node

from onebot_bringup.serving.http_server import ServerThread
from onebot_bringup.serving.ports import is_loopback, listen, open_in_browser, reachable_as
from onebot_bringup.steering.access import Access, token_for
from onebot_bringup.steering.arbiter import Arbiter
from onebot_bringup.steering.camera import CameraFeed
from onebot_bringup.steering.command_limits import braking_of, limits_of
from onebot_bringup.steering.command_topic import (
    CommandedRobot,
    CommandTopic,
    command_topics,
    commanded_robots,
    namespace_of,
)
from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace
from onebot_bringup.steering.ground import Ground
from onebot_bringup.steering.joint_commands import JointCommands
from onebot_bringup.steering.obstacles import Obstacles
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_bringup.steering.page_parameters import PageParameters
from onebot_bringup.steering.protocol import Command, Parts, Velocity
from onebot_bringup.steering.server import SteeringServer
from onebot_bringup.steering.tool_requests import OtherThread, ToolRequests
from onebot_bringup.steering.tools import ToolPublishers
from onebot_bringup.steering.view_proxy import Viewer, ViewProxy
from onebot_control.nodes.command_controllers import Controllers
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import read
from onebot_description.ros.node_parameters import declare, refuse_undeclared
from onebot_description.ros.run_node import full_name, run_node, steady_timer
from onebot_description.timing.throttled import Throttled
from onebot_description.timing.wake_detector import WAKE

_TIMEOUT_PERIOD = 0.05  # s between checks of the driver's timeout
_GRAPH_PERIOD = 0.25  # s between polls of the ROS graph
_LONGEST = 300  # characters of the navigator's state
_LONGEST_TOPIC = 200  # characters; DDS has a limit of 255, and the lock's name is longer
_TEXT = "std_msgs/msg/String"

_TOPICS = ("topic", "odom_topic", "viewer_page")  # parameters that are names of topics


def parameters_of(node: Node) -> PageParameters:
    """Return the node's parameters with full topic names."""
    settings = read(PageParameters, declare(node, PageParameters))
    refuse_undeclared(node, PageParameters)
    topics: dict[str, Any] = {n: _topic(node, n, getattr(settings, n)) for n in _TOPICS}
    return replace(settings, **topics)


def _topic(node: Node, name: str, text: str) -> str:
    topic = full_name(node, text) if text else ""
    if len(topic) > _LONGEST_TOPIC:
        raise OneBotError(f"{name}: {text} has more than {_LONGEST_TOPIC} characters")
    return topic


class SteeringPage(Node):
    """The node; see the module's docstring."""

    def __init__(self) -> None:
        super().__init__("steering_page")
        self._server: ServerThread | None = None
        self._settings = settings = parameters_of(self)
        self._fixed = Velocity(settings.max_linear, settings.max_angular, settings.max_linear)
        self._commands = CommandTopic(self, settings.topic, self._on_lock)
        self._topics = topics = FollowedTopics(self)
        self._odometry = odometry = OdometryTopic(topics, settings.odom_topic)
        self._controllers = Controllers(self, self._on_controllers)
        self._braking: Mapping[str, Any] = {}  # braking limits by axis
        self._command_topics: tuple[str, ...] = ()
        self._robots: tuple[CommandedRobot, ...] = ()
        self._joints = JointCommands(topics, self._on_lock)
        self._arbiter = Arbiter(
            limits_of((), self._fixed), self._command, self._lock, woke=WAKE.certain
        )
        self._viewer = Viewer(self, settings.viewer_page)
        self._warn = Throttled(self.get_logger().warning)
        self._timeouts = 0  # number of timeouts logged so far
        self._ground = Ground(topics, odometry)
        self._cameras = CameraFeed(topics)
        self._obstacles = Obstacles(topics, odometry, lambda: self._arbiter.state.command.velocity)
        self._thread = OtherThread(self)
        self._serve()
        self._await_view_until = time.monotonic() + settings.await_view
        self._announce()
        steady_timer(self, 1.0 / settings.rate, self._arbiter.tick)
        steady_timer(self, _TIMEOUT_PERIOD, self._check_driver)
        steady_timer(self, _GRAPH_PERIOD, self._poll_graph)

    def _serve(self) -> None:
        settings = self._settings
        listener = listen(settings.host, settings.port)
        address, port = listener.getsockname()[:2]
        if settings.port not in (0, port):
            self.get_logger().warning(f"port {settings.port} is in use; using {port} instead")
        if not is_loopback(address):
            self.get_logger().warning(
                "other computers can reach the page: anyone with its address can drive the robot,"
                " and the address crosses the network unencrypted (an SSH tunnel keeps it private)"
            )
        access = Access(token_for(address, settings.token), address, port)
        publishers = ToolPublishers(self, self._commands)
        tools = ToolRequests(
            self._thread, self._commands, self._ground, self._cameras, publishers, self._nodes
        )
        server = SteeringServer(
            arbiter=self._arbiter,
            access=access,
            view=ViewProxy(self._viewer),
            tools=tools,
            robot=self._robot,
            choose_topic=lambda topic: self._thread.call(partial(self._choose, topic)),
            logger=self.get_logger(),
        )
        self._server = ServerThread(server.app, listener, "steering")
        query = f"/?token={quote(access.token, safe='')}" if access.token else ""
        self._url = f"http://{reachable_as(listener)}{query}"

    def _announce(self) -> None:
        """Print the page's address and open it, once, when the view is there or late."""
        if self._viewer.view is None and time.monotonic() < self._await_view_until:
            return
        url, self._url = self._url, ""
        if not url:
            return
        # Do not use the logger, since it would publish the token on /rosout.
        print(f"open {url}", flush=True)
        if self._settings.open_browser:
            open_in_browser(url)

    def _robot(self) -> Mapping[str, Any]:
        """Return the node's part of a page's state."""
        commands, robot = self._commands, self._obstacles.robot
        return {
            "topic": commands.topic,
            "topic_type": commands.kind,
            "topics": self._command_topics,  # command topics to choose from
            "robots": [asdict(robot) for robot in self._robots],  # robots to choose from
            "robot_name": robot.robot_name if robot is not None else "",  # name in the description
            "listeners": len(commands.listeners),
            "others": [node for node in commands.others if node != self._navigator],
            "navigation": self._navigation(),  # state of the robot's navigator
            # Locked wheels or joints ignore all commands until a page moves them again.
            "locked": commands.locked or self._joints.locked,
            "wheels_locked": commands.locked,
            "joints": self._joints.fields(),
            "controllers": self._controllers.names,  # the nodes whose limits are known
            "braking": self._braking,
            "odometry": self._odometry.fields(),
            "cameras": self._cameras.topics,  # the topics of its cameras' pictures
            "legend": self._viewer.legend,  # the legend of the view
            "obstacle": self._obstacles.clearance,  # m until the robot meets an obstacle
        }

    @property
    def _navigator(self) -> str:
        return f"{namespace_of(self._commands.topic)}/navigator"

    def _navigation(self) -> str:
        """Return what the navigator does; empty if there is none, or it has had no goal yet."""
        message = self._topics.newest(f"{self._navigator}/status").message
        return "" if message is None or message.data == "idle" else str(message.data)[:_LONGEST]

    def _nodes(self) -> Mapping[str, Any]:
        first = self._controllers.names
        services = (name.rpartition("/") for name, _ in self.get_service_names_and_types())
        nodes = sorted({node for node, _, service in services if service == "list_parameters"})
        return {"nodes": sorted(nodes, key=lambda node: node not in first), **self._viewer.fields()}

    def _check_driver(self) -> None:
        self._arbiter.check_timeout()
        if self._timeouts != self._arbiter.timeouts:
            self._timeouts = self._arbiter.timeouts
            self._warn(
                "timeout", "stopped: no message from the page that drives, or one that is too old"
            )

    def _choose(self, name: str) -> None:
        topic = _topic(self, "topic", name)
        if topic == self._commands.topic:
            return
        self._arbiter.halt()
        self._controllers.forget()
        self._commands.choose(topic)
        self._poll_graph()

    def _poll_graph(self) -> None:
        commands = self._commands
        robots = self._controllers.names
        commands.update(robots)
        self._controllers.update(end.node for end in commands.subscribers)
        self._command_topics = command_topics(self)
        self._robots = commanded_robots(self)
        name = namespace_of(commands.topic)
        other_spaces = {namespace_of(robot.topic) for robot in self._robots} - {name}
        namespace, watched = RobotNamespace(name, other_spaces), self._arbiter.state.pages > 0
        status = f"{self._navigator}/status"
        framed = self._ground.needed(namespace) | self._obstacles.needed(namespace, watched)
        self._topics.update_transforms(len(framed) > 1)  # more than the description
        self._topics.update(
            framed
            | self._odometry.needed(commands.topic, robots)
            | ({status: _TEXT} if self.count_publishers(status) else {})
            | self._cameras.needed(namespace, watched)
            | self._joints.needed(namespace, self._obstacles.robot, watched)
        )
        self._viewer.publish_cameras(self._cameras.topics)
        self._viewer.update()
        self._announce()

    def _command(self, command: Command) -> None:
        self._commands.publish(command.velocity)
        self._joints.publish(command.joints)

    def _lock(self, locked: bool, parts: Parts) -> None:
        if Parts.WHEELS in parts:
            self._commands.lock(locked)
        if Parts.JOINTS in parts:
            self._joints.lock(locked)

    def _on_lock(self, locked: bool) -> None:
        """Require the page that drove to release, and drive again, to unlock the robot."""
        if locked:
            self._arbiter.halt()

    def _on_controllers(self) -> None:
        controllers = self._controllers.known
        self._braking = {
            "linear": braking_of(controller.linear for controller in controllers),
            "lateral": braking_of(controller.lateral for controller in controllers),
        }
        limits = limits_of(controllers, self._fixed)
        self._arbiter.set_limits(limits)
        if len(controllers) > 1:
            names = ", ".join(self._controllers.names)
            self.get_logger().warning(
                f"{len(controllers)} controllers subscribe to {self._commands.topic} ({names}):"
                " each gets every command, within the strictest of their limits:"
                f" {limits.linear.forward:g} m/s, {limits.angular.forward:g} rad/s"
            )

    def destroy_node(self) -> None:
        """Stop the robot, then the server and the node."""
        if self._server is not None:
            self._thread.close()
            self._server.stop()
            self._arbiter.halt()
            self._commands.flush()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node until Ctrl-C."""
    return run_node(SteeringPage, args, whole_graph=True)


if __name__ == "__main__":
    sys.exit(main())
