"""velocity_controller's parameters, checked, as plain values."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.odometry import DiffDriveKinematics
from onebot_control.speed_limiter import NAMES as LIMITS
from onebot_control.speed_limiter import SpeedLimits
from onebot_description.description.packages import package_share
from onebot_description.errors import did_you_mean
from onebot_description.node import RosArguments
from onebot_description.parameters.files import Parameters, read_parameters
from onebot_description.parameters.reader import ConfigError, Problem, plain, ros_parameter

if TYPE_CHECKING:
    from onebot_control.wheel_geometry import WheelGeometry


# The names of velocity_controller's parameters, their defaults, and names of times gone by.

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


COMMAND_TYPES = ("auto", "Twist", "TwistStamped")
INTERFACES = ("position", "velocity", "effort")
_MOST_HERTZ = 10_000.0


@dataclass(frozen=True)
class BroadcasterConfig:
    """joint_state_broadcaster's parameters.

    Attributes:
        joints: to publish, in that order; empty for all.
        interfaces: of "position", "velocity" and "effort"; the others are NaN; empty for all.
        extra_joints: published as well, at 0.
        frame_id: of the message's header.
    """

    joints: tuple[str, ...] = ()
    interfaces: tuple[str, ...] = ()
    extra_joints: tuple[str, ...] = ()
    frame_id: str = "base_link"


@dataclass(frozen=True)
class ControlConfig:
    """All parameters; those of diff_drive_controller are described in its documentation.

    Attributes:
        wheel_separation: m; 0 to read it from the URDF.
        wheel_radius: m; 0 to read it from the URDF.
        linear: limits of linear.x, m and s.
        angular: limits of angular.z, rad and s.
        cmd_vel_type: one of COMMAND_TYPES.
        update_rate: control cycles a second (controller_manager's).
        real_time_factor: simulated seconds a second; 0 is as fast as possible.
        world_frame_id: frame of the ground truth; empty to give it in the odometry's.
    """

    left_wheel_names: tuple[str, ...]
    right_wheel_names: tuple[str, ...]
    wheel_separation: float
    wheel_radius: float
    wheel_separation_multiplier: float
    left_wheel_radius_multiplier: float
    right_wheel_radius_multiplier: float
    tf_frame_prefix_enable: bool
    tf_frame_prefix: str
    odom_frame_id: str
    base_frame_id: str
    pose_covariance_diagonal: tuple[float, ...]
    twist_covariance_diagonal: tuple[float, ...]
    open_loop: bool
    position_feedback: bool
    enable_odom_tf: bool
    cmd_vel_timeout: float
    publish_limited_velocity: bool
    velocity_rolling_window_size: int
    publish_rate: float
    cmd_vel_type: str
    linear: SpeedLimits
    angular: SpeedLimits
    x: float
    y: float
    yaw: float
    update_rate: float
    real_time_factor: float
    world_frame_id: str
    broadcaster: BroadcasterConfig

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters: dotted name to value, as ROS has them.

        Raises:
            ConfigError: with every problem, each naming the parameter and what would be right.
        """
        reader = _Reader(values)
        problems = unknown_parameters(values)
        config = _read(cls, reader)
        problems += reader.problems
        if problems:
            raise ConfigError(problems)
        return config

    def kinematics(self, geometry: "WheelGeometry") -> DiffDriveKinematics:
        """Return the drive's geometry, scaled by the multipliers."""
        return DiffDriveKinematics(
            geometry.separation * self.wheel_separation_multiplier,
            geometry.radius * self.left_wheel_radius_multiplier,
            geometry.radius * self.right_wheel_radius_multiplier,
        )


def unknown_parameters(names: Mapping[str, Any]) -> list[Problem]:
    """Return a problem for each name that is no parameter of velocity_controller."""
    known = {*DEFAULTS, *ROS_PARAMETERS}
    return [
        Problem(name, _remedy(name))
        for name in names
        if name not in known and not name.startswith(ROS_PREFIXES)
    ]


def _remedy(name: str) -> str:
    if name in REMEDIES:
        return f"no longer a parameter; {REMEDIES[name]}"
    return f"unknown parameter{did_you_mean(name, DEFAULTS, 'alike')}"


def _read(cls: type[ControlConfig], r: "_Reader") -> ControlConfig:
    return cls(
        *r.wheels(),
        wheel_separation=r.at_least_0("wheel_separation"),
        wheel_radius=r.at_least_0("wheel_radius"),
        wheel_separation_multiplier=r.above_0("wheel_separation_multiplier"),
        left_wheel_radius_multiplier=r.above_0("left_wheel_radius_multiplier"),
        right_wheel_radius_multiplier=r.above_0("right_wheel_radius_multiplier"),
        tf_frame_prefix_enable=r.yes("tf_frame_prefix_enable"),
        tf_frame_prefix=r.text("tf_frame_prefix"),
        odom_frame_id=r.name("odom_frame_id"),
        base_frame_id=r.name("base_frame_id"),
        pose_covariance_diagonal=r.diagonal("pose_covariance_diagonal"),
        twist_covariance_diagonal=r.diagonal("twist_covariance_diagonal"),
        open_loop=r.yes("open_loop"),
        position_feedback=r.yes("position_feedback"),
        enable_odom_tf=r.yes("enable_odom_tf"),
        cmd_vel_timeout=r.at_least_0("cmd_vel_timeout"),
        publish_limited_velocity=r.yes("publish_limited_velocity"),
        velocity_rolling_window_size=r.count("velocity_rolling_window_size"),
        publish_rate=r.rate("publish_rate"),
        cmd_vel_type=r.choice("cmd_vel_type", COMMAND_TYPES, "auto"),
        linear=r.limits(AXES[0]),
        angular=r.limits(AXES[1]),
        x=r.number("x", 0.0),
        y=r.number("y", 0.0),
        yaw=r.number("yaw", 0.0),
        update_rate=r.rate("update_rate"),
        real_time_factor=r.at_least_0("real_time_factor"),
        world_frame_id=r.text("world_frame_id", DEFAULTS["world_frame_id"]),
        broadcaster=r.broadcaster(),
    )


def declare(node: Node, name: str, default: Any = None) -> None:
    """Declare a parameter, unless that was done; ``default`` counts where nobody has set it."""
    if node.has_parameter(name):
        return
    # Of an empty list rclpy cannot tell what kind it is: such is set afterwards.
    first = None if default == [] else default
    node.declare_parameter(name, first, ParameterDescriptor(dynamic_typing=True))
    if default == [] and node.get_parameter(name).value is None:
        node.set_parameters([ros_parameter(name, default)])


class Reader:
    """Takes typed values out of a flat map of parameters and collects what is wrong with them.

    Attributes:
        problems: filled as values are read; nothing is raised.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Read from ``values``: dotted name to value."""
        self.values = values
        self.problems: list[Problem] = []

    def complain(self, key: str, text: str) -> None:
        """Note a problem with the parameter ``key``."""
        self.problems.append(Problem(key, text))

    def number(self, key: str, default: float) -> float:
        """A finite number; 10 and 10.0 alike."""
        value = self.values.get(key, default)
        if not _is_number(value):
            self.complain(key, f"{_shown(value)}; write a number, such as {default:.1f}")
            return default
        if not math.isfinite(value):
            self.complain(key, f"{value} is not finite; write an ordinary number")
            return default
        return float(value)

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            self.complain(key, f"{_shown(value)}; write true or false")
            return default
        return value

    def text(self, key: str, default: str = "") -> str:
        """A string."""
        value = self.values.get(key, default)
        if not isinstance(value, str):
            self.complain(key, f'{_shown(value)}; write a text, such as "{value}"')
            return default
        return value

    def choice(self, key: str, choices: Sequence[str], default: str) -> str:
        """One of several words."""
        value = self.text(key, default)
        if value not in choices:
            self.complain(key, f'no "{value}"{did_you_mean(value, choices)}')
            return default
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers; empty when absent or wrong."""
        value = self.values.get(key, ())
        if not _is_list(value) or not all(_is_number(item) for item in value):
            self.complain(key, f"{_shown(value)}; write a list of numbers, such as [0.0, 1.0]")
            return ()
        if not all(math.isfinite(item) for item in value):
            self.complain(key, f"{list(value)} holds a number that is not finite")
            return ()
        return tuple(float(item) for item in value)

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of strings; empty when absent or wrong."""
        value = self.values.get(key, ())
        if not _is_list(value) or not all(isinstance(item, str) for item in value):
            self.complain(key, f"{_shown(value)}; write a list of texts, such as [first, second]")
            return ()
        return tuple(value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _shown(value: object) -> str:
    """Name the value and its kind, for an error about its type."""
    if isinstance(value, bool):
        return f"{str(value).lower()} is a bool"
    if isinstance(value, str):
        return f'"{value}" is a text'
    if _is_number(value):
        return f"{value} is a number"
    return f"{value} is a list" if _is_list(value) else f"{value!r} is of no use here"


class _Reader(Reader):
    """Reads what several parameters have in common; defaults are those of the table."""

    def yes(self, key: str) -> bool:
        return self.flag(key, DEFAULTS[key])

    def name(self, key: str) -> str:
        value = self.text(key, DEFAULTS[key])
        if not value:
            self.complain(key, f'is empty; write the name of a frame, such as "{DEFAULTS[key]}"')
        return value

    def at_least_0(self, key: str) -> float:
        value = self.number(key, DEFAULTS[key])
        if value < 0.0:
            what = "; 0.0 reads it from the URDF" if key.startswith("wheel_") else ""
            self.complain(key, f"{value:g} is below 0; write 0.0 or more{what}")
        return value

    def above_0(self, key: str) -> float:
        value = self.number(key, DEFAULTS[key])
        if value <= 0.0:
            self.complain(key, f"{value:g} is not above 0; write such as {DEFAULTS[key]}")
        return value

    def rate(self, key: str) -> float:
        value = self.number(key, float(DEFAULTS[key]))
        if not 0.0 < value <= _MOST_HERTZ:
            self.complain(key, f"{value:g} Hz; write a rate above 0 and up to {_MOST_HERTZ:g}")
        return value

    def count(self, key: str) -> int:
        value = self.values.get(key, DEFAULTS[key])
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            self.complain(key, f"{value!r}; write a whole number, 1 or more")
            return int(DEFAULTS[key])
        return value

    def diagonal(self, key: str) -> tuple[float, ...]:
        before = len(self.problems)
        values = self.numbers(key) if key in self.values else tuple(DEFAULTS[key])
        if len(self.problems) == before:
            if len(values) != 6:
                order = "x, y, z, roll, pitch, yaw"
                self.complain(key, f"{len(values)} numbers; write 6, the variances of {order}")
            elif min(values) < 0.0:
                self.complain(key, f"{min(values):g} is below 0, but a variance is a square")
        return values

    def limits(self, axis: str) -> SpeedLimits:
        limits = SpeedLimits(**{name: self._limit(f"{axis}.{name}") for name in LIMITS})
        for name, text in limits.problems():
            self.complain(f"{axis}.{name}", text)
        return limits

    def _limit(self, key: str) -> float:
        value = self.values.get(key, math.nan)
        if isinstance(value, float) and math.isnan(value):
            return value
        return self.number(key, 1.0)

    def wheels(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        before = len(self.problems)
        left, right = (self._unique(f"{side}_wheel_names") for side in ("left", "right"))
        if len(self.problems) == before:
            for side, names in (("left", left), ("right", right)):
                if not names:
                    example = f"[{side}_wheel_joint]"
                    self.complain(f"{side}_wheel_names", f"is empty; name joints: {example}")
            if left and right and len(left) != len(right):
                text = f"{len(right)} wheels, but left_wheel_names has {len(left)}"
                self.complain("right_wheel_names", f"{text}; name as many")
            for name in sorted(set(left) & set(right)):
                self.complain("right_wheel_names", f'"{name}" is in left_wheel_names too')
        return left, right

    def broadcaster(self) -> BroadcasterConfig:
        joints, interfaces, extra = (
            self._unique(f"{BROADCASTER}.{name}")
            for name in ("joints", "interfaces", "extra_joints")
        )
        for name in interfaces:
            if name not in INTERFACES:
                known = did_you_mean(name, INTERFACES)
                self.complain(f"{BROADCASTER}.interfaces", f'no "{name}"{known}')
        frame = self.text(f"{BROADCASTER}.frame_id", DEFAULTS[f"{BROADCASTER}.frame_id"])
        return BroadcasterConfig(joints, interfaces, extra, frame)

    def _unique(self, key: str) -> tuple[str, ...]:
        names: Sequence[str] = self.texts(key)
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.complain(key, f'"{name}" is there twice')
        return tuple(names)


# Reading control.yaml, which is in ros2_control's form: three nodes' parameters in one file.

# What is said to a node nobody has heard of is said to all, and may be meant for others.
_NOBODY = "node_that_no_file_names"

Unknown = Callable[[Mapping[str, Any]], list[Problem]]


def default_control_file() -> Path:
    """Return OneBot's own control.yaml."""
    return package_share("onebot_control") / "config" / "control.yaml"


def read_control_files(files: Sequence[Path], namespace: str, controller: str) -> Parameters:
    """Read what ``files`` say to controller_manager, joint_state_broadcaster and the controller.

    Args:
        files: later ones come first.
        namespace: of the nodes, such as "/".
        controller: name of the controller's node.

    Returns:
        The controller's parameters; the broadcaster's begin with ``joint_state_broadcaster.``.

    Raises:
        ConfigError: with all that is wrong in the file, each with its line.
    """
    found = Parameters()
    for file in files:
        found.update(_File(file, namespace).read(controller))
    return found


class _File:
    def __init__(self, file: Path, namespace: str) -> None:
        self._file = file
        self._namespace = namespace.rstrip("/")
        try:
            self._text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            raise ConfigError([Problem("", f"{file}: cannot be read: {reason}")]) from None

    def read(self, controller: str) -> Parameters:
        types = {f"{controller}.type": CONTROLLER_TYPE, f"{BROADCASTER}.type": BROADCASTER_TYPE}
        found, problems = self._section(controller, unknown_parameters)
        manager, more = self._section("controller_manager", _unknown_but("update_rate", *types))
        problems += more
        broadcaster, more = self._section(BROADCASTER, _unknown_but(*BROADCASTER_DEFAULTS))
        problems += more + _wrong_types(manager.values, types)
        if problems:
            places = {**broadcaster.places, **manager.places, **found.places}
            raise ConfigError(problems, places)
        _take(found, manager, "update_rate", "update_rate")
        for name in BROADCASTER_DEFAULTS:
            _take(found, broadcaster, name, f"{BROADCASTER}.{name}")
        return found

    def _section(self, node: str, unknown: Unknown) -> tuple[Parameters, list[Problem]]:
        """Return what is said to a node, and what of it the node does not know.

        What is said to all nodes and unknown to this one is meant for another.
        """
        found = read_parameters(self._text, str(self._file), f"{self._namespace}/{node}")
        to_all = read_parameters(self._text, str(self._file), f"{self._namespace}/{_NOBODY}")
        for problem in unknown(to_all.values):
            name = problem.key
            if found.places.get(name) == to_all.places[name]:
                del found.values[name], found.places[name]
        return found, unknown(found.values)


def _unknown_but(*known: str) -> Unknown:
    """Return what finds the names that are neither known nor every node's."""

    def unknown(values: Mapping[str, Any]) -> list[Problem]:
        return [
            Problem(name, f"unknown parameter{did_you_mean(name, known)}")
            for name in values
            if name not in {*known, *ROS_PARAMETERS} and not name.startswith(ROS_PREFIXES)
        ]

    return unknown


def _wrong_types(values: Mapping[str, Any], types: Mapping[str, str]) -> list[Problem]:
    return [
        Problem(name, f"{values[name]} is not what runs here; write {kind}")
        for name, kind in types.items()
        if values.get(name, kind) != kind
    ]


def _take(found: Parameters, other: Parameters, name: str, known_as: str) -> None:
    """Take a parameter of another node, unless the controller's own section gives it."""
    if name in other.values and known_as not in found.values:
        found.values[known_as] = other.values[name]
        found.places[known_as] = other.places[name]


# velocity_controller's parameters: declared, checked against each other and against the robot.


class ControlParameters:
    """The parameters of a node.

    Attributes:
        values: in force, by name.
        config: the same, checked.
    """

    def __init__(self, node: Node, arguments: RosArguments) -> None:
        """Declare them, with what the files and the command line say.

        Raises:
            ConfigError: something is wrong with them.
        """
        self._node = node
        namespace, name = node.get_namespace(), node.get_name()
        file = read_control_files(arguments.files, namespace, name)
        given = [n for to, n in arguments.names if to in ("", name)]
        if problems := unknown_parameters(dict.fromkeys(given)):
            raise ConfigError(problems)
        for key, default in {**DEFAULTS, **file.values}.items():
            declare(node, key, default)
        self.values = {key: plain(node.get_parameter(key).value) for key in DEFAULTS}
        places = {k: at for k, at in file.places.items() if self.values.get(k) == file.values[k]}
        try:
            self.config = ControlConfig.from_parameters(self.values)
        except ConfigError as error:
            raise error.located(places) from None
        self._places = places

    def located(self, error: ConfigError) -> ConfigError:
        """Return an error about these parameters, naming the lines they were written on."""
        return error.located(self._places)

    def changed(self, parameters: Sequence[Parameter], simulated: bool) -> ControlConfig:
        """Return the configuration there would be with these parameters set.

        Args:
            parameters: to be set together.
            simulated: whether the node's time is simulated.

        Raises:
            ConfigError: they cannot be set, and why.
        """
        changes = {p.name: plain(p.value) for p in parameters if p.name in DEFAULTS}
        problems = [
            Problem(name, "is read when the node starts; restart it to change it")
            for name, value in changes.items()
            if name in READ_AT_START and value != self.values[name]
        ]
        problems += [
            Problem(name, "cannot be unset") for name, value in changes.items() if value is None
        ]
        problems += self._clock_problems(parameters, simulated)
        if problems:
            raise ConfigError(problems)
        return ControlConfig.from_parameters({**self.values, **changes})

    def accept(self, parameters: Sequence[Parameter]) -> None:
        """Take up parameters that ``changed`` found nothing wrong with."""
        changes = {p.name: plain(p.value) for p in parameters if p.name in DEFAULTS}
        self.values.update(changes)
        self.config = ControlConfig.from_parameters(self.values)

    def _clock_problems(self, parameters: Sequence[Parameter], simulated: bool) -> list[Problem]:
        values: Mapping[str, Any] = {p.name: p.value for p in parameters}
        problems = []
        if values.get("use_sim_time", simulated) not in (simulated, None):
            text = "is read when the node starts; restart it to change whose time it uses"
            problems.append(Problem("use_sim_time", text))
        if not simulated and values.get("real_time_factor", 1.0) not in (1, 1.0):
            text = "this node keeps the system's time; start it with use_sim_time:=true"
            problems.append(Problem("real_time_factor", f"{text} to change the pace while it runs"))
        return problems
