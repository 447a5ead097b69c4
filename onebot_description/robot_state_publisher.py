#!/usr/bin/env python3
"""robot_state_publisher: publishes a robot's description, and its transforms from joint states.

Run it alone with ``python -m onebot_description.robot_state_publisher [FILE] --ros-args ...``.
FILE is a URDF or xacro file, which replaces the parameter robot_description; when it, or a file
that it includes, is edited, the new description is published. An unusable edit is reported, and the
last valid description stays. To publish several robots from one process:
``... --robot -r __ns:=/robot1 --robot -r __ns:=/robot2 --ros-args ...``; ROS arguments that follow
--robot apply to one node. Their files are not watched.

Publishes:
    robot_description (std_msgs/msg/String, reliable, transient local, depth 1): the URDF.
    /tf (tf2_msgs/msg/TFMessage, reliable, depth 100): joints that move, stamped as their message.
    /tf_static (tf2_msgs/msg/TFMessage, reliable, transient local, depth 1): all other joints.

Subscribes:
    joint_states (sensor_msgs/msg/JointState, best effort, depth 5): positions in rad or m; a
        message older than the last one of its joints is ignored; if it is older by 10 s or more,
        the clock is taken to have been set back.

All parameters can be changed while it runs; an invalid change is rejected with the reason.
JointState has no poses: planar joints are published at their origin, as static transforms.
Floating joints are published only with hold_floating_joints, because usually another node, such as
an odometry node, publishes their transforms.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys
import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.description import Description, parse_description
from onebot_description.description.loading import keep_places
from onebot_description.description_files import DescriptionFiles, Source, load_followed
from onebot_description.errors import OneBotError, listing
from onebot_description.model import RobotModel
from onebot_description.parameters.reader import read
from onebot_description.ros.command_line import RosArguments, ros_args, split_robots
from onebot_description.ros.description_topic import warn_of_two_robots
from onebot_description.ros.node_graph import check_discovery_server
from onebot_description.ros.node_parameters import declare, follow_changes, refuse_undeclared
from onebot_description.ros.run_node import run_described_node, steady_timer
from onebot_description.ros.stamp_check import StampCheck
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.state_converter import StateConverter
from onebot_description.state_parameters import StateParameters
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled

_POLL_EVERY = 0.1  # s between polls of the description's files
_LONGEST_NS = 2.0**61  # 73 years: the compiled call adds it to a stamp
_FOLLOW = "--follow"  # the option with which a bringup passes a Source


class RobotStatePublisher(Node):
    """The node robot_state_publisher; the module's docstring lists its topics."""

    def __init__(
        self,
        description: Description | None = None,
        arguments: Sequence[str] | None = None,
        source: Source | None = None,
    ) -> None:
        """Start publishing.

        Args:
            description: the robot; None to use the parameter robot_description.
            arguments: ROS arguments of this node alone.
            source: the files that the description was read from, to publish edits of them.

        Raises:
            OneBotError: the description or a parameter cannot be used.
        """
        super().__init__("robot_state_publisher", cli_args=ros_args(arguments))
        self._warn = Throttled(self.get_logger().warning)
        fixed = {} if description is None else {"robot_description": description.urdf}
        self._values = declare(self, StateParameters, fixed=fixed)
        self._settings = read(StateParameters, self._values)
        self._tf = self.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self._tf_static = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        if description is None:
            description = _parse(self._settings.robot_description)
        # Keep the validated description so a live change is not parsed twice.
        self._accepted = description, RobotModel.from_description(description)
        self._apply_description()
        self._apply()
        refuse_undeclared(self, StateParameters)
        follow_changes(self, self._validate, self._changed)
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
            ),
            post_callback=self._clock_jumped,
        )
        self._check = StampCheck.from_topic(self, "joint_states")
        self.create_subscription(
            JointState, "joint_states", self._on_joint_state, qos_profile_sensor_data, raw=True
        )
        warn_of_two_robots(self, own=True)
        if source is not None:
            self._files = DescriptionFiles(source)
            steady_timer(self, _POLL_EVERY, self._follow_files)

    def _follow_files(self) -> None:
        """Publish the robot again when its files are edited; ignore unusable edits."""
        logger = self.get_logger()
        try:
            description = self._files.poll()
            if description is None:
                return
            keep_places(description)
            is_new = description.urdf != self._accepted[0].urdf
            if is_new:
                self._accepted = description, RobotModel.from_description(description)
                self.set_parameters([Parameter("robot_description", value=description.urdf)])
        except OneBotError as error:
            logger.error(f"{error}\nThe robot stays as it was until this is fixed.")
            return
        # Log no more than this: every other node logs whether the new robot suits it.
        new_robot = "robot_state_publisher publishes the new robot"
        outcome = new_robot if is_new else "the robot is unchanged"
        logger.info(f"{self._files.edited}: edited, {outcome}")
        self._files.applied()

    def _apply(self) -> None:
        """Apply the current parameters to the conversion of joint states."""
        frequency = self._settings.publish_frequency
        self._converter = StateConverter(
            self._model,
            frame_prefix=self._settings.frame_prefix,
            interval_ns=round(min(NS_PER_S / frequency, _LONGEST_NS)) if frequency else 0,
            ignore_timestamp=self._settings.ignore_timestamp,
            warn=self._warn,
        )
        floating = self._settings.hold_floating_joints
        transforms = self._converter.static_transforms(self._now_ns(), floating=floating)
        self._tf_static.publish(transforms)

    def _apply_description(self) -> None:
        """Publish the accepted description, and use it for transforms from now on."""
        description, self._model = self._accepted
        for notice in description.notices:
            self.get_logger().warning(notice)
        links = self._model.floating
        if links and not self._settings.hold_floating_joints:
            self.get_logger().warning(
                f"the transforms of floating joints are not published, because joint states have "
                f"no poses: another node, such as an odometry node, has to publish that of "
                f"{listing(links)}"
            )
        self._description.publish(String(data=description.urdf))

    def _changes(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        return {
            parameter.name: parameter.value
            for parameter in parameters
            if parameter.name in self._values
        }

    def _validate(self, parameters: Sequence[Parameter]) -> None:
        changes = self._changes(parameters)
        read(StateParameters, {**self._values, **changes})
        urdf = changes.get("robot_description", self._accepted[0].urdf)
        if urdf != self._accepted[0].urdf:
            description = _parse(urdf)
            self._accepted = description, RobotModel.from_description(description)

    def _changed(self, parameters: Sequence[Parameter]) -> None:
        changes = self._changes(parameters)
        self._values |= changes
        self._settings = read(StateParameters, self._values)
        if "robot_description" in changes:
            self._apply_description()
            self.get_logger().info(f'now publishing robot "{self._model.name}"')
        if changes:
            self._apply()

    def _on_joint_state(self, data: bytes) -> None:
        now_ns = time.time_ns()
        message = self._converter.convert_bytes(data, now_ns)
        if message is not None:
            self._tf.publish(message)
        self._check.take_bytes(data, now_ns)

    def _clock_jumped(self, _jump: TimeJump) -> None:
        self._warn("clock", "the clock was set back; publishing the joints' transforms afresh")
        self._converter.forget_times()

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)


def _parse(urdf: str) -> Description:
    if not urdf.strip():
        raise OneBotError(
            "the parameter robot_description is empty: give a URDF or xacro file as argument, or "
            "the URDF's text with --params-file or -p robot_description:=..."
        )
    return parse_description(urdf, "robot_description")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    common, robots = split_robots(sys.argv if args is None else args)
    followed = None
    if _FOLLOW in common:
        at = common.index(_FOLLOW)
        followed = Source.from_json(common[at + 1])
        del common[at : at + 2]

    def make_nodes(file: str | None, _: RosArguments) -> list[RobotStatePublisher]:
        description, source = (None, followed) if file is None else load_followed(file)
        nodes = [RobotStatePublisher(description, words) for words in robots]
        nodes = nodes or [RobotStatePublisher(description, source=source)]
        # Every bringup has exactly one such process.
        check_discovery_server(nodes)
        return nodes

    return run_described_node(
        "robot_state_publisher", __doc__, StateParameters, make_nodes, args=common
    )


if __name__ == "__main__":
    sys.exit(main())
