"""What velocity_controller does: a robot that is driven, as topics, services and parameters."""

import gc
import math
import time
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_loop import ControlLoop
from onebot_control.drive import Drive, geometry_of
from onebot_control.joint_state_broadcaster import JointStateBroadcaster
from onebot_control.ros_command_topic import CommandTopic
from onebot_control.ros_parameters import ControlParameters
from onebot_control.ros_pose_topics import PoseTopics
from onebot_control.ros_publishers import Publishers
from onebot_control.ros_services import Services
from onebot_description.description import Description, load_description, parse_description
from onebot_description.errors import OneBotError
from onebot_description.joints.problems import ConfigError
from onebot_description.ros_arguments import RosArguments
from onebot_description.ros_description import DescriptionTopic, described_by, is_path
from onebot_description.throttle import Throttled

_LOOK_EVERY = 0.1  # s between looks at who publishes commands
_TOO_LATE = 0.05  # s of lag worth a warning


class Driving:
    """Drives the robot of a node, whose docstring says what it publishes, subscribes and takes."""

    def __init__(self, node: Node, arguments: RosArguments) -> None:
        """Declare and announce everything; ``start`` starts.

        Args:
            node: velocity_controller.
            arguments: parameter files and the names of parameters set on the command line.

        Raises:
            OneBotError: the parameters cannot be used.
        """
        self._node = node
        self._loop: ControlLoop | None = None
        self._failure: BaseException | None = None
        self._warn = Throttled(node.get_logger().warning)
        self._settings = ControlParameters(node, arguments)
        config = self._settings.config
        self._simulated = node.get_parameter("use_sim_time").value or config.real_time_factor != 1.0
        self._output = Publishers(node, self._simulated)
        self._commands = CommandTopic(node, config.cmd_vel_type, self._on_command, self._warn)
        PoseTopics(node, self._robot, lambda: self._output.odom_frame, self._warn)
        Services(node, self._robot)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._accept)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_LOOK_EVERY, self._look, clock=steady)

    def start(self, file: str | None) -> None:
        """Drive the robot whose description is at hand, or wait for one on the topic.

        Raises:
            OneBotError: the description cannot be used.
        """
        text = self._settings.values["robot_description"]
        if file:
            self._drive(load_description(file))
        elif text:
            self._drive(described_by(text))
        if not file and not is_path(text):
            DescriptionTopic(self._node, self._on_description, lambda: self._loop is not None)

    def stop(self) -> None:
        """Stop the control loop, and with it the robot."""
        if self._loop is not None:
            self._loop.stop()

    def _drive(self, description: Description) -> None:
        try:
            drive = Drive.of(description, self._settings.config)
        except ConfigError as error:
            raise self._settings.located(error) from None
        self._output.use(drive)
        self._loop = ControlLoop(
            drive,
            self._output.publish,
            simulated=self._simulated,
            late=self._say_late,
            failed=self._fail,
        )
        # From here on, what lives need not be looked through for garbage again and again.
        gc.freeze()
        self._loop.start()
        # Only now: a process's first line of log takes rclpy 20 ms.
        for warning in description.warnings:
            self._node.get_logger().warning(warning)
        separation, radius = drive.geometry
        self._node.get_logger().info(
            f'driving robot "{description.robot_name}": wheels {separation:g} m apart, of radius '
            f"{radius:g} m"
        )

    def _robot(self) -> ControlLoop | None:
        return self._loop

    def _on_description(self, urdf: str) -> None:
        loop = self._loop
        if loop is not None and loop.drive.description.urdf == urdf:
            return
        try:
            description = parse_description(urdf, "robot_description")
            if loop is None:
                self._drive(description)
            elif description.urdf != loop.drive.description.urdf:
                loop.call(lambda: self._replace(loop, description))
                self._node.get_logger().info("changed robot description taken up")
        except OneBotError as error:
            if loop is None:
                raise
            self._node.get_logger().error(
                f"robot description refused, going on as before:\n{error}"
            )

    def _replace(self, loop: ControlLoop, description: Description) -> None:
        drive = loop.drive.replaced(description)
        self._output.use(drive)
        loop.use(drive)

    # Commands --------------------------------------------------------------------------------

    def _on_command(self, linear: float, angular: float, stamp: int | None) -> None:
        loop = self._loop
        if loop is None:
            return
        if stamp == 0:
            text = "~/cmd_vel has stamp 0, which is taken as now (said once)"
            self._warn("stamp", text, every=math.inf)
        now = loop.now_ns() if self._simulated else time.time_ns()
        age = (now - stamp) * 1e-9 if stamp else 0.0
        loop.post(lambda: self._take(loop.drive, linear, angular, age))

    def _take(self, drive: Drive, linear: float, angular: float, age: float) -> None:
        refused = drive.accept(linear, angular, age)
        if refused:
            self._warn("command", f"~/cmd_vel is ignored: {refused}")

    # Parameters ------------------------------------------------------------------------------

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            config = self._settings.changed(parameters, self._simulated)
            if self._loop is not None:
                drive = self._loop.drive
                geometry_of(drive.description, config)
                JointStateBroadcaster(config.broadcaster, drive.plant.joints)
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, parameters: Sequence[Parameter]) -> None:
        before = self._settings.config
        self._settings.accept(parameters)
        config, loop = self._settings.config, self._loop
        if config == before:
            return
        if config.cmd_vel_type != before.cmd_vel_type:
            self._commands.choose(config.cmd_vel_type)
        if loop is not None:

            def take_up() -> None:
                loop.drive.configure(config)
                loop.set_factor(config.real_time_factor)
                self._output.use(loop.drive)

            loop.call(take_up)

    # What is said ----------------------------------------------------------------------------

    def _look(self) -> None:
        if self._failure is not None:
            raise self._failure
        self._commands.follow()

    def _fail(self, error: BaseException) -> None:
        self._failure = error

    def _say_late(self, lag: float) -> None:
        if lag > _TOO_LATE:
            text = f"control cycles were left out for {lag:.3f} s: the machine is too busy"
            self._warn("late", text)
