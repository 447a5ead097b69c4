#!/usr/bin/env python3
"""robot_state_publisher: joint states in, the robot's transforms out.

Run it alone with ``python -m onebot_description.robot_state_publisher [FILE] --ros-args ...``;
FILE is a URDF or xacro file, in place of the parameter robot_description.

Publishes:
    robot_description (std_msgs/msg/String, reliable, transient local, depth 1): the URDF.
    /tf (tf2_msgs/msg/TFMessage, reliable, depth 100): joints that move, stamped as their message.
    /tf_static (tf2_msgs/msg/TFMessage, reliable, transient local, depth 1): those that do not.

Subscribes:
    joint_states (sensor_msgs/msg/JointState, best effort, depth 5): positions in rad or m.

Parameters (all can be changed while it runs):
    robot_description (string, required unless FILE is given): the URDF.
    publish_frequency (double, Hz, default 0.0): the most often a joint is published; 0.0 is every
        message. 0 to 1000.
    ignore_timestamp (bool, default false): publish whatever the stamp says.
    frame_prefix (string, default ""): prepended as it is to every frame.

Floating and planar joints are published at their origin, static: no JointState tells their pose.
"""

import sys
import time
from collections.abc import Sequence

from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_description.description import (
    Description,
    load_description,
    parse_description,
)
from onebot_description.errors import OneBotError
from onebot_description.model import RobotModel
from onebot_description.node import LATCHED, Throttled, ros_arguments, run_node
from onebot_description.wire.cdr import NANO, WireError
from onebot_description.wire.messages import joint_state_arrays, to_message
from onebot_description.wire.state_converter import StateConverter
from onebot_description.wire.tf_message import TFMessage


class RobotStatePublisher(Node):
    """See the module's docstring for what it publishes, subscribes and takes."""

    def __init__(self, description: Description | None = None) -> None:
        """Start publishing ``description``, or else the parameter robot_description.

        Raises:
            DescriptionError: the description cannot be used.
            OneBotError: there is none.
        """
        super().__init__("robot_state_publisher")
        self._warn = Throttled(self.get_logger().warning)
        self._declare(description)
        self._tf = self.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self._tf_static = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        if description is None:
            description = _parse(self.get_parameter("robot_description").value)
        # The validated text of a live change, so that it need not be parsed twice.
        self._accepted = description
        self._take_up_description()
        self._apply(self._values())
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._changed)
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
            ),
            post_callback=self._clock_jumped,
        )
        self.create_subscription(
            JointState, "joint_states", self._on_joint_state, qos_profile_sensor_data, raw=True
        )

    def _declare(self, description: Description | None) -> None:
        self.declare_parameter(
            "robot_description",
            "" if description is None else description.urdf,
            ParameterDescriptor(
                type=ParameterType.PARAMETER_STRING, description="The robot's URDF."
            ),
            ignore_override=description is not None,
        )
        self.declare_parameter(
            "publish_frequency",
            0.0,
            ParameterDescriptor(
                type=ParameterType.PARAMETER_DOUBLE,
                description="The most often a joint is published, in Hz; 0.0 is every message.",
                floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1000.0)],
            ),
        )
        self.declare_parameter(
            "ignore_timestamp",
            False,
            ParameterDescriptor(description="Publish joint states whatever their stamp says."),
        )
        self.declare_parameter(
            "frame_prefix",
            "",
            ParameterDescriptor(description="Prepended to every frame as it is."),
        )

    def _values(self) -> dict[str, object]:
        names = ("publish_frequency", "ignore_timestamp", "frame_prefix")
        return {name: self.get_parameter(name).value for name in names}

    def _apply(self, values: dict[str, object]) -> None:
        """Serve the robot with these parameters from now on."""
        frequency = float(values["publish_frequency"])  # type: ignore[arg-type]
        self._converter = StateConverter(
            self._model,
            frame_prefix=str(values["frame_prefix"]),
            interval_ns=round(NANO / frequency) if frequency else 0,
            ignore_timestamp=bool(values["ignore_timestamp"]),
            warn=self._warn,
        )
        self._tf_static.publish(self._converter.static_transforms(self._now_ns()))

    def _take_up_description(self) -> None:
        """Make the accepted description the one that is served."""
        self._model = RobotModel.from_description(self._accepted)
        for warning in self._accepted.warnings:
            self.get_logger().warning(warning)
        self._description.publish(String(data=self._accepted.urdf))

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == "robot_description":
                try:
                    self._accepted = _parse(parameter.value)
                except OneBotError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _changed(self, parameters: Sequence[Parameter]) -> None:
        names = {parameter.name for parameter in parameters}
        if "robot_description" in names:
            self._take_up_description()
            self.get_logger().info(f'now publishing robot "{self._accepted.robot_name}"')
        if names & {"robot_description", *self._values()}:
            self._apply(self._values())

    def _on_joint_state(self, data: bytes) -> None:
        try:
            message = self._converter.convert_bytes(data, time.time_ns())
        except WireError:
            self._on_unusual(data)
            return
        if message is not None:
            self._tf.publish(message)

    def _on_unusual(self, data: bytes) -> None:
        """Take bytes the fast way does not know through ordinary messages, to the same result."""
        try:
            state = deserialize_message(data, JointState)
        except Exception as error:  # Fast CDR's errors reach Python in several types
            self._warn("bytes", f"joint state that cannot be read is ignored: {error}")
            return
        result = self._converter.convert(joint_state_arrays(state), time.time_ns())
        if result is not None:
            self._tf.publish(to_message(result))

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
    """Run the node; returns the exit code."""
    files = ros_arguments(sys.argv if args is None else args).others

    def make_node() -> RobotStatePublisher:
        if len(files) > 1:
            raise OneBotError(f"expected one URDF or xacro file, not {len(files)}: {files}")
        return RobotStatePublisher(load_description(files[0]) if files else None)

    return run_node(make_node, args, events=True)


if __name__ == "__main__":
    sys.exit(main())
