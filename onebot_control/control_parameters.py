"""The names of velocity_controller's parameters, their defaults, and names of times gone by."""

import math
from typing import Any

from onebot_control.speed_limiter import NAMES as LIMITS

AXES = ("linear.x", "angular.z")
BROADCASTER = "joint_state_broadcaster"
CONTROLLER_TYPE = "diff_drive_controller/DiffDriveController"
BROADCASTER_TYPE = "joint_state_broadcaster/JointStateBroadcaster"

# diff_drive_controller's own. Of wheel_separation and wheel_radius, 0.0 is "read it from the URDF".
CONTROLLER_DEFAULTS: dict[str, Any] = {
    "left_wheel_names": [],
    "right_wheel_names": [],
    "wheel_separation": 0.0,
    "wheel_radius": 0.0,
    "wheel_separation_multiplier": 1.0,
    "left_wheel_radius_multiplier": 1.0,
    "right_wheel_radius_multiplier": 1.0,
    "tf_frame_prefix_enable": True,
    "tf_frame_prefix": "",
    "odom_frame_id": "odom",
    "base_frame_id": "base_link",
    "pose_covariance_diagonal": [0.0] * 6,
    "twist_covariance_diagonal": [0.0] * 6,
    "open_loop": False,
    "position_feedback": True,
    "enable_odom_tf": True,
    "cmd_vel_timeout": 0.5,
    "publish_limited_velocity": False,
    "velocity_rolling_window_size": 10,
    "publish_rate": 50.0,
    **{f"{axis}.{limit}": math.nan for axis in AXES for limit in LIMITS},
    "cmd_vel_type": "auto",
}

BROADCASTER_DEFAULTS: dict[str, Any] = {
    "joints": [],
    "interfaces": [],
    "extra_joints": [],
    "frame_id": "base_link",
}

# Of the simulation that the controller drives.
SIMULATION_DEFAULTS: dict[str, Any] = {
    "robot_description": "",
    "x": 0.0,
    "y": 0.0,
    "yaw": 0.0,
    "update_rate": 100,
    "real_time_factor": 1.0,
    "world_frame_id": "world",
}

DEFAULTS: dict[str, Any] = {
    **CONTROLLER_DEFAULTS,
    **SIMULATION_DEFAULTS,
    **{f"{BROADCASTER}.{name}": value for name, value in BROADCASTER_DEFAULTS.items()},
}

# Read once: changing them would be to start another simulation.
READ_AT_START = frozenset(
    {"left_wheel_names", "right_wheel_names", "x", "y", "yaw", "update_rate", "robot_description"}
)

# Parameters every node has.
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")
ROS_PREFIXES = ("qos_overrides.", "overrides.")

# Of older diff_drive_controllers, to what to write now.
REMEDIES = {
    "use_stamped_vel": "write cmd_vel_type: auto, Twist or TwistStamped",
    "wheels_per_side": "leave it out, the names tell",
    "left_wheel": "write left_wheel_names: [...]",
    "right_wheel": "write right_wheel_names: [...]",
    "wheel_radius_multiplier": "write left_ and right_wheel_radius_multiplier",
    "allow_multiple_cmd_vel_publishers": "leave it out, several publishers are allowed",
    "velocity_rolling_window": "write velocity_rolling_window_size",
    **{
        f"{axis}.has_{kind}_limits": f"leave it out, and write max_{kind}: .nan for no limit"
        for axis in AXES
        for kind in ("velocity", "acceleration", "jerk")
    },
}
