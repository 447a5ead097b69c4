"""Tolerances of a trajectory: the controller's defaults, overridden by those of a goal."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from onebot_control.trajectories.config import JointConstraint, TrajectoryConfig
from onebot_description.errors import printable, unknown_names

_OFF = -1.0  # value with which a goal disables a tolerance
FLOAT_EPSILON = 1.1920929e-07  # epsilon of float32, as in joint_trajectory_controller's comparisons


class ToleranceGiven(NamedTuple):
    """Tolerances of a goal for one joint, as in control_msgs/JointTolerance; rad or m, and s.

    0 means the controller's default, -1 none. Velocities and accelerations are never compared,
    because only positions are commanded.
    """

    name: str
    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0


class TolerancesGiven(NamedTuple):
    """Tolerances of a goal, as in control_msgs/FollowJointTrajectory."""

    path: tuple[ToleranceGiven, ...] = ()
    goal: tuple[ToleranceGiven, ...] = ()
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
    problems = list(_value_problems("goal_time_tolerance", given.goal_time))
    for field, tolerances in (("path_tolerance", given.path), ("goal_tolerance", given.goal)):
        for name, hint in unknown_names([tolerance.name for tolerance in tolerances], joints):
            problems.append(f'{field}: "{printable(name)}" is not a joint of the controller{hint}')
        for tolerance in tolerances:
            problems += _tolerance_problems(field, tolerance)
    return [f"{problem}; the default tolerances are used" for problem in problems]


def _tolerance_problems(field: str, given: ToleranceGiven) -> Iterator[str]:
    for quantity, value in zip(given._fields[1:], given[1:], strict=True):
        yield from _value_problems(f"{field}: {printable(given.name)}: {quantity}", value)


def _value_problems(what: str, value: float) -> Iterator[str]:
    if not (value >= 0.0 or _is_off(value)):
        yield f"{what} {value:g} is neither 0 (the default), nor above 0, nor -1 (none)"


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
    given: Sequence[ToleranceGiven], joints: Sequence[str], defaults: Sequence[float]
) -> tuple[float, ...]:
    position_by_joint = {tolerance.name: tolerance.position for tolerance in given}
    return tuple(
        _resolved(position_by_joint.get(name, 0.0), default)
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
