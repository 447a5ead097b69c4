#!/usr/bin/env python3
"""velocity_controller: simulates a robot and drives it by velocity commands.

Run it alone with ``python -m onebot_control.velocity_controller [FILE] --ros-args ...``; FILE is a
URDF or xacro file. Without it, the description is the parameter or the topic robot_description.
Without --params-file, OneBot's control.yaml is used; the node has the name of the drive in the
file. Simulation, drive and joint_state_broadcaster run in one process: when it is killed, the robot
stops.

To simulate several robots in one world, where they can collide, run one process with a node for
each: ``... --robot -r __ns:=/robot1 -p x:=0.0 --robot -r __ns:=/robot2 -p x:=1.0 --ros-args ...``.
ROS arguments after --robot apply to one node, those after --ros-args to all nodes.

Subscribes:
    ~/cmd_vel (geometry_msgs/msg/Twist or TwistStamped, reliable, depth 10): m/s and rad/s;
        linear.x, angular.z and, if the drive moves sideways, linear.y are used. For mecanum and
        steering controllers in a control file, it is ~/reference.
    drive (ackermann_msgs/msg/AckermannDriveStamped, reliable, depth 10): speed and steering angle
        of a car; its stamp is not used.
    ~/cmd_vel_lock (std_msgs/msg/Bool, reliable, depth 10): true makes the robot brake and ignore
        all commands until false, from any publisher; it is remapped together with ~/cmd_vel.
    controller_manager/cmd_vel_lock (std_msgs/msg/Bool, reliable, depth 10): locks the joints that
        controllers move, as does ~/cmd_vel_lock.
    ~/teleport (geometry_msgs/msg/PoseStamped, depth 10): moves the robot to a pose, at rest, unless
        something is in the way; frame_id is world_frame_id (or empty) or odom_frame_id. The
        odometry does not change.
    robot_description (std_msgs/msg/String, transient local): the URDF, unless FILE or the parameter
        (as a path) gives it; a changed description is applied where the robot is.

Publishes (reliable, depth 10, unless noted):
    joint_states (sensor_msgs/msg/JointState): every control cycle; rad, rad/s, Nm.
    ~/odom (nav_msgs/msg/Odometry): pose and twist from the wheels, at publish_rate; the covariance
        of the pose grows with the distance, unless pose_covariance_diagonal is given. For mecanum
        and steering controllers in a control file, it is ~/odometry.
    ~/controller_state (control_msgs/msg/MecanumDriveControllerState, SteeringControllerStatus): the
        state of mecanum drives and cars, every control cycle.
    ~/ground_truth (nav_msgs/msg/Odometry): the true pose and twist, with ~/odom.
    /tf (tf2_msgs/msg/TFMessage): odom_frame_id -> base_frame_id, with ~/odom; in a world also the
        true world_frame_id -> odom_frame_id, and the movable boxes. world_frame_id ->
        odom_frame_id is not published if ground_truth_tf is false or if another node publishes a
        parent of odom.
    /tf_static (tf2_msgs/msg/TFMessage, transient local): world_frame_id -> odom_frame_id; in a
        world, its fixed links instead.
    /world_description (std_msgs/msg/String, transient local): the URDF of the world, if any.
    ~/cmd_vel_locked (std_msgs/msg/Bool, transient local): whether the robot is locked, at every
        change; controller_manager/cmd_vel_locked is the same for its joints.
    ~/cmd_vel_out (geometry_msgs/msg/TwistStamped): the limited command, every control cycle, if
        publish_limited_velocity is true; otherwise the topic does not exist.
    measurements of the sensors in the URDF (LaserScan, PointCloud2, Imu, Image and CameraInfo of
        sensor_msgs), on each sensor's topics while they have subscribers.
    /clock (rosgraph_msgs/msg/Clock): simulated time, every control cycle, if use_sim_time is true
        or real_time_factor is not 1.0 at the start; then all stamps are simulated time. Otherwise
        stamps are system time, and there is no /clock.
    /diagnostics (diagnostic_msgs/msg/DiagnosticArray): the real-time factor and the number of
        missed control cycles, once a second; WARN in slow motion.

Velocities are per second of the clock of their stamps: in slow motion, on system time, they are
lower than in the simulation.

Services:
    ~/reset (std_srvs/srv/Trigger): moves the robot back to x, y and yaw, with zero odometry and no
        command, and the world's boxes back to their start, unless a robot is in their place. It
        fails if another robot is at the start.
    ~/reset_odometry (std_srvs/srv/Trigger): sets the odometry to zero where the robot is.
    ~/set_odometry (control_msgs/srv/SetOdometry): sets the odometry to a pose.
    ~/pause (std_srvs/srv/SetBool): true stops simulated time, false continues.
    ~/step (std_srvs/srv/Trigger): one control cycle of a paused simulation.
    Another node, simulation (in the namespace of a single robot, otherwise in /), has
        step_simulation, reset_simulation, set_simulation_state, get_simulation_state and
        get_simulator_features of the package simulation_interfaces. A step is answered when all its
        measurements are published and, with step_topics, answered by a command.

If several robots share a world, ~/pause, ~/step and real_time_factor of any node apply to all of
them; update_rate must be the same for all; use_sim_time, world and paused are the first robot's.

The drive is differential, mecanum, omni or steered, by the type in the control file, or else by the
description; docs/drives.md lists them. Parameters are those of its standard controller, of
joint_state_broadcaster and of the simulation. A change takes effect immediately, or is rejected
with the reason.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.node import Node

from onebot_control.control_files import ControlFiles, default_control_file, drive_node
from onebot_control.conventions import DRIVE_CONTROLLER
from onebot_control.drive_kinds import ControlConfig
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.ros.command_line import RosArguments, ros_args, split_robots
from onebot_description.ros.run_node import at_stop, run_described_node

if TYPE_CHECKING:
    from onebot_control.nodes.world_interface import WorldInterface

# Seconds after which Python hands the GIL to the control thread; the default is 5 ms.
_SWITCH_INTERVAL = 0.0005


class SimulationNode(Node):
    """The node of one simulated robot; the module's docstring lists its topics and services."""

    def __init__(self, name: str, arguments: Sequence[str] | None = None) -> None:
        super().__init__(name, cli_args=ros_args(arguments))
        self.interface: WorldInterface | None = None

    def destroy_node(self) -> None:
        """Stop the control loop, and with it all robots of the world; then destroy the node."""
        if self.interface is not None:
            self.interface.stop()
        super().destroy_node()


def simulation_nodes(
    name: str,
    parameters: type[SimulationConfig],
    robots: Sequence[Sequence[str]] = (),
    file: str | None = None,
    arguments: RosArguments = RosArguments(),  # noqa: B008 - it is a tuple
) -> list[SimulationNode]:
    """Create a node for each robot of a world; they start once every description is known.

    Args:
        name: name of the nodes: velocity_controller, which a control file may rename, or
            controller_manager for robots with a fixed base.
        parameters: dataclass of the nodes' parameters.
        robots: the ROS arguments of each robot's node; empty for a single robot.
        file: URDF or xacro file; None for each node's parameter or topic robot_description.
        arguments: ROS arguments of all nodes.
    """
    words_of: Sequence[Sequence[str] | None] = robots or [None]
    node_arguments = [arguments.joined(words or ()) for words in words_of]
    nodes = [
        SimulationNode(node_name(name, own_arguments.files), words)
        for own_arguments, words in zip(node_arguments, words_of, strict=True)
    ]
    # Imported only now, so that DDS discovery runs meanwhile.
    from onebot_control.nodes.world_interface import WorldInterface

    interface = WorldInterface.from_descriptions(nodes, parameters, file, node_arguments)
    at_stop(interface.stop)
    for node in nodes:
        node.interface = interface
    return nodes


def node_name(name: str, files: Sequence[Path]) -> str:
    """Return the name of a robot's node; the name of a drive may be in its control files."""
    return drive_node(files).name if name == DRIVE_CONTROLLER else name


def run_simulation(
    program: str,
    explanation: str | None,
    node: str,
    parameters: type[SimulationConfig],
    args: list[str] | None,
    default_file: Callable[[], Path] | None = None,
) -> int:
    """Run the nodes of a world; return the exit code.

    Args:
        program: the program's name, for --help.
        explanation: text of --help.
        node: name of the nodes; see ``simulation_nodes``.
        parameters: dataclass of the node's parameters.
        args: as in sys.argv; None for sys.argv itself.
        default_file: returns the parameter file to use if the command line names none.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    common_arguments, robots = split_robots(sys.argv if args is None else args)
    own_files = [RosArguments().joined(words).files for words in robots] or [()]

    def check(common: Sequence[Path]) -> None:
        for file in own_files:
            files = [*common, *file]
            ControlFiles(files, "/", node_name(node, files)).parameters()

    return run_described_node(
        program,
        explanation,
        parameters,
        partial(simulation_nodes, node, parameters, robots),
        args=common_arguments,
        check_files=check,
        default_file=default_file,
    )


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    name = DRIVE_CONTROLLER
    return run_simulation(name, __doc__, name, ControlConfig, args, default_control_file)


if __name__ == "__main__":
    sys.exit(main())
