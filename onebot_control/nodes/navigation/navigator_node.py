"""The navigator's node: it passes measurements to the navigator, and publishes the results."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node
from std_msgs.msg import String

from onebot_control.navigation.footprint import Vehicle, footprint_of, vehicle_of
from onebot_control.navigation.goals import Goal, Goals
from onebot_control.navigation.map_files import load_map
from onebot_control.navigation.navigator import Navigator
from onebot_control.navigation.parameters import NavigatorParameters
from onebot_control.nodes.command_controllers import Controllers
from onebot_control.nodes.navigation.actions import ACTIONS, Context, NavigationAction
from onebot_control.nodes.navigation.lifecycle import offer_lifecycle
from onebot_control.nodes.navigation.maps import PLANAR, MapTopics
from onebot_control.nodes.navigation.measurements import (
    COMMAND_TOPIC,
    Commands,
    Measurements,
    TimedOdometry,
)
from onebot_control.nodes.robot_services import planar_pose
from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.matrices import to_planar
from onebot_description.geometry.poses import PlanarPose, about_z
from onebot_description.parameters.reader import read
from onebot_description.ros.command_line import ros_args
from onebot_description.ros.description_topic import DescriptionTopic
from onebot_description.ros.names import node_name
from onebot_description.ros.node_parameters import declare
from onebot_description.ros.run_node import ends_node, steady_timer
from onebot_description.ros.topic_qos import DEPTH, LATCHED
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import time_message, transforms_message
from onebot_description.timing.throttled import Throttled

_POLL = 0.5  # s between polls for controllers
_PATIENCE = 5.0  # s to wait for the limits of a controller before using defaults
_WORDS = {"failed": "gave up"}  # words that replace the navigator's status
_STATUS_PERIOD = 0.5  # s between two messages on ~/status


class NavigatorNode(Node):
    """The node; ``onebot_control.navigator`` lists its topics, actions and services."""

    def __init__(self, file: str | None = None, arguments: Sequence[str] | None = None) -> None:
        """Wait for the robot.

        Args:
            file: URDF or xacro file of the robot; None for the topic robot_description.
            arguments: ROS arguments of the node; None: those of the process.

        Raises:
            OneBotError: the file, the map or a parameter is not valid.
        """
        super().__init__("navigator", cli_args=ros_args(arguments))
        values = declare(self, NavigatorParameters)
        self._settings = read(NavigatorParameters, values)
        map_file = self._settings.yaml_filename
        self._known = load_map(Path(map_file)) if map_file else None
        self._description: Description | None = load_description(file) if file else None
        self._navigator: Navigator | None = None
        self._vehicle: Vehicle | None = None
        self._told, self._line = -math.inf, ""
        self._warn = Throttled(lambda text: self.get_logger().warning(text))
        self._polls = 0  # number of polls since there have been subscribers to commands
        self._measured = Measurements(self, self._stop)
        self._commands = Commands(self, self._stop)
        self._controllers = Controllers(self, self._find_vehicle)
        self._tf = self.create_publisher(TFMessage, "/tf", DEPTH)
        self._status = self.create_publisher(String, "~/status", LATCHED)
        self._goals = Goals(self._ready, self._prepare, self.get_logger())
        self._maps = MapTopics(self, self._ready, self._stop)
        context = Context(self, self._goals, self._maps, self._in_map, self._ready, self._prepare)
        self._actions = [NavigationAction(context, row) for row in ACTIONS]
        self.create_subscription(PoseStamped, "goal_pose", self._on_goal, DEPTH)
        estimate = PoseWithCovarianceStamped
        self.create_subscription(estimate, "initialpose", self._on_initial_pose, DEPTH)
        DescriptionTopic(self, lambda: self._description, self._on_description)
        offer_lifecycle(self, lambda: self._navigator is not None)
        self.create_timer(1.0 / self._settings.controller_frequency, ends_node(self._update))
        steady_timer(self, _POLL, self._look_for_controllers)

    # Start --------------------------------------------------------------------------------------

    def _ready(self) -> Navigator:
        if self._navigator is None:
            raise OneBotError(f"the navigator is waiting for {self._missing()}")
        return self._navigator

    def _missing(self) -> str:
        if self._description is None:
            return "the topic robot_description"
        if self._measured.motion is None:
            return "odometry"
        return f"a robot that subscribes to {self.resolve_topic_name(COMMAND_TOPIC)}"

    def _on_description(self, description: Description) -> None:
        footprint_of(description)  # raises OneBotError
        self._description = description
        self._find_vehicle()

    def _look_for_controllers(self) -> None:
        names = {node_name(end) for end in self._commands.subscribers()}
        names -= {"", self.get_fully_qualified_name()}
        self._controllers.update(names)
        self._polls = self._polls + 1 if names else 0
        if self._vehicle is None:
            self._find_vehicle()

    def _find_vehicle(self) -> None:
        """Combine footprint and limits once both are known; they may change later."""
        limits = self._controllers.known
        waited = self._polls * _POLL > _PATIENCE
        if self._description is None or not (limits or waited):
            return
        self._vehicle = vehicle = vehicle_of(self._description, limits)
        speeds = f"{vehicle.forward:g} m/s and {vehicle.turning:g} rad/s"
        if not limits:
            text = "no controller with velocity limits subscribes to the commands: using the limits"
            self.get_logger().warning(f"{text} {speeds}")
        if self._navigator is not None:
            self._navigator.use_vehicle(vehicle)

    def _start(self, motion: TimedOdometry) -> None:
        assert self._vehicle is not None
        start = self._settings.initial_pose
        self._navigator = Navigator(
            self._vehicle,
            PlanarPose(start.x, start.y, start.yaw).compose(motion.pose),
            parameters=self._settings,
            known=self._known,
        )
        size = np.ptp(self._vehicle.footprint, axis=0)
        self.get_logger().info(
            f"navigating a robot of {size[0]:.2f} x {size[1]:.2f} m at up to "
            f"{self._vehicle.forward:g} m/s, {'in a given map' if self._known else 'mapping'}"
        )

    # The cycle ----------------------------------------------------------------------------------

    def _update(self) -> None:
        motion = self._measured.motion
        if motion is None or self._vehicle is None:
            return
        if self._navigator is None:
            self._start(motion)
        navigator = self._ready()
        scan, turn = self._measured.take_scan(), self._measured.take_turn()
        command = navigator.update(motion.time, motion.pose, motion.speed, scan=scan, turn=turn)
        self._publish_transform(navigator, motion)
        if self._goals.active:
            self._commands.publish(command)
        self._goals.step()
        self._maps.step(navigator)
        self._tell(navigator)

    def _publish_transform(self, navigator: Navigator, motion: TimedOdometry) -> None:
        pose = navigator.pose.compose(motion.pose.inverse())
        values = np.array([[pose.x, pose.y, 0.0, *about_z(pose.yaw)]])
        frames = (self._settings.global_frame,), (motion.odom_frame,)
        self._tf.publish(transforms_message(time_message(motion.stamp_ns), *frames, values))

    def _tell(self, navigator: Navigator) -> None:
        """Publish the status when it changes, and regularly the remaining distance."""
        status = _WORDS.get(navigator.status, navigator.status)
        line = f"{status}: {navigator.reason}" if navigator.reason else status
        if navigator.status == "blocked":
            self._warn("blocked", line)
        if navigator.status == "driving":
            if 0.0 <= navigator.time - self._told < _STATUS_PERIOD and self._line.startswith(line):
                return
            remaining = navigator.distance_remaining
            line = f"{line}, {remaining:.1f} m, {remaining / navigator.vehicle.forward:.0f} s"
        if line != self._line:
            self._line, self._told = line, navigator.time
            self._status.publish(String(data=line))

    # Requests -----------------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Prepare to drive; raise OneBotError if the robot cannot."""
        self._ready()
        if self._measured.locked:
            raise OneBotError("the robot is locked: unlock it first from where it was stopped")
        if self.count_publishers("amcl_pose") > 1:
            raise OneBotError("another node navigates or localizes this robot, too: stop one")
        self._commands.prepare()

    def _stop(self, reason: str) -> None:
        self._goals.cancel(reason)

    def _on_goal(self, message: PoseStamped) -> None:
        try:
            self._goals.start(Goal([self._in_map(message)]))
        except OneBotError as error:
            self.get_logger().error(f"goal_pose is rejected: {error}")

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        stamped = PoseStamped(header=message.header, pose=message.pose.pose)
        covariance = np.asarray(message.pose.covariance, float).reshape(6, 6)[PLANAR]
        try:
            navigator, pose = self._ready(), self._in_map(stamped)
            if not np.isfinite(covariance).all():
                raise OneBotError("the covariance is not finite")
            self._stop("the robot was placed in the map")
            navigator.place(pose, covariance)
            self._maps.publish_pose(navigator)
        except OneBotError as error:
            self.get_logger().error(f"initialpose is rejected: {error}")

    def _in_map(self, message: PoseStamped) -> PlanarPose:
        """Convert a pose in any frame to the map.

        Raises:
            OneBotError: it is not finite, or its frame is not in TF.
        """
        pose = planar_pose(message)
        if not all(map(math.isfinite, pose)):
            raise OneBotError("the pose is not finite, or its quaternion is not normalized")
        frame = message.header.frame_id.removeprefix("/")
        if frame in ("", self._settings.global_frame):
            return pose
        return to_planar(self._measured.pose(self._settings.global_frame, frame)).compose(pose)

    def destroy_node(self) -> None:
        """Stop the robot, then destroy the node."""
        if self._goals.active:
            self._goals.cancel("the navigator ends")
            self._commands.publish((0.0, 0.0, 0.0))
        super().destroy_node()
