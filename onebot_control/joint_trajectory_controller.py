#!/usr/bin/env python3
"""joint_trajectory_controller: simulates a robot with a fixed base, and moves its joints.

Run it alone with ``python -m onebot_control.joint_trajectory_controller [FILE] --ros-args ...``;
FILE is a URDF or xacro file. Without it, the description is the parameter or the topic
robot_description. The robot's base is fixed: at the world's origin if its root link is ``world``,
otherwise on the ground. Gravity acts on the joints; their motors have the velocity and effort of
<limit>.

The nodes are controller_manager, which has the simulation's parameters, and
joint_trajectory_controller, or else the controllers that the section controller_manager of a
parameter file lists with one of the types below. velocity_controller runs the same controllers for
mobile robots.

joint_trajectory_controller/JointTrajectoryController moves the joints in its parameter joints; if
that is empty, those with a position command interface in <ros2_control>; if there are none, all
joints that do not mimic another:
    ~/joint_trajectory (trajectory_msgs/msg/JointTrajectory, subscribed to, best effort): a
        trajectory, which replaces the current one, and aborts its goal.
    ~/follow_joint_trajectory (control_msgs/action/FollowJointTrajectory): the same, with feedback
        at action_monitor_rate, tolerances and a result.
    ~/controller_state (control_msgs/msg/JointTrajectoryControllerState, published, reliable,
        transient local): reference, measured state and error, every control cycle.
    ~/speed_scaling_input (control_msgs/msg/SpeedScalingFactor, subscribed to, best effort,
        transient local): speed factor of trajectories; 1 is unscaled, 0 stops them.
    ~/query_state (control_msgs/srv/QueryTrajectoryState): returns the reference at another time.

forward_command_controller/ForwardCommandController and
position_controllers/JointGroupPositionController:
    ~/commands (std_msgs/msg/Float64MultiArray, subscribed to, best effort): positions in the order
        of the parameter joints; they are held until the next message.

parallel_gripper_action_controller/GripperActionController:
    ~/gripper_cmd (control_msgs/action/ParallelGripperCommand): moves the joint in the parameter
        joint to a position; the goal succeeds when it is reached or, with allow_stalling, when the
        joint stalls.

position_controllers/GripperActionController:
    ~/gripper_cmd (control_msgs/action/GripperCommand): the same, with the older action type.

Controllers of other types are skipped. If several move the same joint, the first is active.

controller_manager has joint_states, /tf_static (world_frame_id -> root link), /clock, /diagnostics,
the topics of sensors, ~/cmd_vel_lock (std_msgs/msg/Bool; true holds all joints and rejects goals),
~/teleport, and the services ~/reset, ~/pause and ~/step, as in velocity_controller, and the
services of the node simulation.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys

from onebot_control.conventions import MANAGER
from onebot_control.simulation_parameters import SimulationConfig
from onebot_control.velocity_controller import run_simulation


def main(args: list[str] | None = None) -> int:
    """Run the nodes; ``args`` are as in sys.argv. Return the exit code."""
    program = "joint_trajectory_controller"
    return run_simulation(program, __doc__, MANAGER, SimulationConfig, args)


if __name__ == "__main__":
    sys.exit(main())
