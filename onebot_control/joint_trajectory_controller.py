#!/usr/bin/env python3
"""joint_trajectory_controller: simulates a robot that stands, and moves its joints.

Run it alone with ``python -m onebot_control.joint_trajectory_controller [FILE] --ros-args ...``;
FILE is a URDF or xacro file. Without it, the description is the parameter or the topic
robot_description. The robot's base stands still: at the world's origin if its root link is
``world``, else on the ground. Joints have motors as their <limit> says, and gravity.

The nodes are controller_manager, whose parameters are the simulation's, and
joint_trajectory_controller, or those that the section controller_manager of a parameter file names
with a type below. A robot that drives has them beside velocity_controller.

joint_trajectory_controller/JointTrajectoryController moves the joints that its parameter joints
names, or else those with a position command interface in <ros2_control>, or else all that mimic no
other joint:
    ~/joint_trajectory (trajectory_msgs/msg/JointTrajectory, subscribed to, best effort): a
        trajectory, which replaces what is followed.
    ~/follow_joint_trajectory (control_msgs/action/FollowJointTrajectory): the same, with feedback
        at action_monitor_rate, tolerances and a result.
    ~/controller_state (control_msgs/msg/JointTrajectoryControllerState, published, reliable,
        transient local): each control cycle the reference, what is measured, and the error.
    ~/speed_scaling_input (control_msgs/msg/SpeedScalingFactor, subscribed to, best effort,
        transient local): how quickly the time of trajectories passes; 0 stands still.
    ~/query_state (control_msgs/srv/QueryTrajectoryState): the reference at another time.

forward_command_controller/ForwardCommandController and
position_controllers/JointGroupPositionController:
    ~/commands (std_msgs/msg/Float64MultiArray, subscribed to, best effort): positions in the order
        of the parameter joints, which are held until others come.

parallel_gripper_action_controller/GripperActionController:
    ~/gripper_cmd (control_msgs/action/ParallelGripperCommand): moves the parameter joint to a
        position, which succeeds where that is reached, or with allow_stalling where it stalls.

Of controller_manager: joint_states, /tf_static (world_frame_id -> root link), /clock, /diagnostics,
the topics of sensors, ~/cmd_vel_lock (std_msgs/msg/Bool; true holds all joints and refuses goals),
~/teleport, and the services ~/reset, ~/pause and ~/step, as velocity_controller has them; and the
services of the node simulation.
"""

if __name__ == "__main__":  # first: the imports take a second
    from onebot_description.ros.process_start import start_node

    start_node()

import sys

from onebot_control.parameters import MANAGER, SimulationConfig
from onebot_control.velocity_controller import run_simulation


def main(args: list[str] | None = None) -> int:
    """Run the nodes; ``args`` are as in sys.argv. Return the exit code."""
    program = "joint_trajectory_controller"
    return run_simulation(program, __doc__, MANAGER, SimulationConfig, args)


if __name__ == "__main__":
    sys.exit(main())
