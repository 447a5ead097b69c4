"""Reads and checks velocity_controller's parameters, from control.yaml and from the node."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from onebot_control.drive.odometry import DiffDriveKinematics
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_control.joint_controllers import (
    JOINT_CONTROLLERS,
    JointController,
    TrajectoryController,
    named,
)
from onebot_control.poses import WORLD_FRAME
from onebot_description.description.packages import package_share
from onebot_description.errors import did_you_mean
from onebot_description.ros.parameters.files import (
    Parameters,
    Unknown,
    read_parameters,
    read_sections,
    read_text,
)
from onebot_description.ros.parameters.reader import (
    ConfigError,
    Problem,
    declare,
    group,
    is_of_every_node,
    is_parameter,
    parameter,
    read,
    unknown_parameters,
)
from onebot_description.ros.parameters.values import plain

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    from onebot_control.drive.wheels.geometry import WheelGeometry
    from onebot_description.ros.command_line import RosArguments

BROADCASTER = "joint_state_broadcaster"
MANAGER = "controller_manager"
DEFAULT_JOINT_CONTROLLER = "joint_trajectory_controller"
CONTROLLER_TYPE = "diff_drive_controller/DiffDriveController"
BROADCASTER_TYPE = "joint_state_broadcaster/JointStateBroadcaster"
COMMAND_TYPES = ("auto", "Twist", "TwistStamped")
INTERFACES = ("position", "velocity", "effort")
_TYPE = ".type"  # suffix of the parameters that name a controller's type
_MOST_HERTZ = 10_000.0
_LEAST_CYCLES, _MOST_CYCLES = 0.001, 1000.0  # update_rate, Hz
_FROM_URDF = "0: read from the URDF"
_NOISE = 0.005  # m after 1 m; typical of a wheel on a hard floor


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


def _wheels() -> Any:
    description = "joints of that side's wheels; empty on both sides: found in the URDF"
    return parameter((), description, unique=True, read_only=True)


def _multiplier(what: str) -> Any:
    return parameter(1.0, f"corrects {what}", above=0.0)


def _frame(default: str, description: str) -> Any:
    write = f"the name of a frame, such as {default}"
    return parameter(default, description, not_empty=True, write=write)


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

    robot_description: str = parameter(
        "", "the URDF, or the path of a URDF or xacro file", read_only=True
    )
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
        5.0, "how long a step waits for such a command, s of the wall's time", above=0.0
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
    tf_frame_prefix: str = parameter("", "that prefix; empty: the node's namespace")
    publish_rate: float = parameter(
        50.0, "odometry and transforms, Hz", above=0.0, at_most=_MOST_HERTZ
    )
    broadcaster: BroadcasterConfig = group(BroadcasterConfig, BROADCASTER)


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
    odom_frame_id: str = _frame("odom", "frame of the odometry")
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
        0.5, "time without a command until the robot brakes, s; a stamp's age counts", at_least=0.0
    )
    publish_limited_velocity: bool = parameter(False, "publish ~/cmd_vel_out")
    velocity_rolling_window_size: int = parameter(
        10, "samples over which the odometry's velocity is averaged", at_least=1
    )
    cmd_vel_type: str = parameter(
        "auto", "type of ~/cmd_vel; auto: the one published", choices=COMMAND_TYPES
    )
    linear: SpeedLimits = group(SpeedLimits, "linear.x")
    angular: SpeedLimits = group(SpeedLimits, "angular.z")

    # What to write instead of parameters of older diff_drive_controllers.
    REMEDIES: ClassVar[Mapping[str, str]] = {
        "use_stamped_vel": "write cmd_vel_type: auto, Twist or TwistStamped",
        "wheels_per_side": "leave it out, the names are counted",
        "left_wheel": "write left_wheel_names: [...]",
        "right_wheel": "write right_wheel_names: [...]",
        "wheel_radius_multiplier": "write left_ and right_wheel_radius_multiplier",
        "allow_multiple_cmd_vel_publishers": "leave it out, several publishers are allowed",
        "velocity_rolling_window": "write velocity_rolling_window_size",
    }

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters, and convert them to a config.

        Args:
            values: by their dotted ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: with every problem, each naming the parameter and what would be right.
        """
        return read(cls, values)

    def check(self) -> Iterator[Problem]:
        """Report wheel names that do not make two equal sides."""
        left, right = self.left_wheel_names, self.right_wheel_names
        for side, names, opposite_names in (("left", left, right), ("right", right, left)):
            if opposite_names and not names:
                text = f"is empty; name joints: [{side}_wheel_joint]"
                yield Problem(f"{side}_wheel_names", text)
        if left and right and len(left) != len(right):
            text = f"{len(right)} wheels, but left_wheel_names has {len(left)}; name as many"
            yield Problem("right_wheel_names", text)
        for name in sorted(set(left) & set(right)):
            yield Problem("right_wheel_names", f'"{name}" is in left_wheel_names too')

    def surprises(self) -> Iterator[Problem]:
        """Report limits that have no effect."""
        for axis, limits in (("linear.x", self.linear), ("angular.z", self.angular)):
            for name, needed in limits.idle():
                text = f"limits nothing while {axis}.{needed} is not given"
                yield Problem(f"{axis}.{name}", text)

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


# control.yaml, in ros2_control's form: the parameters of three nodes in one file ----------------


def default_control_file() -> Path:
    """Return the path of OneBot's control.yaml."""
    return package_share("onebot_control") / "config" / "control.yaml"


def read_control_files(files: Sequence[Path], namespace: str, controller: str) -> Parameters:
    """Read the parameters of controller_manager, joint_state_broadcaster and a controller.

    Args:
        files: YAML files; later ones override earlier ones.
        namespace: of the nodes, such as "/".
        controller: name of the controller's node, such as "velocity_controller".

    Returns:
        The parameters; those of the broadcaster begin with ``joint_state_broadcaster.``.

    Raises:
        ConfigError: with every problem of a file, each with its line.
    """
    parameters = Parameters()
    for file in files:
        parameters.update(_read_control_file(file, namespace, controller))
    return parameters


class JointControllers(NamedTuple):
    """The joint controllers that parameter files name."""

    controllers: Sequence[JointController[Any]]
    places: Mapping[str, str]  # file and line by parameter, such as arm_controller.joints


def read_joint_controllers(files: Sequence[Path], namespace: str) -> JointControllers:
    """Read the joint controllers that the section controller_manager names.

    If it names none, there is one controller, joint_trajectory_controller.

    Args:
        files: YAML files; later ones override earlier ones.
        namespace: of the nodes, such as "/".

    Raises:
        ConfigError: with every problem of a file, each with its line.
    """
    texts = {file: read_text(file) for file in files}

    def read_section(node: str, unknown: Unknown) -> Parameters:
        parameters = Parameters()
        for file, text in texts.items():
            parameters.update(_own_parameters(text, file, namespace, node, unknown))
        if problems := unknown(parameters.values):
            raise ConfigError(problems, parameters.places)
        return parameters

    manager = read_section(MANAGER, lambda names: [])
    kinds = joint_controllers(manager.values) or {DEFAULT_JOINT_CONTROLLER: TrajectoryController}
    controllers, places = [], dict[str, str]()
    for name, kind in kinds.items():
        section = read_section(name, kind.unknown)
        places |= {f"{name}.{key}": place for key, place in section.places.items()}
        with named(name, places):
            controllers.append(kind(name, section.values))
    return JointControllers(controllers, places)


def joint_controllers(values: Mapping[str, Any]) -> dict[str, type[JointController[Any]]]:
    """Return the kind of each joint controller that controller_manager's parameters name."""
    return {
        name.removesuffix(_TYPE): JOINT_CONTROLLERS[str(value)]
        for name, value in values.items()
        if name.endswith(_TYPE) and str(value) in JOINT_CONTROLLERS
    }


def _read_control_file(file: Path, namespace: str, controller: str) -> Parameters:
    text, problems = read_text(file), list[Problem]()

    def section(node: str, unknown: Unknown) -> Parameters:
        parameters = _own_parameters(text, file, namespace, node, unknown)
        problems.extend(unknown(parameters.values))
        return parameters

    unknown = unknown_by_node(controller)
    manager = section(MANAGER, unknown[MANAGER])
    drive = manager if controller == MANAGER else section(controller, unknown[controller])
    broadcaster = section(BROADCASTER, unknown[BROADCASTER])
    types = {name: drive.values.pop(name) for name in [*drive.values] if name.endswith(_TYPE)}
    problems += _wrong_types({**manager.values, **types}, controller)
    if problems:
        raise ConfigError(problems, {**broadcaster.places, **manager.places, **drive.places})
    for name in types:
        del drive.places[name]
    _add(drive, manager, {"update_rate": "update_rate"})
    _add(drive, broadcaster, {name: f"{BROADCASTER}.{name}" for name in broadcaster.values})
    return drive


def _own_parameters(
    text: str, file: Path, namespace: str, node: str, unknown: Unknown
) -> Parameters:
    """Return a file's parameters for a node, without shared ones that only other nodes have."""
    parameters = read_parameters(text, str(file), f"{namespace.rstrip('/')}/{node}")
    parameters.drop_shared(unknown)
    return parameters


def unknown_by_node(controller: str, files: Sequence[Path] = ()) -> dict[str, Unknown]:
    """Return the nodes that a control file is for, each with a check for unknown parameters.

    Args:
        controller: name of the controller's node.
        files: control files; the joint controllers that they name are included.
    """
    declared = SimulationConfig if controller == MANAGER else ControlConfig
    kinds: dict[str, type[JointController[Any]]] = {DEFAULT_JOINT_CONTROLLER: TrajectoryController}
    for file in files:
        kinds.update(joint_controllers(_manager_values(file)))
    return {
        **{name: kind.unknown for name, kind in kinds.items()},
        controller: partial(unknown_parameters, declared),
        MANAGER: partial(_unknown_of_manager, declared if controller == MANAGER else None),
        BROADCASTER: partial(unknown_parameters, BroadcasterConfig),
    }


def _manager_values(file: Path) -> Mapping[str, Any]:
    """Return the parameters of controller_manager in a file, whatever its namespace."""
    sections = read_sections(read_text(file), str(file))
    values: dict[str, Any] = {}
    for section, parameters in sections.items():
        if section.rpartition("/")[2] == MANAGER:
            values.update(parameters.values)
    return values


def _unknown_of_manager(declared: type | None, written: Iterable[str]) -> list[Problem]:
    """Report names other than update_rate, types of controllers and ``declared`` parameters."""
    names = [name for name in written if not name.endswith(_TYPE)]
    if declared:
        return unknown_parameters(declared, names)
    return [
        Problem(name, f"no such parameter{did_you_mean(name, ['update_rate'])}")
        for name in names
        if name != "update_rate" and not is_of_every_node(name)
    ]


def _wrong_types(values: Mapping[str, Any], controller: str) -> list[Problem]:
    """Report controllers of types that this node cannot run."""
    own = {f"{controller}{_TYPE}": CONTROLLER_TYPE, f"{BROADCASTER}{_TYPE}": BROADCASTER_TYPE}
    problems = []
    for name, value in values.items():
        if not name.endswith(_TYPE):
            continue
        types = [own[name]] if name in own else [*JOINT_CONTROLLERS]
        if value not in types:
            hint = f'; of diff drives the one that is named "{controller}" runs'
            hint = hint if value == CONTROLLER_TYPE and controller != MANAGER else ""
            text = f"{value} is not what runs here; write {' or '.join(types)}{hint}"
            problems.append(Problem(name, text))
    return problems


def _add(drive: Parameters, section: Parameters, names: Mapping[str, str]) -> None:
    """Add parameters of another section, unless the controller's own section has them."""
    for name, controllers_name in names.items():
        is_one = is_parameter(ControlConfig, controllers_name)
        if is_one and name in section.values and controllers_name not in drive.values:
            drive.values[controllers_name] = section.values[name]
            drive.places[controllers_name] = section.places[name]


# The parameters of the node ---------------------------------------------------------------------


class ControlParameters:
    """The parameters of a controller's node: declared on it, checked, and kept up to date."""

    values: dict[str, Any]  # the values in force, by name
    config: ControlConfig  # the same values, checked
    places: dict[str, str]  # file and line of each value from a file
    joints: JointControllers  # the joint controllers

    def __init__(
        self,
        node: "Node",
        arguments: "RosArguments",
        given: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Declare the parameters, with the values of files and command line.

        A node named controller_manager has only the simulation's parameters: its robot stands.

        Args:
            node: to declare them on.
            arguments: the node's ROS arguments.
            given: values that override files and command line.

        Raises:
            ConfigError: with every problem.
        """
        namespace, name = node.get_namespace(), node.get_name()
        self.stands = name == MANAGER
        self.declared = SimulationConfig if self.stands else ControlConfig
        file = read_control_files(arguments.files, namespace, name)
        self.joints = read_joint_controllers(arguments.files, namespace)
        names = arguments.names_for(name)
        if problems := unknown_parameters(self.declared, names):
            raise ConfigError(problems)
        # Values of files are used unless -p sets them. If files have several sections for a node,
        # rcl would use the last one of the first file, whatever later files have.
        written = {name: v for name, v in file.values.items() if name not in names}
        given = {name: v for name, v in given.items() if is_parameter(self.declared, name)}
        self.values = declare(node, self.declared, file.values, fixed={**written, **given})
        self.places = {
            k: at for k, at in file.places.items() if self.values.get(k) == file.values[k]
        }
        self.config = read(ControlConfig, self.values, self.places)

    @property
    def warnings(self) -> list[str]:
        """Warnings about parameters that have no effect, each with its place."""
        return [problem.message(self.places) for problem in self.config.surprises()]

    def changed(self, parameters: Sequence["Parameter"], simulated: bool) -> ControlConfig:
        """Return the configuration with these parameters set; nothing changes yet.

        Args:
            parameters: to set.
            simulated: whether the node keeps simulated time.

        Raises:
            ConfigError: with every problem.
        """
        if problems := _clock_problems(parameters, simulated):
            raise ConfigError(problems)
        return read(ControlConfig, {**self.values, **_own(parameters)})

    def accept(self, parameters: Sequence["Parameter"]) -> None:
        """Apply parameters that ``changed`` has accepted."""
        self.values.update(_own(parameters))
        for new_parameter in parameters:  # no longer as the file has it
            self.places.pop(new_parameter.name, None)
        self.config = read(ControlConfig, self.values)


def _own(parameters: Sequence["Parameter"]) -> dict[str, Any]:
    """Return the values of those ``parameters`` that are ours, by name."""
    return {p.name: plain(p.value) for p in parameters if is_parameter(ControlConfig, p.name)}


def _clock_problems(parameters: Sequence["Parameter"], simulated: bool) -> list[Problem]:
    values: Mapping[str, Any] = {p.name: p.value for p in parameters}
    problems = []
    if values.get("use_sim_time", simulated) not in (simulated, None):
        text = "is read when the node starts; restart it to change whose time it uses"
        problems.append(Problem("use_sim_time", text))
    if not simulated and values.get("real_time_factor", 1.0) not in (1, 1.0):
        text = "this node keeps the system's time; start it with use_sim_time:=true"
        problems.append(Problem("real_time_factor", f"{text} to change the pace while it runs"))
    return problems
