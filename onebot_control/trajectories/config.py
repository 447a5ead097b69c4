"""The parameters of joint controllers, and those of joint_trajectory_controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from onebot_control.conventions import IN_EACH_CYCLE
from onebot_description.errors import listing, unknown_names
from onebot_description.parameters.reader import (
    OTHERS,
    REQUIRED,
    Problem,
    group,
    ignored,
    leaves,
    parameter,
)

_INTERFACES = ("position", "velocity", "acceleration", "effort")
_NO_FEEDBACK = "position interfaces have no feedback"
MAX_SCALING = 1000.0  # above it, times would soon exceed the range of ROS stamps


@dataclass(frozen=True, kw_only=True)
class JointControllerConfig:
    """The parameters of a joint controller; each type of controller has a dataclass.

    Attributes:
        joints_parameter: name of the parameter with the joints.
        enforce_command_limits: whether commands are kept within the joints' limits.
    """

    joints_parameter: ClassVar[str] = "joints"
    enforce_command_limits = True
    update_rate: float = ignored(0.0, IN_EACH_CYCLE)
    is_async: bool = ignored(False, IN_EACH_CYCLE)

    @classmethod
    def lacks(cls, values: Mapping[str, Any]) -> str:
        """Return which required parameters are missing in ``values``; "" for none."""
        required = [leaf.name for leaf in leaves(cls) if leaf.default is REQUIRED]
        missing = [name for name in required if name not in values]
        return f"has no parameter {listing(missing)}" if missing else ""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the parameters; empty for all joints that can be commanded."""
        named = getattr(self, self.joints_parameter)
        return (named,) if isinstance(named, str) else tuple(named)

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The command interfaces in the parameters."""
        return ("position",)

    def ignored(self, joints: Sequence[str]) -> list[Problem]:
        """Return the parameters without effect on a controller of these joints, with reasons."""
        return []


@dataclass(frozen=True)
class SpeedScaling:
    """Parameters of the speed at which trajectories are followed."""

    initial_scaling_factor: float = parameter(
        1.0,
        "speed of trajectories until ~/speed_scaling_input sets it",
        at_least=0.0,
        at_most=MAX_SCALING,
        read_only=True,
    )
    state_interface: str = ignored("", "no hardware scales the speed", read_only=True)
    command_interface: str = ignored("", "no hardware scales the speed", read_only=True)


@dataclass(frozen=True)
class PositionsUpsampling:
    """Parameters of goals whose points are streamed by a policy."""

    enable: bool = ignored(False, "points with positions are joined linearly")
    policy_frequency: float = ignored(0.0, "points with positions are joined linearly")


@dataclass(frozen=True)
class JointConstraint:
    """The parameters ``constraints.<joint>.*``: tolerances of one joint, in rad or m."""

    trajectory: float = parameter(
        0.0, "maximum position error along the path, rad or m; 0: any", at_least=0.0
    )
    goal: float = parameter(
        0.0, "maximum position error at the goal, rad or m; 0: any", at_least=0.0
    )
    max_deceleration_on_cancel: float = parameter(
        0.0, "deceleration with decelerate_on_cancel, rad/s2 or m/s2", at_least=0.0, read_only=True
    )


@dataclass(frozen=True)
class Constraints:
    """The parameters ``constraints.*``: those of all joints, and of single ones."""

    stopped_velocity_tolerance: float = ignored(
        0.01, "velocities of position interfaces are not compared", at_least=0.0
    )
    goal_time: float = parameter(
        0.0, "maximum delay of reaching the goal, s; 0: waits forever", at_least=0.0
    )
    decelerate_on_cancel: bool = parameter(
        False, "brake with max_deceleration_on_cancel, not abruptly", read_only=True
    )
    joints: Mapping[str, JointConstraint] = parameter({}, "", name=OTHERS, keys=("joint",))


def _list(default: tuple[str, ...], description: str, **rules: Any) -> Any:
    return parameter(default, description, unique=True, read_only=True, **rules)


def _gain() -> Any:
    return ignored(0.0, _NO_FEEDBACK, infinite=True)


@dataclass(frozen=True)
class JointGains:
    """The parameters ``gains.<joint>.*``, including those of older versions."""

    p: float = _gain()
    i: float = _gain()
    d: float = _gain()
    ff_velocity_scale: float = _gain()
    i_clamp: float = _gain()
    i_clamp_max: float = _gain()
    i_clamp_min: float = _gain()
    u_clamp_max: float = _gain()
    u_clamp_min: float = _gain()
    tracking_time_constant: float = _gain()
    error_deadband: float = _gain()
    antiwindup_strategy: str = ignored("legacy", _NO_FEEDBACK)
    normalize_error: bool = ignored(False, _NO_FEEDBACK)
    angle_wraparound: bool = ignored(False, "the error of continuous joints always wraps")


@dataclass(frozen=True)
class TrajectoryConfig(JointControllerConfig):
    """joint_trajectory_controller's parameters.

    The table in docs/arms.md explains them. Only positions are commanded.
    """

    joints: tuple[str, ...] = _list(
        (), "joints to move, in this order; empty: all joints of the robot"
    )
    command_joints: tuple[str, ...] = ignored((), "it commands its joints", read_only=True)
    command_interfaces: tuple[str, ...] = _list(
        ("position",), "commanded interfaces; only position has an effect", choices=_INTERFACES
    )
    state_interfaces: tuple[str, ...] = _list(
        ("position", "velocity"),
        "the part of the measured motion from which a trajectory starts",
        choices=_INTERFACES,
    )
    allow_partial_joints_goal: bool = parameter(False, "hold joints that are missing in a goal")
    open_loop_control: bool = parameter(
        False, "deprecated name of interpolate_from_desired_state", read_only=True
    )
    interpolate_from_desired_state: bool = parameter(
        False, "trajectories start at the last command, not the measured motion", read_only=True
    )
    allow_integration_in_goal_trajectories: bool = parameter(
        False, "accept points with only velocities or accelerations, and integrate them"
    )
    set_last_command_interface_value_as_state_on_activation: bool = parameter(
        True, "hold the last command on reactivation, not the measured position"
    )
    action_monitor_rate: float = parameter(
        20.0, "rate of the action's feedback, Hz", at_least=0.1, read_only=True
    )
    interpolation_method: str = parameter(
        "splines",
        "none: jump to the next point when a point is reached",
        choices=("splines", "none"),
        read_only=True,
    )
    allow_nonzero_velocity_at_trajectory_end: bool = parameter(
        False, "accept goals whose last point has velocities"
    )
    cmd_timeout: float = parameter(
        0.0,
        "time after the last point until the measured position is held, s; 0: never",
        at_least=0.0,
    )
    allow_trajectory_replacement: bool = ignored(True, "a new goal holds joints missing in it")
    start_with_holding: bool = ignored(True, "it always holds the joints")
    state_publish_rate: float = ignored(
        0.0, "~/controller_state is published in each cycle", read_only=True
    )
    enforce_command_limits: bool = parameter(
        True, "reject and never command positions beyond the joints' limits"
    )
    speed_scaling: SpeedScaling = group(SpeedScaling)
    positions_upsampling: PositionsUpsampling = group(PositionsUpsampling)
    constraints: Constraints = group(Constraints)
    gains: Mapping[str, JointGains] = parameter({}, "", keys=("joint",))

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The parameter command_interfaces."""
        return self.command_interfaces

    def ignored(self, joints: Sequence[str]) -> list[Problem]:
        """Return a problem for each joint with parameters that is not among ``joints``."""
        named = {name: f"constraints.{name}" for name in self.constraints.joints}
        named |= {name: f"gains.{name}" for name in self.gains}
        return [
            Problem(named[name], f"not a joint of the controller{hint}; it is ignored")
            for name, hint in unknown_names(named, joints)
        ]

    def joint_constraints(self, joints: Sequence[str]) -> list[JointConstraint]:
        """Return the constraints of each of ``joints``; other joints' parameters are ignored."""
        return [self.constraints.joints.get(name, JointConstraint()) for name in joints]

    @property
    def timeout(self) -> float:
        """The parameter cmd_timeout, s; 0 if it has no effect."""
        return self.cmd_timeout if self.cmd_timeout > self.constraints.goal_time else 0.0

    @property
    def begins_at_command(self) -> bool:
        """Whether a trajectory starts at the last command, not at the measured motion."""
        return self.open_loop_control or self.interpolate_from_desired_state
