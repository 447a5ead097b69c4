#!/usr/bin/env python3
"""velocity_controller: simulates a robot and drives it by velocity commands.

Run it alone with ``python -m onebot_control.velocity_controller [FILE] --ros-args ...``; FILE is a
URDF or xacro file. Without it, the description is the parameter or the topic robot_description.
Without --params-file, OneBot's control.yaml is used. Simulation, diff_drive_controller and
joint_state_broadcaster are one process: nothing moves on when it is killed.

Subscribes:
    ~/cmd_vel (geometry_msgs/msg/Twist or TwistStamped, reliable, depth 10): m/s and rad/s;
        linear.x and angular.z count. See cmd_vel_type.
    ~/teleport (geometry_msgs/msg/PoseStamped, depth 10): puts the robot there, at rest; frame_id is
        world_frame_id (or empty) or the odometry's. The odometry takes no notice.
    ~/set_odometry (geometry_msgs/msg/PoseStamped, depth 10): makes the odometry say this pose.
    robot_description (std_msgs/msg/String, transient local): the URDF, unless FILE or a path as
        the parameter gives it; a changed one is taken up where the robot stands.

Publishes (reliable, depth 10, if not said otherwise):
    joint_states (sensor_msgs/msg/JointState): every control cycle; rad, rad/s, Nm.
    ~/odom (nav_msgs/msg/Odometry): pose and twist by the wheels, at publish_rate.
    ~/ground_truth (nav_msgs/msg/Odometry): the true ones, with ~/odom.
    /tf (tf2_msgs/msg/TFMessage): odom_frame_id -> base_frame_id, with ~/odom.
    /tf_static (tf2_msgs/msg/TFMessage, transient local): world_frame_id -> odom_frame_id.
    ~/cmd_vel_out (geometry_msgs/msg/TwistStamped): the limited command, every control cycle, if
        publish_limited_velocity.
    /clock (rosgraph_msgs/msg/Clock): simulated time, every control cycle, if use_sim_time is true
        or real_time_factor is not 1.0 at the start; then all stamps are simulated time. Else they
        are the system's, and there is no /clock.

Services:
    ~/reset (std_srvs/srv/Trigger): back to the beginning: x, y, yaw, odometry zero, no command.
    ~/reset_odometry (std_srvs/srv/Trigger): odometry zero here and now.
    ~/pause (std_srvs/srv/SetBool): true stops simulated time, false lets it go on.
    ~/step (std_srvs/srv/Trigger): one control cycle of a paused simulation.

Parameters: those of diff_drive_controller, and (* is read at the start only)
    cmd_vel_type (string, default auto): Twist, TwistStamped, or auto: the one that is published.
    robot_description* (string, default ""): the URDF to start with, before the topic tells one, or
        the path of a URDF or xacro file.
    x*, y* (double, m), yaw* (double, rad; default 0.0): where the robot starts in the world.
    update_rate* (double or integer, Hz, default 100): control cycles; controller_manager's.
    real_time_factor (double, default 1.0): simulated seconds a second; 0.0 is as fast as possible.
    world_frame_id (string, default world): frame of ~/ground_truth and parent of odom_frame_id;
        empty gives the truth in the odometry's frame and leaves odom_frame_id without parent.
    joint_state_broadcaster.joints, .interfaces, .extra_joints (string[]), .frame_id (string,
        default base_link): joint_state_broadcaster's.
left_wheel_names* and right_wheel_names* are required; wheel_separation and wheel_radius (double, m)
are read from the URDF where they are 0.0, the default. A change of any parameter takes effect at
once, or is refused with the reason.
"""

import gc
import math
import sys
import time
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_files import default_control_file, read_control_files
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
from onebot_description.node_main import run_described_node
from onebot_description.ros_arguments import RosArguments
from onebot_description.ros_description import DescriptionTopic, described_by, is_path
from onebot_description.throttle import Throttled

_LOOK_EVERY = 0.1  # s between looks at who publishes commands
_TOO_LATE = 0.05  # s of lag worth a warning
# s after which the interpreter hands its lock to the control thread; 5 ms by default.
_SWITCH_INTERVAL = 0.0005


class VelocityController(Node):
    """See the module's docstring for what it publishes, subscribes and takes."""

    def __init__(self, file: str | None = None, arguments: RosArguments | None = None) -> None:
        """Start driving as soon as the description is known.

        Args:
            file: URDF or xacro file; None to take the parameter or the topic.
            arguments: parameter files and the names of parameters set on the command line.

        Raises:
            OneBotError: the parameters or the description cannot be used.
        """
        super().__init__("velocity_controller")
        self._loop: ControlLoop | None = None
        self._failure: BaseException | None = None
        self._warn = Throttled(self.get_logger().warning)
        self._settings = ControlParameters(self, arguments or RosArguments())
        config = self._settings.config
        self._simulated = self.get_parameter("use_sim_time").value or config.real_time_factor != 1.0
        self._output = Publishers(self, self._simulated)
        self._commands = CommandTopic(self, config.cmd_vel_type, self._on_command, self._warn)
        PoseTopics(self, self._robot, lambda: self._output.odom_frame, self._warn)
        Services(self, self._robot)
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._accept)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_EVERY, self._look, clock=steady)
        # Last, because from here on the robot moves: whoever stops us must find a whole node.
        self._start(file)

    def destroy_node(self) -> None:
        """Stop the control loop, and with it the robot, and then the node."""
        if self._loop is not None:
            self._loop.stop()
        super().destroy_node()

    # The robot -------------------------------------------------------------------------------

    def _start(self, file: str | None) -> None:
        """Drive the robot whose description is at hand, or wait for one on the topic."""
        text = self._settings.values["robot_description"]
        if file:
            self._drive(load_description(file))
        elif text:
            self._drive(described_by(text))
        if not file and not is_path(text):
            DescriptionTopic(self, self._on_description, lambda: self._loop is not None)

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
            self.get_logger().warning(warning)
        separation, radius = drive.geometry
        self.get_logger().info(
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
                self.get_logger().info("changed robot description taken up")
        except OneBotError as error:
            if loop is None:
                raise
            self.get_logger().error(f"robot description refused, going on as before:\n{error}")

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


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    sys.setswitchinterval(_SWITCH_INTERVAL)
    return run_described_node(
        "velocity_controller",
        __doc__,
        VelocityController,
        lambda files: read_control_files(files, "/", "velocity_controller"),
        args,
        default_file=default_control_file,
        events=True,
    )


if __name__ == "__main__":
    sys.exit(main())
