"""The parameters of the simulation, of joint_state_broadcaster and of controller_manager."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from onebot_control.conventions import BROADCASTER, IN_EACH_CYCLE, WORLD_FRAME, prefixed
from onebot_control.drive.parameters import DriveParameters
from onebot_description.geometry.poses import PlanarPose
from onebot_description.parameters.reader import group, ignored, parameter

INTERFACES = ("position", "velocity", "effort")
_MAX_HERTZ = 10_000.0
_MIN_RATE, _MAX_RATE = 0.001, 1000.0  # update_rate, Hz
_NO_HARDWARE = "there are no other interfaces than these"


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


@dataclass(frozen=True)
class DescriptionConfig:
    """The parameter that shows a robot's drive, and so determines all other parameters."""

    robot_description: str = parameter("", "the URDF, in place of the topic", read_only=True)


@dataclass(frozen=True)
class SimulationConfig(DescriptionConfig):
    """Parameters of the simulation and of joint_state_broadcaster, for all robots.

    docs/drives.md has a table of them.
    """

    x: float = parameter(0.0, "start position in the world, m", read_only=True)
    y: float = parameter(0.0, "start position in the world, m", read_only=True)
    yaw: float = parameter(0.0, "start heading in the world, rad", read_only=True)
    initial_positions: Mapping[str, float] = parameter(
        {}, "start positions of joints, rad or m; they override <ros2_control>", read_only=True
    )
    update_rate: float = parameter(
        100,
        "control cycles per second, Hz",
        at_least=_MIN_RATE,
        at_most=_MAX_RATE,
        read_only=True,
    )
    real_time_factor: float = parameter(
        1.0, "simulated seconds per second; 0: as fast as possible", at_least=0.0
    )
    paused: bool = parameter(
        False, "starts before its first cycle, and waits to be stepped or resumed", read_only=True
    )
    step_topics: tuple[str, ...] = parameter(
        (),
        "sensor topics: a step waits for a command with each message's stamp, or a later one",
        unique=True,
    )
    step_timeout: float = parameter(
        5.0,
        "how long a step waits for such a command, s of wall-clock time; maximum of all robots",
        above=0.0,
    )
    world_frame_id: str = parameter(
        WORLD_FRAME,
        "frame of ground truth, parent of odom; empty: odom, unless there is a world",
    )
    ground_truth_tf: bool = parameter(
        True, "publish world_frame_id -> odom_frame_id on TF, unless another node localizes"
    )
    world: str = parameter(
        "",
        "walls, ramps and boxes around it: maze, ramp, clutter:seed=7, or a URDF or xacro file",
        read_only=True,
    )
    sensors: str = parameter(
        "", "URDF or xacro file with sensors that the robot's URDF lacks; reloaded when edited"
    )
    sensor_noise: bool = parameter(True, "simulate the noise in the sensors' blocks")
    tf_frame_prefix_enable: bool = parameter(True, "prepend a prefix to the frames")
    tf_frame_prefix: str = parameter("", "the prefix; empty or ~: the node's namespace")
    publish_rate: float = parameter(
        50.0, "rate of odometry and transforms, Hz", above=0.0, at_most=_MAX_HERTZ
    )
    broadcaster: BroadcasterConfig = group(BroadcasterConfig, BROADCASTER)

    @property
    def start(self) -> PlanarPose:
        """Where the robot starts in the world."""
        return PlanarPose(self.x, self.y, self.yaw)

    @property
    def drive(self) -> DriveParameters[Any] | None:
        """The parameters of the robot's drive; None if its base is fixed."""
        return self if isinstance(self, DriveParameters) else None

    def prefixed(self, frame: str, namespace: str) -> str:
        """Return the name of a frame with the prefix of the parameters, or of a namespace."""
        return prefixed(frame, self.tf_frame_prefix_enable, self.tf_frame_prefix, namespace)

    def world_frame(self, *, in_scene: bool) -> str:
        """Return the frame of true poses; "" for the odometry frame, which no scene uses."""
        return self.world_frame_id or (WORLD_FRAME if in_scene else "")


@dataclass(frozen=True)
class ManagerConfig(SimulationConfig):
    """The simulation's parameters, and those of controller_manager that have an effect."""

    enforce_command_limits: bool = parameter(
        True, "default of joint_trajectory_controller's parameter of this name"
    )
