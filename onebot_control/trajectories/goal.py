"""Trajectory goals, and the checks that accept or reject them."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from onebot_control.trajectories.config import TrajectoryConfig
from onebot_control.trajectories.tolerances import FLOAT_EPSILON
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.errors import printable, unknown_names
from onebot_description.parameters.values import LARGEST
from onebot_description.timing import NS_PER_S

_ROUNDING = 1e-6  # rad or m, rounding error of a limit as float32


class FollowedJoint(NamedTuple):
    """A joint that follows trajectories, with its position limits in rad or m."""

    name: str
    continuous: bool = False
    lower: float = -math.inf
    upper: float = math.inf

    def within(self, lower: float, upper: float) -> "FollowedJoint":
        """Return the joint with these additional position limits, rad or m."""
        return self._replace(lower=max(self.lower, lower), upper=min(self.upper, upper))


class MotorLimits(NamedTuple):
    """Limits of a joint's motor in addition to the joint's own; 0 for no additional limit."""

    effort: float  # maximum effort, Nm or N
    velocity: float  # maximum velocity, rad/s or m/s


class TrajectoryGoal(NamedTuple):
    """A trajectory requested by a client, as in trajectory_msgs/JointTrajectory."""

    joints: tuple[str, ...]
    points: tuple[Waypoint, ...]  # values in the order of ``joints``
    stamp: int = 0  # time at which time_from_start is 0, ns; 0: now
    has_efforts: bool = False  # whether any point has efforts


def goal_problems(
    goal: TrajectoryGoal, joints: Sequence[FollowedJoint], config: TrajectoryConfig, now: int
) -> list[str]:
    """Return why a goal is rejected, one line per reason; empty if it can be followed.

    The checks are those of joint_trajectory_controller and some more: a duplicate joint, a value
    that is not finite, a position beyond the joint's limits, a negative first time.

    Args:
        goal: the requested goal.
        joints: the controller's joints.
        config: the controller's parameters.
        now: current time, ns.
    """
    limits = {joint.name: joint for joint in joints} if config.enforce_command_limits else {}
    problems = [*_name_problems(goal.joints, [joint.name for joint in joints], config)]
    if not goal.points:
        problems.append("points is empty; cancel a goal to stop it, or send a position to hold")
    if goal.has_efforts:
        problems.append("effort is given, but only positions are commanded")
    integrates = config.allow_integration_in_goal_trajectories
    for index, point in enumerate(goal.points):
        faults = _point_problems(goal.joints, point, limits, integrates)
        problems += (f"points[{index}].{fault}" for fault in faults)
    if not config.allow_nonzero_velocity_at_trajectory_end:
        problems += _end_problems(goal)
    return [*problems, *_time_problems(goal, now)]


def _name_problems(
    names: Sequence[str], known: Sequence[str], config: TrajectoryConfig
) -> Iterator[str]:
    if not names:
        yield "joint_names is empty"
        return
    counts = Counter(names)
    for name, hint in unknown_names(counts, known):
        yield f'joint_names: "{printable(name)}" is not a joint of the controller{hint}'
    for name, count in counts.items():
        if count > 1:
            yield f'joint_names: "{printable(name)}" occurs twice'
    for name in () if config.allow_partial_joints_goal else known:
        if name not in counts:
            yield f'joint_names: "{name}" is missing, and allow_partial_joints_goal is false'


def _point_problems(
    names: Sequence[str], point: Waypoint, limits: Mapping[str, FollowedJoint], integrates: bool
) -> Iterator[str]:
    if point.positions or not (integrates and (point.velocities or point.accelerations)):
        yield from field_problems("positions", names, point.positions, limits)
    for field, values in (("velocities", point.velocities), ("accelerations", point.accelerations)):
        if values:
            yield from field_problems(field, names, values, {})


def field_problems(
    field: str,
    names: Sequence[str],
    values: Sequence[float],
    limits: Mapping[str, FollowedJoint],
) -> Iterator[str]:
    """Yield why values of a message are rejected: count, finiteness and limits.

    Args:
        field: name of the message field, for the text.
        names: the joints, one per value.
        values: the values of the field.
        limits: position limits, rad or m, of joints by name; other joints have none.
    """
    if len(values) != len(names):
        yield f"{field}: {len(values)} values for {len(names)} joints"
        return
    for name, value in zip(names, values, strict=True):
        if fault := _fault(value, limits.get(name)):
            yield f"{field}: {printable(name)}: {value:.9g} is {fault}"


def _fault(value: float, joint: FollowedJoint | None) -> str:
    if not math.isfinite(value):
        return "not finite"
    if abs(value) > LARGEST:
        return f"beyond {LARGEST:g}"
    if joint and value < joint.lower - _ROUNDING:
        return f"below the joint's limit {joint.lower:.9g}"
    if joint and value > joint.upper + _ROUNDING:
        return f"above the joint's limit {joint.upper:.9g}"
    return ""


def _end_problems(goal: TrajectoryGoal) -> Iterator[str]:
    for point in goal.points[-1:]:
        for name, velocity in zip(goal.joints, point.velocities, strict=False):
            if abs(velocity) > FLOAT_EPSILON:
                text = "not 0 at the end, and allow_nonzero_velocity_at_trajectory_end is false"
                place = f"points[{len(goal.points) - 1}].velocities: {printable(name)}"
                yield f"{place}: {velocity:.9g} is {text}"


def _time_problems(goal: TrajectoryGoal, now: int) -> Iterator[str]:
    # -1, as the first time may be 0
    moments = [-1, *(round(point.time * NS_PER_S) for point in goal.points)]
    for index, (earlier, moment) in enumerate(pairwise(moments)):
        if moment <= earlier:
            place = f"points[{index}].time_from_start: {goal.points[index].time:.9g} s is"
            text = f"not after the {earlier / NS_PER_S:.9g} s of points[{index - 1}]"
            yield f"{place} {text if index else 'negative'}"
    if goal.stamp and goal.points and goal.stamp + moments[-1] < now:
        ago = (now - goal.stamp - moments[-1]) / NS_PER_S
        yield f"header.stamp: the trajectory ended {ago:.9g} s ago"
