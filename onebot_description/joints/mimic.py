"""Mimic joints: each chain is reduced to one factor and offset relative to its leading joint."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.description import Joint, Mimic
from onebot_description.description.checks import cycles
from onebot_description.elements.urdf import reduced_mimics
from onebot_description.joints.config import Dependent
from onebot_description.joints.motion_limits import JointLimits, not_moving
from onebot_description.parameters.reader import Problem

_Mimics = dict[str, Mimic]  # keys: the joints that follow


@dataclass(frozen=True)
class Following:
    """The leader of each joint: joint i is at ``position[leader[i]] * factor[i] + offset[i]``.

    ``source.py`` computes it.

    A joint that does not follow another is its own leader, with factor 1 and offset 0.
    """

    leader: NDArray[np.intp]  # (N,), index
    factor: Floats  # (N,)
    offset: Floats  # (N,), rad or m

    @property
    def follows(self) -> NDArray[np.bool_]:
        """(N,), True for the joints that follow another."""
        return np.asarray(self.leader != np.arange(len(self.leader)))


def resolve(
    joints: Sequence[Joint],
    all_joints: Sequence[Joint],
    limits: JointLimits,
    dependent: Mapping[str, Dependent],
    use_mimic_tags: bool,
) -> tuple[Following, JointLimits, list[Problem]]:
    """Reduce chains of mimic joints to their leaders.

    Args:
        joints: the N movable joints.
        all_joints: all joints of the robot, for error messages.
        limits: limits of the N joints.
        dependent: the parameters dependent_joints, which override mimic tags.
        use_mimic_tags: whether mimic tags are applied.

    Returns:
        The leaders; the limits, narrowed so that all followers stay within theirs; and problems.
        There is a problem for each joint that cannot follow, and therefore moves alone (its leader
        is missing or fixed, joints follow in a cycle, or no position keeps both within limits).
        Its key is the joint's entry in dependent_joints, or empty for a mimic tag.
    """
    mimics = _mimics(joints, dependent, use_mimic_tags)
    problems: list[Problem] = []

    def leave_out(name: str, text: str) -> None:
        del mimics[name]
        problems.append(Problem(f"dependent_joints.{name}" if name in dependent else "", text))

    for name, text in _without_leader(joints, all_joints, mimics).items():
        leave_out(name, text)
    for circle in cycles({name: mimic.joint for name, mimic in mimics.items()}):
        names = " -> ".join([*circle, circle[0]])
        # If one of them moves alone, the others can follow; prefer a joint in the parameters.
        name = next((joint for joint in circle if joint in dependent), circle[0])
        leave_out(name, f"joints follow one another in a circle: {names}")
    while True:
        following = _reduced(joints, mimics)
        narrowed, wrong = _narrow(joints, limits, following)
        if not wrong:
            return following, narrowed, problems
        for name, text in wrong.items():
            leave_out(name, text)


def _mimics(
    joints: Sequence[Joint], dependent: Mapping[str, Dependent], use_mimic_tags: bool
) -> _Mimics:
    """Return how each joint should follow its leader."""
    tags = {joint.name: joint.mimic for joint in joints if joint.mimic and use_mimic_tags}
    chosen = {j.name: dependent[j.name] for j in joints if j.name in dependent}
    return tags | {n: Mimic(rule.parent, rule.factor, rule.offset) for n, rule in chosen.items()}


def _without_leader(
    joints: Sequence[Joint], all_joints: Sequence[Joint], mimics: _Mimics
) -> dict[str, str]:
    """Return messages about followers of joints that do not move, by follower."""
    faults = not_moving((mimic.joint for mimic in mimics.values()), joints, all_joints)
    return {
        name: f'joint "{name}" follows "{mimic.joint}", but {faults[mimic.joint]}'
        for name, mimic in mimics.items()
        if mimic.joint in faults
    }


def _reduced(joints: Sequence[Joint], mimics: _Mimics) -> Following:
    index = {joint.name: number for number, joint in enumerate(joints)}
    reduced = reduced_mimics(index, mimics, index.keys() - mimics.keys()).values()
    return Following(
        np.array([index[mimic.joint] for mimic in reduced], np.intp),
        np.array([mimic.multiplier for mimic in reduced], np.float64),
        np.array([mimic.offset for mimic in reduced], np.float64),
    )


def _narrow(
    joints: Sequence[Joint], limits: JointLimits, following: Following
) -> tuple[JointLimits, dict[str, str]]:
    """Narrow the limits of leaders so that their followers stay within their own.

    Returns:
        Limits of all joints, and messages about followers that no position of their leader keeps
        within their limits.
    """
    narrowed, wrong = deepcopy(limits), {}
    for row in np.flatnonzero(following.follows).tolist():
        leader, factor = int(following.leader[row]), float(following.factor[row])
        ends = np.array([limits.lower[row], limits.upper[row]]) - following.offset[row]
        if factor:
            ends = np.sort(ends / factor)
        elif ends[0] <= 0.0 <= ends[1]:  # the follower never moves
            continue
        lower, upper = max(narrowed.lower[leader], ends[0]), min(narrowed.upper[leader], ends[1])
        if lower > upper or not factor:
            wrong[joints[row].name] = (
                f'joint "{joints[row].name}" follows "{joints[leader].name}", and no position'
                " is within the limits of both; correct the limits or the mimic tag, or set"
                " use_mimic_tags to false"
            )
            continue
        narrowed.lower[leader], narrowed.upper[leader] = lower, upper
        speed = limits.velocity[row] / abs(factor)
        narrowed.velocity[leader] = min(narrowed.velocity[leader], speed)
    return narrowed, wrong
