"""Mimic joints: each chain is reduced to one factor and offset relative to its leading joint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import Joint
from onebot_description.errors import did_you_mean
from onebot_description.joints.config import Dependent
from onebot_description.joints.limits import FloatArray, Limits
from onebot_description.parameters.reader import ConfigError, Problem

Followers = Mapping[str, Dependent]


@dataclass(frozen=True)
class Following:
    """The leader of each joint: joint i is at ``position[leader[i]] * factor[i] + offset[i]``.

    A joint that does not follow another is its own leader, with factor 1 and offset 0.
    """

    leader: NDArray[np.intp]  # (N,), index
    factor: FloatArray  # (N,)
    offset: FloatArray  # (N,), rad or m

    @property
    def follows(self) -> NDArray[np.bool_]:
        """(N,), True for the joints that follow another."""
        return np.asarray(self.leader != np.arange(len(self.leader)))


def followers(
    joints: Sequence[Joint], dependent: Followers, use_mimic_tags: bool
) -> dict[str, Dependent]:
    """Return the leader of each mimic joint; ``dependent_joints`` override mimic tags."""
    tags = {
        joint.name: Dependent(joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
        for joint in joints
        if use_mimic_tags and joint.mimic is not None
    }
    return {**tags, **dependent}


def resolve(joints: Sequence[Joint], all_joints: Sequence[Joint], mimics: Followers) -> Following:
    """Reduce chains of mimic joints to their leaders.

    Args:
        joints: the N movable joints.
        all_joints: all joints of the robot, for error messages.
        mimics: the mimic relations, by name of the following joint.

    Raises:
        ConfigError: a joint follows one that is missing or fixed, or the chain is a circle.
    """
    index = {joint.name: number for number, joint in enumerate(joints)}
    kinds = {joint.name: joint.kind for joint in all_joints}
    problems = [
        Problem("", text)
        for name, mimic in mimics.items()
        if name in index and (text := _leader_problem(name, mimic.parent, index, kinds))
    ]
    if problems:
        raise ConfigError(problems)
    count = len(joints)
    leader, factor, offset = np.arange(count), np.ones(count), np.zeros(count)
    for name, number in index.items():
        root, factor[number], offset[number] = _resolve_chain(name, mimics)
        leader[number] = index[root]
    return Following(leader, factor, offset)


def narrow(
    joints: Sequence[Joint], limits: Limits, following: Following
) -> tuple[Limits, list[Problem]]:
    """Narrow the limits of leaders so that their followers stay within their own limits.

    Returns:
        Limits of all joints, and warnings on leaders whose range became smaller, or of which no
        position keeps a follower within its limits.
    """
    narrowed, notes = limits.copy(), []
    for follower in np.flatnonzero(following.follows).tolist():
        leader = int(following.leader[follower])
        before = narrowed.lower[leader], narrowed.upper[leader]
        _narrow_leader(narrowed, limits, following, follower)
        after = narrowed.lower[leader], narrowed.upper[leader]
        text = (
            f'joint "{joints[follower].name}", which follows "{joints[leader].name}" as its'
            f" position * {following.factor[follower]:g} + {following.offset[follower]:g},"
            f" has limits [{limits.lower[follower]:g}, {limits.upper[follower]:g}]"
        )
        if after[0] > after[1]:
            remedy = "correct the limits or the mimic tag, or set use_mimic_tags to false"
            beyond = "and no position suits both, so it goes beyond them"
            notes.append(Problem("", f"{text}, {beyond}; {remedy}"))
            narrowed.lower[leader], narrowed.upper[leader] = before
        elif after[0] > before[0] + 1e-6 or after[1] < before[1] - 1e-6:  # also of infinite ones
            notes.append(Problem("", f"{text}, so both keep to [{after[0]:g}, {after[1]:g}]"))
    return narrowed, notes


def _leader_problem(
    name: str, parent: str, index: Mapping[str, int], kinds: Mapping[str, str]
) -> str | None:
    """The error if the joint cannot follow ``parent``."""
    if parent in index:
        return None
    wrong = f"is {kinds[parent]}" if parent in kinds else "does not exist"
    hint = did_you_mean(parent, [joint for joint in index if joint != name], "joints that move")
    return f'joint "{name}" follows "{parent}", which {wrong}{hint}'


def _resolve_chain(name: str, mimics: Followers) -> tuple[str, float, float]:
    """The leader at the end of the chain, and the factor and offset of the whole chain."""
    seen, factor, offset = [name], 1.0, 0.0
    while seen[-1] in mimics:
        mimic = mimics[seen[-1]]
        offset += factor * mimic.offset
        factor *= mimic.factor
        if mimic.parent in seen:
            circle = " -> ".join([*seen[seen.index(mimic.parent) :], mimic.parent])
            raise ConfigError([Problem("", f"joints follow one another in a circle: {circle}")])
        seen.append(mimic.parent)
    return seen[-1], factor, offset


def _narrow_leader(narrowed: Limits, limits: Limits, following: Following, follower: int) -> None:
    """Narrow the limits of the leader of ``follower`` in place."""
    leader, factor = following.leader[follower], following.factor[follower]
    ends = np.array([limits.lower[follower], limits.upper[follower]]) - following.offset[follower]
    if factor == 0.0:
        inside = ends[0] <= 0.0 <= ends[1]
        ends = np.array([-np.inf, np.inf]) if inside else np.array([np.inf, -np.inf])
    else:
        ends = np.sort(ends / factor)
        speed = limits.velocity[follower] / abs(factor)
        narrowed.velocity[leader] = min(narrowed.velocity[leader], speed)
    narrowed.lower[leader] = max(narrowed.lower[leader], ends[0])
    narrowed.upper[leader] = min(narrowed.upper[leader], ends[1])
