"""Tolerances of a trajectory: the controller's defaults, overridden by those of a goal."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from onebot_control.trajectories.config import JointConstraint, TrajectoryConfig
from onebot_description.errors import printable, unknown_names

_QUANTITIES = "position", "velocity", "acceleration"
_OFF = -1.0  # value with which a goal disables a tolerance
FLOAT_EPSILON = 1.1920929e-07  # epsilon of float32, as in joint_trajectory_controller's comparisons


class TolerancesGiven(NamedTuple):
    """Tolerances of a goal, as in control_msgs/FollowJointTrajectory.

    0 means the controller's default, -1 none. Velocities and accelerations are never compared,
    because only positions are commanded.
    """

    # By joint: errors of position, velocity and acceleration, rad or m, and s.
    path: Mapping[str, tuple[float, ...]] = MappingProxyType({})
    goal: Mapping[str, tuple[float, ...]] = MappingProxyType({})
    goal_time: float = 0.0  # s


class Tolerances(NamedTuple):
    """The current tolerances: maximum position errors by joint, rad or m; 0: any error."""

    path: tuple[float, ...]  # before the last point
    goal: tuple[float, ...]  # after the last point
    goal_time: float  # maximum delay of reaching the goal, s; 0: any


def default_tolerances(
    constraints: Sequence[JointConstraint], config: TrajectoryConfig
) -> Tolerances:
    """Return the tolerances from the parameters, and from the ``constraints`` of each joint."""
    return Tolerances(
        tuple(constraint.trajectory for constraint in constraints),
        tuple(constraint.goal for constraint in constraints),
        config.constraints.goal_time,
    )


def tolerance_problems(given: TolerancesGiven, joints: Sequence[str]) -> list[str]:
    """Return why ``given`` cannot be used, one line per reason; empty if it can."""
    problems, values = list[str](), {"goal_time_tolerance": given.goal_time}
    for field, tolerances in (("path_tolerance", given.path), ("goal_tolerance", given.goal)):
        for name, hint in unknown_names(tolerances, joints):
            problems.append(f'{field}: "{printable(name)}" is not a joint of the controller{hint}')
        for name, errors in tolerances.items():
            for quantity, value in zip(_QUANTITIES, errors, strict=False):
                values[f"{field}: {printable(name)}: {quantity}"] = value
    problems += [
        f"{what} {value:g} is neither 0 (the default), nor above 0, nor -1 (none)"
        for what, value in values.items()
        if not (value >= 0.0 or _is_off(value))
    ]
    return [f"{problem}; the default tolerances are used" for problem in problems]


def resolved_tolerances(
    given: TolerancesGiven, joints: Sequence[str], defaults: Tolerances
) -> Tolerances:
    """Return the tolerances of a goal: its own where given, otherwise ``defaults``.

    If there is any problem (see ``tolerance_problems``), all are ``defaults``.
    """
    if tolerance_problems(given, joints):
        return defaults
    return Tolerances(
        _positions(given.path, joints, defaults.path),
        _positions(given.goal, joints, defaults.goal),
        _resolved(given.goal_time, defaults.goal_time),
    )


def _positions(
    given: Mapping[str, tuple[float, ...]], joints: Sequence[str], defaults: Sequence[float]
) -> tuple[float, ...]:
    return tuple(
        _resolved(given.get(name, (0.0,))[0], default)
        for name, default in zip(joints, defaults, strict=True)
    )


def _resolved(given: float, default: float) -> float:
    return 0.0 if _is_off(given) else given or default


def _is_off(value: float) -> bool:
    return abs(value - _OFF) < FLOAT_EPSILON


def exceeded(joints: Sequence[str], error: Sequence[float], tolerances: Sequence[float]) -> str:
    """Return a text about the first joint beyond its tolerance; "" if there is none.

    Args:
        joints: names of the joints.
        error: position errors, rad or m.
        tolerances: maximum errors, rad or m; 0: any error.
    """
    for name, value, tolerance in zip(joints, error, tolerances, strict=True):
        if 0.0 < tolerance < abs(value):
            return f"{name}: position error {value:.6g}, tolerance {tolerance:g}"
    return ""
