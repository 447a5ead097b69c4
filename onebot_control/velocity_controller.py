#!/usr/bin/env python3
"""velocity_controller: simulates a robot and drives it by velocity commands.

Run it alone with ``python -m onebot_control.velocity_controller [FILE] --ros-args ...``; FILE is a
URDF or xacro file. Without it, the description is the parameter or the topic robot_description.
Without --params-file, OneBot's control.yaml is used. Simulation, diff_drive_controller and
joint_state_broadcaster are one process: nothing moves on when it is killed.

Several robots share one world, and collide, in one process of a node for each: ``... --robot -r
__ns:=/robot1 -p x:=0.0 --robot -r __ns:=/robot2 -p x:=1.0 --ros-args ...``. The ROS arguments that
follow --robot are one node's, those that follow --ros-args are all nodes'.

Subscribes:
    ~/cmd_vel (geometry_msgs/msg/Twist or TwistStamped, reliable, depth 10): m/s and rad/s;
        linear.x and angular.z count. See cmd_vel_type.
    ~/cmd_vel_lock (std_msgs/msg/Bool, reliable, depth 10): true has the robot brake and ignore all
        commands until false comes, whoever sends either; beside ~/cmd_vel, if that is remapped.
    ~/teleport (geometry_msgs/msg/PoseStamped, depth 10): puts the robot there, at rest, unless
        something is in the way; frame_id is world_frame_id (or empty) or the odometry's. The
        odometry does not change.
    ~/set_odometry (geometry_msgs/msg/PoseStamped, depth 10): sets the odometry to this pose.
    robot_description (std_msgs/msg/String, transient local): the URDF, unless FILE or a path as
        the parameter gives it; a changed one is applied where the robot is.

Publishes (reliable, depth 10, unless noted):
    joint_states (sensor_msgs/msg/JointState): every control cycle; rad, rad/s, Nm.
    ~/odom (nav_msgs/msg/Odometry): pose and twist by the wheels, at publish_rate; the covariance of
        the pose grows with the distance, unless pose_covariance_diagonal is given.
    ~/ground_truth (nav_msgs/msg/Odometry): the true ones, with ~/odom.
    /tf (tf2_msgs/msg/TFMessage): odom_frame_id -> base_frame_id, with ~/odom; in a world also
        world_frame_id -> odom_frame_id, by the truth, and the boxes that can be pushed. The truth
        is left out where ground_truth_tf is false or another node publishes a parent of odom.
    /tf_static (tf2_msgs/msg/TFMessage, transient local): world_frame_id -> odom_frame_id; in a
        world instead its links that stand still.
    /world_description (std_msgs/msg/String, transient local): the URDF of the world, if any.
    ~/cmd_vel_locked (std_msgs/msg/Bool, transient local): whether it is locked, at every change.
    ~/cmd_vel_out (geometry_msgs/msg/TwistStamped): the limited command, every control cycle, if
        publish_limited_velocity; else there is no such topic.
    what the sensors of the URDF measure (LaserScan, PointCloud2, Imu, Image and CameraInfo of
        sensor_msgs), on their topics, where it is subscribed to; see README.md.
    /clock (rosgraph_msgs/msg/Clock): simulated time, every control cycle, if use_sim_time is true
        or real_time_factor is not 1.0 at the start; then all stamps are simulated time. Else they
        are the system's, and there is no /clock.

    /diagnostics (diagnostic_msgs/msg/DiagnosticArray): each second the real-time factor in it, and
        the control cycles that were missed; WARN where it is below 0.9 of real_time_factor.
Velocities are by the clock that stamps them: in slow motion, on the system's time, they are lower
than those of the simulation.

Services:
    ~/reset (std_srvs/srv/Trigger): back to the beginning: x, y, yaw, odometry zero, no command; the
        boxes of the world go back, too, unless a robot is in their place. Refused where another
        robot is at the start.
    ~/reset_odometry (std_srvs/srv/Trigger): odometry zero here and now.
    ~/pause (std_srvs/srv/SetBool): true stops simulated time, false lets it go on.
    ~/step (std_srvs/srv/Trigger): one control cycle of a paused simulation.
    of a node /simulation beside it (in the robot's namespace, if it is alone): step_simulation,
        reset_simulation, set_simulation_state, get_simulation_state and get_simulator_features, as
        simulation_interfaces has them. A step is answered when all that was measured in it is
        published and, with step_topics, answered by a command.
Of several robots in one world, ~/pause and ~/step of any are all robots', and so is
real_time_factor, which changes for all; update_rate, use_sim_time, world and paused
must be the same.

Parameters are those of diff_drive_controller and joint_state_broadcaster, and the simulation's. A
change takes effect at once, or is refused with the reason.
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

from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_description.ros.node import (
    RosArguments,
    at_stop,
    ros_args,
    run_described_node,
    split_robots,
)

if TYPE_CHECKING:
    from onebot_control.nodes.driving import Driving

# s after which the interpreter passes its lock to the control thread; 5 ms by default.
_SWITCH_INTERVAL = 0.0005


class SimulationNode(Node):
    """See the module's docstring for what it publishes, subscribes and takes."""

    def __init__(self, name: str, arguments: Sequence[str] | None = None) -> None:
        super().__init__(name, cli_args=ros_args(arguments))
        self.driving: Driving | None = None

    def destroy_node(self) -> None:
        """Stop the control loop, and with it all robots of the world, and then the node."""
        if self.driving is not None:
            self.driving.stop()
        super().destroy_node()


def simulation_nodes(
    name: str,
    robots: Sequence[Sequence[str]] = (),
    file: str | None = None,
    arguments: RosArguments = RosArguments(),  # noqa: B008 - it is a tuple
) -> list[SimulationNode]:
    """Return a node for each robot of a world, which start moving it when all are described.

    Args:
        name: of the nodes: velocity_controller, or controller_manager for robots that stand.
        robots: the ROS arguments of each; none for a single robot.
        file: URDF or xacro file.
        arguments: of all nodes.
    """
    nodes = [SimulationNode(name, words) for words in robots] or [SimulationNode(name)]
    # Only now: this process and the others discover each other while it is imported.
    from onebot_control.nodes.driving import Driving

    node_arguments = [arguments.joined(words) for words in robots] or [arguments]
    driving = Driving.described(nodes, file, node_arguments)
    at_stop(driving.stop)
    for node in nodes:
        node.driving = driving
    return nodes


def run_simulation(
    program: str,
    explanation: str | None,
    node: str,
    parameters: type,
    args: list[str] | None,
    default_file: Callable[[], Path] | None = None,
) -> int:
    """Run the nodes of a world; return the exit code.

    Args:
        program: its name, for its help.
        explanation: its help.
        node: as ``simulation_nodes`` has it.
        parameters: the dataclass of that node's.
        args: as in sys.argv; None for sys.argv itself.
        default_file: gives the parameter file to use where the command line names none.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    common_arguments, robots = split_robots(sys.argv if args is None else args)
    files = [file for words in robots for file in RosArguments().joined(words).files]
    return run_described_node(
        program,
        explanation,
        parameters,
        partial(simulation_nodes, node, robots),
        lambda common: read_control_files([*common, *files], "/", node),
        common_arguments,
        default_file=default_file,
        events=True,
    )


def main(args: list[str] | None = None) -> int:
    """Run the node; ``args`` are as in sys.argv. Return the exit code."""
    name = "velocity_controller"
    return run_simulation(name, __doc__, name, ControlConfig, args, default_control_file)


if __name__ == "__main__":
    sys.exit(main())
