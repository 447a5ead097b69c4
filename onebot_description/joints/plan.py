"""From joints and parameters to what each joint does; all the checking that needs both."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import JointSpec
from onebot_description.joints import limits as _limits
from onebot_description.joints import mimic
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.limits import FloatArray, Limits, SoftLimits
from onebot_description.joints.mimic import Following
from onebot_description.joints.motions import Constant, Keyframes, Motion, Sweep
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.joints.violations import Allowed, violations
from onebot_description.text import did_you_mean


@dataclass(frozen=True)
class Plan:
    """What N movable joints do.

    Attributes:
        config: the parameters it was made from.
        following: which joints follow others.
        limits: narrowed so that followers keep within theirs.
        endless: (N,) true for joints that turn without end and that nothing follows.
        zeros: (N,) where the joints stand when nothing moves them.
        motions: N motions; those of followers are never used.
        reports: limits a motion asks to exceed, and other remarks.
    """

    config: JointsConfig
    following: Following
    limits: Limits
    endless: NDArray[np.bool_]
    zeros: FloatArray
    motions: tuple[Motion, ...]
    reports: tuple[Problem, ...]


def make_plan(all_joints: Sequence[JointSpec], soft: SoftLimits, config: JointsConfig) -> Plan:
    """Check ``config`` against the robot's joints and lay down what each does.

    Raises:
        ConfigError: with the problems found.
    """
    joints = _limits.movable(all_joints)
    _check_names(joints, all_joints, config)
    limits = _limits.joint_limits(joints, soft if config.use_smallest_joint_limits else {})
    links = mimic.followers(joints, config.dependent_joints, config.use_mimic_tags)
    following = mimic.resolve(joints, all_joints, links)
    _check_followers(links, config)
    narrowed, notes = mimic.narrow(joints, limits, following)
    alone = np.ones(len(joints), dtype=bool)
    alone[following.leader[following.follows]] = False
    endless = np.array([joint.kind == "continuous" for joint in joints], dtype=bool)
    planner = _Planner(joints, narrowed, limits, config, [*config.notes, *notes])
    motions = tuple(
        Constant(0.0) if follows else planner.motion(index)
        for index, follows in enumerate(following.follows)
    )
    planner.report_poses(following)
    return Plan(
        config=config,
        following=following,
        limits=narrowed,
        endless=endless & alone & ~following.follows,
        zeros=np.array([planner.zero(index) for index in range(len(joints))]),
        motions=motions,
        reports=tuple(planner.reports),
    )


class _Planner:
    """Chooses the motion of one joint after another and gathers what to report."""

    def __init__(
        self,
        joints: Sequence[JointSpec],
        limits: Limits,
        own_limits: Limits,
        config: JointsConfig,
        notes: list[Problem],
    ) -> None:
        self._joints = joints
        self._limits = limits
        self._own = own_limits
        self._config = config
        self.reports = notes
        known = {joint.name for joint in joints}
        for name in sorted(set(config.zeros) - known):
            self._report(f"zeros.{name}", f"no joint of this name moves{did_you_mean(name, known)}")

    def zero(self, index: int) -> float:
        """Where the joint stands when nothing moves it, within its limits."""
        default = _limits.zero_position(self._own.lower[index], self._own.upper[index])
        asked = self._config.zeros.get(self._joints[index].name, default)
        return self._clamp(index, asked)

    def motion(self, index: int) -> Motion:
        """What the joint does: the pose held, else its motion, the sequence, delta, or nothing."""
        config, name = self._config, self._joints[index].name
        zero = self.zero(index)
        if name in config.zeros:
            self._check(index, Constant(config.zeros[name]), f"zeros.{name}")
        if config.pose and name in config.poses[config.pose]:
            return Constant(self._clamp(index, config.poses[config.pose][name]), config.pose)
        if name in config.motions:
            return self._check(index, config.motions[name], f"motions.{name}")
        steps = self._sequence(index, zero)
        if steps is not None:
            return self._check(index, steps, "sequence")
        return self._sweep(index, zero) if config.delta else Constant(zero)

    def report_poses(self, following: Following) -> None:
        """Report poses beyond a joint's limits, or that name joints which follow others."""
        index = {joint.name: number for number, joint in enumerate(self._joints)}
        for pose, places in self._config.poses.items():
            for name, position in places.items():
                key, number = f"poses.{pose}.{name}", index[name]
                if following.follows[number]:
                    leader = self._joints[following.leader[number]].name
                    self._report(key, f'not used: this joint follows "{leader}"')
                else:
                    self._check(number, Constant(position), key)

    def _sequence(self, index: int, zero: float) -> Keyframes | None:
        sequence, name = self._config.sequence, self._joints[index].name
        if sequence is None:
            return None
        named = [self._config.poses[pose].get(name) for pose in sequence.poses]
        known = [position for position in named if position is not None]
        if not known:
            return None
        # A pose that says nothing of the joint leaves it where the pose before has put it.
        last = known[-1] if sequence.loop else zero
        positions = []
        for position in named:
            last = last if position is None else position
            positions.append(self._clamp(index, last))
        times = list(np.cumsum([0.0, *sequence.durations[1:]]))
        if sequence.loop:
            times.append(times[-1] + sequence.durations[0])
            positions.append(positions[0])
        return Keyframes(
            times=tuple(float(time) for time in times),
            positions=tuple(positions),
            blend=sequence.blend,
            loop=sequence.loop,
            lead=sequence.durations[0],
        )

    def _sweep(self, index: int, zero: float) -> Motion:
        lower, upper = float(self._limits.lower[index]), float(self._limits.upper[index])
        sweep = Sweep(self._config.delta * self._config.rate, zero, lower, upper)
        self._check(index, sweep, "delta")
        speed = min(sweep.speed, float(self._limits.velocity[index]))
        return dataclasses.replace(sweep, speed=speed)

    def _check(self, index: int, motion: Motion, key: str) -> Motion:
        """Report what the motion asks beyond the joint's limits, and return it."""
        joint = self._joints[index]
        allowed = Allowed(
            lower=float(self._limits.lower[index]),
            upper=float(self._limits.upper[index]),
            velocity=float(self._limits.velocity[index]),
            unit="m" if joint.kind == "prismatic" else "rad",
            endless=joint.kind == "continuous",
        )
        about = "" if key.endswith(f".{joint.name}") else f'joint "{joint.name}": '
        for text in violations(motion, allowed):
            self._report(key, about + text)
        return motion

    def _clamp(self, index: int, position: float) -> float:
        return float(min(max(position, self._limits.lower[index]), self._limits.upper[index]))

    def _report(self, key: str, text: str) -> None:
        self.reports.append(Problem(key, text))


def _check_names(
    joints: Sequence[JointSpec], all_joints: Sequence[JointSpec], config: JointsConfig
) -> None:
    """Refuse motions and poses of joints that do not exist or cannot move."""
    known = [joint.name for joint in joints]
    kinds = {joint.name: joint.kind for joint in all_joints}
    named = {f"motions.{name}": name for name in config.motions}
    named |= {f"dependent_joints.{name}": name for name in config.dependent_joints}
    for pose, places in config.poses.items():
        named |= {f"poses.{pose}.{name}": name for name in places}
    problems = []
    for key, name in named.items():
        if name in kinds and name not in known:
            text = f'joint "{name}" is {kinds[name]}{did_you_mean(name, known, "joints that move")}'
            problems.append(Problem(key, text))
        elif name not in known:
            hint = did_you_mean(name, known, "joints that move")
            problems.append(Problem(key, f'the robot has no joint "{name}"{hint}'))
    if problems:
        raise ConfigError(problems)


def _check_followers(links: mimic.Followers, config: JointsConfig) -> None:
    """Refuse motions of joints that follow others."""
    problems = [
        Problem(
            f"motions.{name}",
            f'joint "{name}" follows "{links[name].parent}"; move that one, or set use_mimic_tags'
            " to false",
        )
        for name in config.motions
        if name in links
    ]
    if problems:
        raise ConfigError(problems)
