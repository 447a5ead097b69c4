"""The parameters of velocity_controller and of the simulation, and their checks."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from onebot_control.controller_names import BROADCASTER
from onebot_control.drive.odometry import DiffDriveKinematics
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_control.frame_names import WORLD_FRAME
from onebot_control.ignored_parameters import IN_EACH_CYCLE, ignored
from onebot_description.parameters.reader import Problem, group, parameter, read

if TYPE_CHECKING:
    from onebot_control.drive.wheels.geometry import WheelGeometry

INTERFACES = ("position", "velocity", "effort")
_MOST_HERTZ = 10_000.0
_LEAST_CYCLES, _MOST_CYCLES = 0.001, 1000.0  # update_rate, Hz
_FROM_URDF = "0: read from the URDF"
_NO_HARDWARE = "there are no other interfaces than these"
_SIMULATED = "there is no hardware"
_NO_SWITCHING = "controllers are not switched"
_PACED = "/diagnostics has the real-time factor and missed cycles"
_NOISE = 0.005  # m after 1 m; typical of a wheel on a hard floor


@dataclass(frozen=True)
class InterfaceNames:
    """joint_state_broadcaster's parameters ``map_interface_to_joint_state.*``."""

    position: str = ignored("position", _NO_HARDWARE)
    velocity: str = ignored("velocity", _NO_HARDWARE)
    effort: str = ignored("effort", _NO_HARDWARE)


@dataclass(frozen=True)
class BroadcasterConfig:
    """joint_state_broadcaster's parameters."""

    joints: tuple[str, ...] = parameter(
        (), "joints published, in that order; empty: all", unique=True
    )
    interfaces: tuple[str, ...] = parameter(
        (),
        "values published, others are NaN; empty: all",
        choices=INTERFACES,
        unique=True,
    )
    extra_joints: tuple[str, ...] = parameter((), "joints published as well, at 0", unique=True)
    frame_id: str = parameter("base_link", "frame_id of the message's header")
    use_local_topics: bool = ignored(False, "joint_states is in the robot's namespace")
    use_urdf_to_filter: bool = ignored(True, "all joints are of the URDF")
    publish_dynamic_joint_states: bool = ignored(True, "there is no topic dynamic_joint_states")
    map_interface_to_joint_state: InterfaceNames = group(InterfaceNames)
    update_rate: float = ignored(0.0, IN_EACH_CYCLE)
    is_async: bool = ignored(False, IN_EACH_CYCLE)


def _wheels() -> Any:
    description = "joints of that side's wheels; empty on both sides: found in the URDF"
    return parameter((), description, unique=True, read_only=True)


def _multiplier(what: str) -> Any:
    return parameter(1.0, f"corrects {what}", above=0.0)


def _variances(zeros: str = "") -> Any:
    text = f"variances of x, y, z, roll, pitch, yaw{zeros}"
    return parameter((0.0,) * 6, text, at_least=0.0)


def _noise() -> Any:
    text = "standard deviation of the wheels' path after 1 m, m; grows with the root of the path"
    return parameter(_NOISE, text, at_least=0.0, at_most=1.0)


_Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class SimulationConfig:
    """Parameters of the simulation and of joint_state_broadcaster, for driving and standing robots.

    The table in README.md explains them.
    """

    robot_description: str = parameter("", "the URDF, in place of the topic", read_only=True)
    x: float = parameter(0.0, "where it starts in the world, m", read_only=True)
    y: float = parameter(0.0, "where it starts in the world, m", read_only=True)
    yaw: float = parameter(0.0, "where it faces at the start, rad", read_only=True)
    initial_positions: Mapping[str, float] = parameter(
        {}, "where joints are at the start, rad or m; they override <ros2_control>", read_only=True
    )
    update_rate: float = parameter(
        100,
        "control cycles a second, Hz",
        at_least=_LEAST_CYCLES,
        at_most=_MOST_CYCLES,
        read_only=True,
    )
    real_time_factor: float = parameter(
        1.0, "simulated seconds a second; 0: as fast as possible", at_least=0.0
    )
    paused: bool = parameter(
        False, "starts before its first cycle, and waits to be stepped or resumed", read_only=True
    )
    step_topics: tuple[str, ...] = parameter(
        (),
        "topics of sensors: a step waits for a command with each message's stamp, or a later one",
        unique=True,
    )
    step_timeout: float = parameter(
        5.0,
        "how long a step waits for such a command, s of the wall's time; of robots the longest",
        above=0.0,
    )
    world_frame_id: str = parameter(
        WORLD_FRAME,
        "frame of the truth and parent of odom; empty: the truth in odom, unless there is a world",
    )
    ground_truth_tf: bool = parameter(
        True, "publish world_frame_id -> odom_frame_id on TF, unless another node localizes"
    )
    world: str = parameter(
        "",
        "walls, ramps and boxes around it: maze, ramp, or a URDF or xacro file",
        read_only=True,
    )
    sensors: str = parameter(
        "", "URDF or xacro file with sensors that the robot's URDF lacks; reloaded when edited"
    )
    sensor_noise: bool = parameter(True, "sensors have the noise that their blocks have")
    tf_frame_prefix_enable: bool = parameter(True, "prepend a prefix to the frames")
    tf_frame_prefix: str = parameter("", "that prefix; empty or ~: the node's namespace")
    publish_rate: float = parameter(
        50.0, "odometry and transforms, Hz", above=0.0, at_most=_MOST_HERTZ
    )
    broadcaster: BroadcasterConfig = group(BroadcasterConfig, BROADCASTER)


@dataclass(frozen=True)
class InitialStates:
    """controller_manager's parameters ``hardware_components_initial_state.*``."""

    unconfigured: tuple[str, ...] = ignored((), _SIMULATED)
    inactive: tuple[str, ...] = ignored((), _SIMULATED)
    shutdown_on_initial_state_failure: bool = ignored(True, _SIMULATED)


@dataclass(frozen=True)
class ManagerDefaults:
    """controller_manager's parameters ``defaults.*``."""

    allow_controller_activation_with_inactive_hardware: bool = ignored(False, _SIMULATED)
    deactivate_controllers_on_hardware_self_deactivate: bool = ignored(True, _SIMULATED)
    strictness: str = parameter(
        "best_effort",
        f"accepted, without effect: {_NO_SWITCHING}",
        name="switch_controller.strictness",
        choices=("strict", "best_effort"),
    )


@dataclass(frozen=True)
class Overruns:
    """controller_manager's parameters ``overruns.*``."""

    manage: bool = ignored(True, _PACED)
    print_warnings: bool = ignored(True, _PACED)


@dataclass(frozen=True)
class ManagerConfig(SimulationConfig):
    """All parameters of controller_manager: the simulation's and ros2_control's."""

    enforce_command_limits: bool = parameter(
        True, "default of joint_trajectory_controller's parameter of this name"
    )
    hardware_components_initial_state: InitialStates = group(InitialStates)
    defaults: ManagerDefaults = group(ManagerDefaults)
    overruns: Overruns = group(Overruns)
    handle_exceptions: bool = ignored(True, "an error ends the process")
    lock_memory: bool = ignored(False, _PACED)
    thread_priority: int = ignored(50, _PACED)
    diagnostics: Mapping[str, float] = parameter(
        {}, f"accepted, without effect: {_PACED}", keys=("threshold",)
    )


@dataclass(frozen=True)
class ControlConfig(SimulationConfig):
    """All parameters of velocity_controller: the simulation's and diff_drive_controller's."""

    left_wheel_names: tuple[str, ...] = _wheels()
    right_wheel_names: tuple[str, ...] = _wheels()
    wheel_separation: float = parameter(
        0.0,
        f"distance between the wheels, effective for skid steer, m; {_FROM_URDF}",
        at_least=0.0,
    )
    wheel_radius: float = parameter(
        0.0, f"radius of the driven wheels, m; {_FROM_URDF}", at_least=0.0
    )
    wheel_separation_multiplier: float = _multiplier("wheel_separation")
    left_wheel_radius_multiplier: float = _multiplier("wheel_radius on its side")
    right_wheel_radius_multiplier: float = _multiplier("wheel_radius on its side")
    odom_frame_id: str = parameter(
        "odom", "frame of the odometry", not_empty=True, write="the name of a frame, such as odom"
    )
    base_frame_id: str = parameter(
        "", "frame of the base, child of odom_frame_id; empty: the robot's root link"
    )
    pose_covariance_diagonal: _Six = _variances("; zeros: they grow on the way")
    twist_covariance_diagonal: _Six = _variances()
    left_wheel_noise: float = _noise()
    right_wheel_noise: float = _noise()
    open_loop: bool = parameter(False, "odometry by the commands, not by the wheels")
    position_feedback: bool = parameter(True, "odometry by the wheels' positions, not velocities")
    enable_odom_tf: bool = parameter(True, "publish the odometry on /tf, too")
    cmd_vel_timeout: float = parameter(
        0.5,
        "time without a command until the robot brakes, s; a stamp's age counts; 0: it never does",
        at_least=0.0,
    )
    publish_limited_velocity: bool = parameter(False, "publish ~/cmd_vel_out")
    velocity_rolling_window_size: int = parameter(
        10, "samples over which the odometry's velocity is averaged", at_least=1
    )
    linear: SpeedLimits = group(SpeedLimits, "linear.x")
    angular: SpeedLimits = group(SpeedLimits, "angular.z")
    is_async: bool = ignored(False, IN_EACH_CYCLE)
    use_stamped_vel: bool = ignored(True, "Twist and TwistStamped are received")
    wheels_per_side: int = ignored(0, "the names are counted")

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters, and convert them to a config.

        Args:
            values: values by their dotted ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: values are wrong; it names each of them, and what would be right.
        """
        return read(cls, values)

    def check(self) -> Iterator[Problem]:
        """Report sides with different numbers of wheels."""
        left, right = self.left_wheel_names, self.right_wheel_names
        if len(left) != len(right):
            text = f"{len(right)} wheels, but left_wheel_names has {len(left)}; name as many"
            yield Problem("right_wheel_names", text)

    def world_frame(self, *, in_scene: bool) -> str:
        """Return the frame of true poses; "" for the odometry's. In a scene there always is one."""
        return self.world_frame_id or (WORLD_FRAME if in_scene else "")

    def kinematics(self, geometry: "WheelGeometry") -> DiffDriveKinematics:
        """Return the drive's kinematics: ``geometry`` scaled by the multipliers.

        Raises:
            ValueError: a length is too short or not finite.
        """
        return DiffDriveKinematics(
            geometry.separation * self.wheel_separation_multiplier,
            geometry.radius * self.left_wheel_radius_multiplier,
            geometry.radius * self.right_wheel_radius_multiplier,
        )
