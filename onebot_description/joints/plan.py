"""Checks the parameters of joints against a robot, and chooses the motion of each joint."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.description import Joint
from onebot_description.joints import mimic
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.mimic import Following
from onebot_description.joints.motion_limits import (
    JointLimits,
    joint_limits,
    movable,
    not_moving,
    zero_position,
)
from onebot_description.joints.motions import (
    TURN,
    Allowed,
    Keyframes,
    Motion,
    Sine,
)
from onebot_description.parameters.reader import Problem

_SHARE_OF_RANGE, _SHARE_OF_SPEED = 0.9, 0.5  # parts of the limits that a swing uses
_FREE_SWING = math.pi / 2  # rad or m, amplitude without limits


@dataclass(frozen=True)
class Plan:
    """The checked motions and limits of N movable joints; ``make_plan`` returns it."""

    following: Following
    limits: JointLimits  # after mimic joints are taken into account
    endless: NDArray[np.bool_]  # (N,) True for continuous joints without followers
    zeros: Floats  # (N,) positions of joints that nothing moves
    motions: tuple[Motion, ...]  # N; those of followers are not used
    unsuitable: tuple[Problem, ...]  # parameters whose change is rejected
    reports: tuple[Problem, ...]  # all warnings, including these and motions beyond limits


def make_plan(all_joints: Sequence[Joint], config: JointsConfig) -> Plan:
    """Check parameters against a robot's joints, and choose the motion of each joint.

    Args:
        all_joints: all joints of the robot.
        config: the parameters; those that do not match the robot are ignored, and reported.
    """
    joints = movable(all_joints)
    limits, problems = joint_limits(joints, soft=config.use_smallest_joint_limits)
    following, narrowed, more = mimic.resolve(
        joints, all_joints, limits, config.dependent_joints, config.use_mimic_tags
    )
    problems = [
        *_wrong_names(joints, all_joints, _named(config)),
        *_moved_followers(joints, following, config),
        *problems,
        *more,
    ]
    follows = following.follows
    endless = np.array([joint.kind == "continuous" for joint in joints], dtype=bool)
    endless[following.leader[follows]] = False
    endless &= ~follows
    zero_names = {f"zeros.{name}": name for name in config.zeros}
    reports = [*problems, *_wrong_names(joints, all_joints, zero_names)]
    zeros, motions = list[float](), list[Motion]()
    for row, joint in enumerate(joints):
        allowed = _allowed(joint, narrowed, row)
        rest = zero_position(float(limits.lower[row]), float(limits.upper[row]))
        zero = allowed.clamp(config.zeros.get(joint.name, rest))
        given = {} if follows[row] else _given(joint.name, config, bool(endless[row]))
        reports += [
            Problem(key, text)
            for key, motion in given.items()
            for text in motion.violations(allowed)
        ]
        given.pop(f"zeros.{joint.name}", None)
        free = _free(allowed, zero, row / len(joints), config)
        zeros.append(zero)
        motions.append(next(iter(given.values()), free))
    return Plan(
        following=following,
        limits=narrowed,
        endless=endless,
        zeros=np.array(zeros, np.float64),
        motions=tuple(motions),
        unsuitable=tuple(problem for problem in problems if problem.key),
        reports=tuple(reports),
    )


def _allowed(joint: Joint, limits: JointLimits, row: int) -> Allowed:
    ends = float(limits.lower[row]), float(limits.upper[row]), float(limits.velocity[row])
    return Allowed(*ends, "m" if joint.kind == "prismatic" else "rad")


def _given(name: str, config: JointsConfig, endless: bool) -> dict[str, Motion]:
    """Return the motions that parameters give a joint, by parameter: rest, then pose or motion.

    ``endless``: whether a loop over whole turns keeps turning.
    """
    given: dict[str, Motion] = {}
    if name in config.zeros:
        given[f"zeros.{name}"] = Keyframes.hold(config.zeros[name])
    if config.pose and name in config.poses[config.pose]:
        given[f"poses.{config.pose}.{name}"] = Keyframes.hold(config.poses[config.pose][name])
    elif motion := config.motions.get(name):
        if endless and isinstance(motion, Keyframes):
            motion = motion.turning()
        given[f"motions.{name}"] = motion
    return given


def _free(allowed: Allowed, zero: float, share: float, config: JointsConfig) -> Motion:
    """Return the motion of a joint that no parameter moves: sweep, swing or rest.

    A swing covers most of the range, well below the maximum speed.

    Args:
        allowed: its limits.
        zero: the position at rest, rad or m.
        share: fraction of the joints that come before it; it spreads the phases over a turn.
        config: the parameters.
    """
    lower, upper = allowed.lower, allowed.upper
    if config.delta:
        return Keyframes.sweep(
            min(config.delta * config.rate, allowed.velocity), zero, lower, upper
        )
    if not config.swing:
        return Keyframes.hold(zero)
    middle, amplitude = 0.0, _FREE_SWING
    if math.isfinite(upper - lower):
        middle, amplitude = (lower + upper) / 2, _SHARE_OF_RANGE * (upper - lower) / 2
    frequency = 1.0 / config.swing
    if amplitude > 0.0:
        frequency = min(frequency, _SHARE_OF_SPEED * allowed.velocity / (TURN * amplitude))
    return Sine(amplitude, frequency, TURN * share, middle)


def _named(config: JointsConfig) -> dict[str, str]:
    """Return the joint that each parameter names and the robot must have."""
    names = {f"motions.{name}": name for name in config.motions}
    names |= {f"dependent_joints.{name}": name for name in config.dependent_joints}
    for pose, positions in config.poses.items():
        names |= {f"poses.{pose}.{name}": name for name in positions}
    return names


def _wrong_names(
    joints: Sequence[Joint], all_joints: Sequence[Joint], names: Mapping[str, str]
) -> list[Problem]:
    """Return a problem for each parameter in ``names`` whose name no moving joint has."""
    faults = not_moving(names.values(), joints, all_joints)
    return [Problem(key, faults[name]) for key, name in names.items() if name in faults]


def _moved_followers(
    joints: Sequence[Joint], following: Following, config: JointsConfig
) -> list[Problem]:
    """Return a problem for each motion of a joint that follows another."""
    problems = []
    for number in np.flatnonzero(following.follows).tolist():
        name, leader = joints[number].name, joints[int(following.leader[number])].name
        if name in config.motions:
            remedy = "move its leader, or set use_mimic_tags to false"
            problems.append(
                Problem(f"motions.{name}", f'joint "{name}" follows "{leader}"; {remedy}')
            )
    return problems
