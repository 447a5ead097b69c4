"""The usual names of the nodes with the parameters of ros2_control's controllers."""

DRIVE_CONTROLLER = "velocity_controller"
BROADCASTER = "joint_state_broadcaster"
MANAGER = "controller_manager"
DEFAULT_JOINT_CONTROLLER = "joint_trajectory_controller"
