"""Which joints move, how far and how fast."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import JointSpec
from onebot_description.parameters.reader import ConfigError, Problem

FloatArray = NDArray[np.float64]
SoftLimits = Mapping[str, tuple[float, float]]

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Limits:
    """Limits of N joints, in rad and rad/s (m and m/s); infinite where there is none.

    Attributes:
        lower: (N,).
        upper: (N,).
        velocity: (N,), >= 0.
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray

    def copy(self) -> "Limits":
        """Return limits that can be narrowed without changing these."""
        return Limits(self.lower.copy(), self.upper.copy(), self.velocity.copy())


def movable(joints: Sequence[JointSpec]) -> tuple[JointSpec, ...]:
    """Return the joints that have one position: no fixed, floating or planar ones."""
    return tuple(joint for joint in joints if joint.kind in MOVABLE)


def soft_limits(urdf: str) -> dict[str, tuple[float, float]]:
    """Read each joint's ``<safety_controller>``.

    Args:
        urdf: the expanded URDF text.

    Returns:
        Joint name to (soft_lower_limit, soft_upper_limit), infinite where one is not given.

    Raises:
        ConfigError: a soft limit is not a number.
    """
    found: dict[str, tuple[float, float]] = {}
    for joint in ElementTree.fromstring(urdf.encode()).iterfind("joint"):
        tag = joint.find("safety_controller")
        if tag is not None:
            name = joint.get("name", "")
            found[name] = (
                _attribute(tag, "soft_lower_limit", name, -math.inf),
                _attribute(tag, "soft_upper_limit", name, math.inf),
            )
    return found


def joint_limits(joints: Sequence[JointSpec], soft: SoftLimits) -> Limits:
    """Return the limits of movable joints, the smaller of hard and soft ones.

    Raises:
        ConfigError: a revolute or prismatic joint without limits, or soft limits that leave it
            no range.
    """
    problems: list[Problem] = []
    ranges = np.array([_range(joint, soft, problems) for joint in joints]).reshape(-1, 2)
    speeds = [math.inf if j.velocity is None else max(0.0, j.velocity) for j in joints]
    if problems:
        raise ConfigError(problems)
    return Limits(ranges[:, 0], ranges[:, 1], np.array(speeds, dtype=np.float64))


def zero_position(lower: float, upper: float) -> float:
    """Return where a joint stands when nothing is said: 0, or mid-range if 0 is out of range."""
    return 0.0 if lower <= 0.0 <= upper else (lower + upper) / 2.0


def _range(joint: JointSpec, soft: SoftLimits, problems: list[Problem]) -> tuple[float, float]:
    if joint.kind == "continuous":
        return -math.inf, math.inf
    if joint.lower is None or joint.upper is None:
        text = f'Limits must be specified for joint "{joint.name}" of type "{joint.kind}"'
        problems.append(Problem("", text))
        return 0.0, 0.0
    soft_lower, soft_upper = soft.get(joint.name, (-math.inf, math.inf))
    lower, upper = max(joint.lower, soft_lower), min(joint.upper, soft_upper)
    if lower > upper:
        text = (
            f'joint "{joint.name}": limits [{joint.lower:g}, {joint.upper:g}] and soft limits'
            f" [{soft_lower:g}, {soft_upper:g}] leave no range; mend its safety_controller or set"
            " use_smallest_joint_limits to false"
        )
        problems.append(Problem("", text))
    return lower, upper


def _attribute(tag: ElementTree.Element, name: str, joint: str, default: float) -> float:
    text = tag.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        message = f'joint "{joint}": {name}="{text}" of its safety_controller is no finite number'
        raise ConfigError([Problem("", message)])
    return value
