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
        world_frame_id (or empty) or the odometry's. The odometry does not change.
    ~/set_odometry (geometry_msgs/msg/PoseStamped, depth 10): sets the odometry to this pose.
    robot_description (std_msgs/msg/String, transient local): the URDF, unless FILE or a path as
        the parameter gives it; a changed one is applied where the robot is.

Publishes (reliable, depth 10, unless noted):
    joint_states (sensor_msgs/msg/JointState): every control cycle; rad, rad/s, Nm.
    ~/odom (nav_msgs/msg/Odometry): pose and twist by the wheels, at publish_rate; the covariance of
        the pose grows with the distance, unless pose_covariance_diagonal is given.
    ~/ground_truth (nav_msgs/msg/Odometry): the true ones, with ~/odom.
    /tf (tf2_msgs/msg/TFMessage): odom_frame_id -> base_frame_id, with ~/odom.
    /tf_static (tf2_msgs/msg/TFMessage, transient local): world_frame_id -> odom_frame_id.
    ~/cmd_vel_out (geometry_msgs/msg/TwistStamped): the limited command, every control cycle, if
        publish_limited_velocity; else there is no such topic.
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
    robot_description* (string, default ""): the URDF to start with, before one is published, or the
        path of a URDF or xacro file.
    x*, y* (double, m), yaw* (double, rad; default 0.0): where the robot starts in the world.
    update_rate* (double or integer, Hz, default 100): control cycles, 0.001 to 1000;
        controller_manager's.
    left_wheel_noise, right_wheel_noise (double, m, default 0.005): standard deviation of a distance
        of 1 m by these wheels; it grows with the root of the distance.
    real_time_factor (double, default 1.0): simulated seconds a second; 0.0 is as fast as possible.
    world_frame_id (string, default world): frame of ~/ground_truth and parent of odom_frame_id;
        empty gives the truth in the odometry's frame and leaves odom_frame_id without parent.
    joint_state_broadcaster.joints, .interfaces, .extra_joints (string[]), .frame_id (string,
        default base_link): joint_state_broadcaster's.
left_wheel_names* and right_wheel_names* are found in the URDF where they are empty, the default;
wheel_separation and wheel_radius (double, m) are read from it where they are 0.0, and base_frame_id
is its root link where it is empty. A change of any parameter takes effect at
once, or is refused with the reason.
"""

import sys

from rclpy.node import Node

from onebot_control.parameters import default_control_file, read_control_files
from onebot_description.node import RosArguments, run_described_node

# s after which the interpreter passes its lock to the control thread; 5 ms by default.
_SWITCH_INTERVAL = 0.0005


class VelocityController(Node):
    """See the module's docstring for what it publishes, subscribes and takes."""

    def __init__(self, file: str | None = None, arguments: RosArguments | None = None) -> None:
        """Start driving as soon as the description is known; the arguments are ``Driving``'s.

        Raises:
            OneBotError: the parameters or the description cannot be used.
        """
        super().__init__("velocity_controller")
        # Only now: this process and the others discover each other while it is imported.
        from onebot_control.driving import Driving

        self._driving = Driving(self, file, arguments or RosArguments())

    def destroy_node(self) -> None:
        """Stop the control loop, and with it the robot, and then the node."""
        if hasattr(self, "_driving"):
            self._driving.stop()
        super().destroy_node()


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
