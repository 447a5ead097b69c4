"""Position and velocity limits of the movable joints."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.elements.urdf import MOVING_KINDS, Joint
from onebot_description.errors import unknown_names
from onebot_description.parameters.reader import Problem


@dataclass(frozen=True)
class JointLimits:
    """Limits of N joints, in rad and rad/s (m and m/s); infinite if there is no limit."""

    lower: Floats  # (N,)
    upper: Floats  # (N,)
    velocity: Floats  # (N,), >= 0


def movable(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Return the joints with one degree of freedom: all but fixed, floating and planar ones."""
    return tuple(joint for joint in joints if joint.kind in MOVING_KINDS)


def not_moving(
    names: Iterable[str], joints: Sequence[Joint], all_joints: Sequence[Joint]
) -> dict[str, str]:
    """Return what is wrong with each of ``names`` that is not that of one of the movable joints.

    Args:
        names: names of joints.
        joints: the movable joints.
        all_joints: all joints of the robot.
    """
    fixed = {joint.name: f'joint "{joint.name}" is {joint.kind}' for joint in all_joints}
    hints = unknown_names(names, [joint.name for joint in joints], "joints that move")
    return {
        name: fixed.get(name, f'the robot has no joint "{name}"') + hint for name, hint in hints
    }


def joint_limits(joints: Sequence[Joint], *, soft: bool) -> tuple[JointLimits, list[Problem]]:
    """Return the limits of movable joints.

    Args:
        joints: the N movable joints.
        soft: also apply the soft limits of safety_controller.

    Returns:
        The limits, and a problem for each revolute or prismatic joint that has no limits: it stays
        at 0. Soft limits that leave no range are not applied.
    """
    problems: list[Problem] = []
    ranges = np.array([_range(joint, soft, problems) for joint in joints]).reshape(-1, 2)
    speeds = [math.inf if j.velocity is None else max(0.0, j.velocity) for j in joints]
    return JointLimits(ranges[:, 0], ranges[:, 1], np.array(speeds, dtype=np.float64)), problems


def zero_position(lower: float, upper: float) -> float:
    """Return the default position: 0, or mid-range if 0 is out of range."""
    return 0.0 if lower <= 0.0 <= upper else (lower + upper) / 2.0


def _range(joint: Joint, soft: bool, problems: list[Problem]) -> tuple[float, float]:
    if joint.kind == "continuous":
        return -math.inf, math.inf
    if joint.lower is None or joint.upper is None:
        text = f'Limits must be specified for joint "{joint.name}" of type "{joint.kind}"'
        problems.append(Problem("", f"{text}; it stays at 0"))
        return 0.0, 0.0
    hard = joint.lower, joint.upper
    if not soft:
        return hard
    soft_lower = -math.inf if joint.soft_lower is None else joint.soft_lower
    soft_upper = math.inf if joint.soft_upper is None else joint.soft_upper
    lower, upper = max(hard[0], soft_lower), min(hard[1], soft_upper)
    return (lower, upper) if lower <= upper else hard
