"""Moves a joint at a commanded velocity by repeated short motions, each of which ends at rest."""

import math
from typing import NamedTuple

from onebot_description.elements.urdf import Joint
from onebot_description.geometry.poses import clamp

STEP = 0.1  # s to reach a velocity, to keep it, and to come to rest, each
_FASTEST = {"rad": 1.0, "m": 0.2}  # speed limit, rad/s and m/s, if the description allows more


class SteeredJoint(NamedTuple):
    """A joint that pages can move."""

    unit: str = "rad"  # unit of positions; "m" for a prismatic joint
    max_speed: float = 0.0  # unit/s; 0: it is not moved
    lower: float = -math.inf
    upper: float = math.inf

    @classmethod
    def from_joint(cls, joint: Joint) -> "SteeredJoint":
        """Return a joint of a description, which does not move if its limits are missing."""
        unit = "m" if joint.kind == "prismatic" else "rad"
        if joint.kind == "continuous":
            lower, upper = -math.inf, math.inf
        elif joint.lower is None or joint.upper is None:
            return cls(unit)
        else:
            lower, upper = joint.lower, joint.upper
        max_speed = math.inf if joint.velocity is None else joint.velocity
        return cls(unit, min(max_speed, _FASTEST[unit]), lower, upper)


class ShortMotion(NamedTuple):
    """Positions of a joint at three times, ``STEP`` apart, and its velocity at the first two.

    At the third time it is at rest.
    """

    reached: float
    kept: float
    rest: float
    velocity: float


def short_motion(
    joint: SteeredJoint, position: float, velocity: float, wanted: float, age: float
) -> ShortMotion:
    """Return the next motion of a joint from its last known position and velocity.

    The velocity changes linearly to the wanted one, or to one with which the joint comes to rest at
    its limit. A joint beyond a limit goes no farther.

    Args:
        joint: the joint, with its limits.
        position: its last known position, in its unit.
        velocity: its velocity since then, unit/s.
        wanted: the commanded velocity, unit/s.
        age: time since then, s.
    """
    lower, upper = min(joint.lower, position), max(joint.upper, position)
    stop = position + velocity * (age + STEP / 2.0)  # it rests there if ``wanted`` is 0
    time = 2.0 * STEP  # the distance that another velocity adds to that, per unit/s
    slowest, fastest = min(0.0, (lower - stop) / time), max(0.0, (upper - stop) / time)
    new = clamp(clamp(wanted, -joint.max_speed, joint.max_speed), slowest, fastest)
    reached = stop + new * STEP / 2.0
    kept, last = reached + new * STEP, reached + new * 1.5 * STEP
    return ShortMotion(
        clamp(reached, lower, upper), clamp(kept, lower, upper), clamp(last, lower, upper), new
    )
