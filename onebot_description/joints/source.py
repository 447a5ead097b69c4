"""Computes positions and velocities of a robot's joints at any time, within their limits.

`make_plan` checks the parameters against the robot's joints, `ReceivedJointStates` keeps what other
nodes publish, and `JointStateSource` samples both.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.description import Joint
from onebot_description.errors import did_you_mean
from onebot_description.joints import mimic
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.mimic import Following
from onebot_description.joints.motion_limits import (
    JointLimits,
    joint_limits,
    movable,
    zero_position,
)
from onebot_description.joints.motions import (
    TURN,
    Allowed,
    Keyframes,
    Motion,
    Sine,
)
from onebot_description.ros.parameters.reader import ConfigError, Problem
from onebot_description.ros.parameters.values import LARGEST

_SHARE_OF_RANGE, _SHARE_OF_SPEED = 0.9, 0.5  # a swinging joint uses them
_FREE_SWING = math.pi / 2  # rad or m, without limits
# A step this much over the limit is rounding; allowing it keeps followers exact.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Plan:
    """The checked motions and limits of N movable joints; ``make_plan`` returns it."""

    config: JointsConfig
    following: Following
    limits: JointLimits  # after mimic joints are taken into account
    endless: NDArray[np.bool_]  # (N,) True for continuous joints without followers
    zeros: Floats  # (N,) positions of joints that nothing moves
    motions: tuple[Motion, ...]  # N; followers' are not used
    unsuitable: tuple[Problem, ...]  # parameters that do not suit the joints and are ignored
    reports: tuple[Problem, ...]  # all warnings, including these and motions beyond limits


def make_plan(all_joints: Sequence[Joint], config: JointsConfig) -> Plan:
    """Check parameters against a robot's joints, and choose the motion of each joint.

    Args:
        all_joints: all joints of the robot.
        config: the parameters; those that do not suit the robot are ignored, and reported.
    """
    joints = movable(all_joints)
    limits, problems = joint_limits(joints, soft=config.use_smallest_joint_limits)
    following, narrowed, more = mimic.resolve(
        joints, all_joints, limits, config.dependent_joints, config.use_mimic_tags
    )
    problems = [
        *_wrong_names(joints, all_joints, config),
        *_moved_followers(joints, following, config),
        *problems,
        *more,
    ]
    endless = np.array([joint.kind == "continuous" for joint in joints], dtype=bool)
    endless[following.leader[following.follows]] = False
    endless &= ~following.follows
    reports = [*config.notes, *problems, *_unknown_zeros(joints, config)]
    planners = [
        _JointPlanner(joint, _allowed(joint, narrowed, row), row / len(joints), config, reports)
        for row, joint in enumerate(joints)
    ]
    zeros = [
        planner.zero(zero_position(lower, upper))
        for planner, lower, upper in zip(
            planners, limits.lower.tolist(), limits.upper.tolist(), strict=True
        )
    ]
    motions = tuple(
        Keyframes.hold(0.0) if follows else planner.motion(zero, turns)
        for planner, zero, turns, follows in zip(
            planners, zeros, endless.tolist(), following.follows.tolist(), strict=True
        )
    )
    _report_poses(planners, following, config)
    return Plan(
        config=config,
        following=following,
        limits=narrowed,
        endless=endless,
        zeros=np.array(zeros, np.float64),
        motions=motions,
        unsuitable=tuple(problem for problem in problems if problem.key),
        reports=tuple(reports),
    )


def _allowed(joint: Joint, limits: JointLimits, row: int) -> Allowed:
    ends = float(limits.lower[row]), float(limits.upper[row]), float(limits.velocity[row])
    return Allowed(*ends, "m" if joint.kind == "prismatic" else "rad", joint.kind == "continuous")


@dataclass(frozen=True)
class _JointPlanner:
    """Chooses the motion of one joint, and collects warnings."""

    joint: Joint
    allowed: Allowed  # after mimic joints are taken into account
    share: float  # fraction of the joints that come before it, 0 to 1
    config: JointsConfig
    reports: list[Problem]  # warnings are appended to it

    def zero(self, default: float) -> float:
        """Return the position of the joint while nothing moves it, within its limits."""
        return self.allowed.clamp(self.config.zeros.get(self.joint.name, default))

    def motion(self, zero: float, endless: bool) -> Motion:
        """Return the motion: held pose, own motion, sequence, sweep, swing or rest, in that order.

        Args:
            zero: the position at rest, rad or m.
            endless: whether a loop over whole turns keeps turning.
        """
        config, name = self.config, self.joint.name
        if name in config.zeros:
            self.check(Keyframes.hold(config.zeros[name]), f"zeros.{name}")
        if config.pose and name in config.poses[config.pose]:
            position = self.allowed.clamp(config.poses[config.pose][name])
            return Keyframes.hold(position, config.pose)
        motion, key = config.motions.get(name), f"motions.{name}"
        if motion is None and config.sequence.complete:
            motion, key = self._sequence(zero), "sequence"
        if motion is not None:
            self.check(motion, key)
            return motion.turning() if endless and isinstance(motion, Keyframes) else motion
        if config.delta:
            return self._sweep(zero)
        return self._swing() if config.swing else Keyframes.hold(zero)

    def _sequence(self, zero: float) -> Keyframes | None:
        sequence, name = self.config.sequence, self.joint.name
        named = [self.config.poses[pose].get(name) for pose in sequence.poses]
        keyframes = [position for position in named if position is not None]
        if not keyframes:
            return None
        # A pose without this joint leaves it at its position in the previous pose.
        last = keyframes[-1] if sequence.loop else zero
        positions = []
        for position in named:
            last = last if position is None else position
            positions.append(self.allowed.clamp(last))
        times = np.cumsum([0.0, *sequence.durations[1:]]).tolist()
        if sequence.loop:
            times.append(times[-1] + sequence.durations[0])
            positions.append(positions[0])
        lead = sequence.durations[0]
        return Keyframes(tuple(times), tuple(positions), sequence.blend, sequence.loop, lead)

    def _sweep(self, zero: float) -> Motion:
        allowed, speed = self.allowed, self.config.delta * self.config.rate
        if not allowed.reaches(speed):
            text = f"delta times rate is {speed:.4g} {allowed.unit}/s, over {allowed.speed}"
            remedy = "which it keeps to: lower delta or rate"
            self.reports.append(Problem("delta", f'joint "{self.joint.name}": {text}, {remedy}'))
        return Keyframes.sweep(min(speed, allowed.velocity), zero, allowed.lower, allowed.upper)

    def _swing(self) -> Motion:
        """Swing through most of the range, at no more than a part of the speed allowed.

        The phases are spread over a turn, so that the robot does not move as one piece.
        """
        lower, upper = self.allowed.lower, self.allowed.upper
        middle, amplitude = 0.0, _FREE_SWING
        if math.isfinite(upper - lower):
            middle, amplitude = (lower + upper) / 2, _SHARE_OF_RANGE * (upper - lower) / 2
        frequency = 1.0 / self.config.swing
        if amplitude > 0.0:
            speed = _SHARE_OF_SPEED * self.allowed.velocity
            frequency = min(frequency, speed / (TURN * amplitude))
        return Sine(amplitude, frequency, TURN * self.share, middle)

    def check(self, motion: Motion, key: str) -> None:
        """Report where the motion of the parameter ``key`` exceeds the joint's limits."""
        name = self.joint.name
        about = "" if key.endswith(f".{name}") else f'joint "{name}": '
        texts = motion.violations(self.allowed)
        self.reports.extend(Problem(key, about + text) for text in texts)


def _report_poses(
    planners: Sequence[_JointPlanner], following: Following, config: JointsConfig
) -> None:
    """Report poses beyond limits, and pose entries of joints that follow others."""
    rows = {planner.joint.name: row for row, planner in enumerate(planners)}
    for pose, positions in config.poses.items():
        for name, position in positions.items():
            if name not in rows:
                continue  # reported already
            planner, key = planners[rows[name]], f"poses.{pose}.{name}"
            if following.follows[rows[name]]:
                leader = planners[following.leader[rows[name]]].joint.name
                planner.reports.append(Problem(key, f'not used: this joint follows "{leader}"'))
            else:
                planner.check(Keyframes.hold(position), key)


def _unknown_zeros(joints: Sequence[Joint], config: JointsConfig) -> list[Problem]:
    names = {joint.name for joint in joints}
    return [
        Problem(f"zeros.{name}", f"no joint of this name moves{did_you_mean(name, names)}")
        for name in sorted(set(config.zeros) - names)
    ]


def _wrong_names(
    joints: Sequence[Joint], all_joints: Sequence[Joint], config: JointsConfig
) -> list[Problem]:
    """Return a problem for each parameter of a joint that does not exist or cannot move."""
    moving = [joint.name for joint in joints]
    kinds = {joint.name: joint.kind for joint in all_joints}
    keys = {f"motions.{name}": name for name in config.motions}
    keys |= {f"dependent_joints.{name}": name for name in config.dependent_joints}
    for pose, positions in config.poses.items():
        keys |= {f"poses.{pose}.{name}": name for name in positions}
    problems = []
    for key, name in keys.items():
        if name not in moving:
            hint = did_you_mean(name, moving, "joints that move")
            absent = f'the robot has no joint "{name}"'
            text = f'joint "{name}" is {kinds[name]}' if name in kinds else absent
            problems.append(Problem(key, text + hint))
    return problems


def _moved_followers(
    joints: Sequence[Joint], following: Following, config: JointsConfig
) -> list[Problem]:
    """Return the motions of joints that follow others."""
    problems = []
    for number in np.flatnonzero(following.follows).tolist():
        name, leader = joints[number].name, joints[int(following.leader[number])].name
        if name in config.motions:
            remedy = "move that one, or set use_mimic_tags to false"
            problems.append(
                Problem(f"motions.{name}", f'joint "{name}" follows "{leader}"; {remedy}')
            )
    return problems


class ReceivedJointStates:
    """The latest state of each of N joints as other nodes publish it; NaN until one is received."""

    def __init__(self, names: Sequence[str]) -> None:
        self._index = {name: number for number, name in enumerate(names)}
        self._values = np.full((3, len(names)), math.nan)
        # Each (N,): rad or m, rad/s or m/s, N m or N.
        self.position, self.velocity, self.effort = self._values

    @property
    def kinds(self) -> tuple[bool, bool, bool]:
        """Whether the position, the velocity and the effort of any joint were received."""
        position, velocity, effort = (~np.isnan(self._values)).any(axis=1).tolist()
        return position, velocity, effort

    def receive(
        self,
        names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float],
        effort: Sequence[float],
    ) -> str | None:
        """Store the values of one message; return why all of it was ignored, if it was.

        Each list is as long as ``names``, or empty. Values that are not finite or beyond LARGEST,
        and joints of other robots, are skipped.
        """
        lists = position, velocity, effort
        for what, values in zip(("position", "velocity", "effort"), lists, strict=True):
            if len(values) not in (0, len(names)):
                return f"{len(names)} names but {len(values)} values of {what}"
        for row, values in zip(self._values, lists, strict=True):
            for name, value in zip(names, values, strict=False):
                number = self._index.get(name)
                if number is not None and abs(value) <= LARGEST:
                    row[number] = value
        return None

    def copy_from(self, previous: "ReceivedJointStates", pairs: Iterable[tuple[int, int]]) -> None:
        """Copy what ``previous`` received; pairs are (index here, index in it)."""
        for mine, theirs in pairs:
            self._values[:, mine] = previous._values[:, theirs]


class JointStateSource:
    """Moves joints as configured, within their position and velocity limits.

    Each sample is the previous one plus its velocity times the time between the two. The joints
    start at their zero positions. From there, and from their present positions when the parameters
    change, they move to their targets as fast as their velocity limits allow.

    The positions of continuous joints without followers are wrapped to -pi..pi.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        config: JointsConfig | None = None,
        *,
        previous: "JointStateSource | None" = None,
        tolerant: bool = False,
    ) -> None:
        """Start at the zero positions, or where joints of the same names are in ``previous``.

        Args:
            joints: all joints of the robot, in the order of the samples; fixed ones are left out.
            config: the parameters; by default no joint moves.
            previous: a source to continue from.
            tolerant: leave out parameters that do not suit the joints, and report them; else
                they are a ConfigError.
        """
        self._all_joints = tuple(joints)
        self._joints = movable(joints)
        self.names = tuple(joint.name for joint in self._joints)
        self.received = ReceivedJointStates(self.names)
        self._time: float | None = None
        self._elapsed = 0.0
        self._plan = make_plan(joints, config or JointsConfig())
        if self._plan.unsuitable and not tolerant:
            raise ConfigError(self._plan.unsuitable)
        count = len(self.names)
        self._position = self._follow(self._plan.zeros)
        self._velocity = np.zeros(count)
        self._origins, self._starts = np.zeros(count), self._position.copy()
        self._begun: list[Motion | None] = [None] * count
        if previous is not None:
            self._continue_from(previous)
        self.apply(self._plan)

    @property
    def config(self) -> JointsConfig:
        """The active parameters."""
        return self._plan.config

    @property
    def reports(self) -> tuple[Problem, ...]:
        """Warnings on the parameters, such as motions beyond limits."""
        return self._plan.reports

    @property
    def moving(self) -> bool:
        """Whether any joint moved in the last sample."""
        return bool(np.any(self._velocity))

    def prepare(self, config: JointsConfig) -> Plan:
        """Return the plan for new parameters, without applying it.

        Raises ConfigError for those that do not suit the joints, unless they are in force already.
        """
        plan = make_plan(self._all_joints, config)
        tolerated = self._plan.unsuitable
        if new := [problem for problem in plan.unsuitable if problem not in tolerated]:
            raise ConfigError(new)
        return plan

    def apply(self, plan: Plan) -> None:
        """Apply a plan of `prepare`: unchanged motions continue, changed ones start now."""
        self._plan = plan
        changed = np.array(
            [old != new for old, new in zip(self._begun, plan.motions, strict=True)], dtype=bool
        )
        self._begun = list(plan.motions)
        turning = changed & plan.endless
        self._position = np.where(turning, wrapped(self._position), self._position)
        self._origins = np.where(changed, self._elapsed, self._origins)
        self._starts = np.where(changed, self._position, self._starts)
        # A continuous joint turns the short way to its new target.
        turns = np.round((self._asked() - self._position) / TURN)
        self._position = self._position + np.where(turning, TURN * turns, 0.0)

    def sample(self, time: float) -> tuple[Floats, Floats]:
        """Advance the joints to ``time``.

        Args:
            time: s, of any clock. If it goes backwards, the joints do not move.

        Returns:
            Positions (N,) in rad or m, and velocities (N,) in rad/s or m/s.
        """
        step = 0.0 if self._time is None else time - self._time
        if step != 0.0 or self._time is None:
            self._advance(max(step, 0.0))
        self._time = time
        return self._reported()

    def efforts(self) -> Floats:
        """Return the received efforts (N,) in N m or N; 0 for joints without one."""
        efforts = np.nan_to_num(self.received.effort)
        return np.asarray(efforts[self._plan.following.leader])

    def _advance(self, step: float) -> None:
        self._elapsed += step
        if step <= 0.0:
            self._velocity = np.zeros_like(self._position)
            return
        limits, following = self._plan.limits, self._plan.following
        target = np.clip(self._asked(), limits.lower, limits.upper)
        leading = self._toward(target, step)
        # Followers move to their leaders' new positions; they lag only after a change of leader.
        position = np.where(following.follows, self._toward(self._follow(leading), step), leading)
        velocity = (position - self._position) / step
        self._velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        self._position = position

    def _asked(self) -> Floats:
        """The motions' positions of now; the present one where a motion's cannot be computed."""
        times = np.maximum(self._elapsed - self._origins, 0.0).tolist()
        motions = zip(self._plan.motions, times, self._starts.tolist(), strict=True)
        positions = np.array([motion.at(time, start) for motion, time, start in motions], float)
        return np.where(np.isfinite(positions), positions, self._position)

    def _toward(self, target: Floats, step: float) -> Floats:
        """Move from the present positions to ``target`` as far as the velocity limits allow."""
        way = target - self._position
        reach = self._plan.limits.velocity * step
        near = np.abs(way) <= reach * (1.0 + _ROUNDING)
        return np.where(near, target, self._position + np.clip(way, -reach, reach))

    def _follow(self, leading: Floats) -> Floats:
        following = self._plan.following
        return np.asarray(leading[following.leader] * following.factor + following.offset)

    def _reported(self) -> tuple[Floats, Floats]:
        """Return positions and velocities; received ones override the motions."""
        endless = self._plan.endless
        position = np.where(endless, wrapped(self._position), self._position)
        received, velocity = self.received.position, self._velocity.copy()
        if not any(self.received.kinds[:2]):
            return position, velocity
        following = self._plan.following
        followed = self._follow(received)
        speed = self.received.velocity[following.leader] * following.factor
        is_given = ~np.isnan(followed)
        position = np.where(is_given, followed, position)
        velocity = np.where(is_given | ~np.isnan(speed), np.nan_to_num(speed), velocity)
        return position, velocity

    def _continue_from(self, previous: "JointStateSource") -> None:
        """Copy positions, motions and received states of the joints that both have."""
        self._time, self._elapsed = previous._time, previous._elapsed
        index = {name: number for number, name in enumerate(previous.names)}
        pairs = [(i, index[name]) for i, name in enumerate(self.names) if name in index]
        for mine, theirs in pairs:
            self._position[mine] = previous._position[theirs]
            self._origins[mine] = previous._origins[theirs]
            self._starts[mine] = previous._starts[theirs]
            self._begun[mine] = previous._begun[theirs]
        self.received.copy_from(previous.received, pairs)


def wrapped(angle: Floats) -> Floats:
    """Return angles wrapped to -pi..pi, in rad; those in range are unchanged."""
    beyond = np.abs(angle) > math.pi
    return np.asarray(np.where(beyond, np.remainder(angle + math.pi, TURN) - math.pi, angle))
