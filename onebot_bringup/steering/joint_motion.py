"""How a joint moves at a commanded velocity: by a short motion at a time, which ends at rest."""

import math
from typing import NamedTuple

from onebot_control.drive.speed_limiter import clamp
from onebot_description.description.description import Joint

STEP = 0.1  # s to reach a velocity, then to keep it, then to come to rest
_FASTEST = {"rad": 1.0, "m": 0.2}  # rad/s, m/s; where the description allows more


class SteeredJoint(NamedTuple):
    """A joint that pages move."""

    unit: str = "rad"  # of positions; "m" of a prismatic joint
    most: float = 0.0  # its greatest speed, unit/s; 0: it is not moved
    lower: float = -math.inf
    upper: float = math.inf

    @classmethod
    def of(cls, joint: Joint) -> "SteeredJoint":
        """Return a joint of a description; one whose limits are missing is not moved."""
        unit = "m" if joint.kind == "prismatic" else "rad"
        if joint.kind == "continuous":
            lower, upper = -math.inf, math.inf
        elif joint.lower is None or joint.upper is None:
            return cls(unit)
        else:
            lower, upper = joint.lower, joint.upper
        most = math.inf if joint.velocity is None else joint.velocity
        return cls(unit, min(most, _FASTEST[unit]), lower, upper)


class ShortMotion(NamedTuple):
    """Positions of a joint at three times, ``STEP`` apart, and its velocity at the first two.

    At the third it is at rest.
    """

    reached: float
    kept: float
    rest: float
    velocity: float


def short_motion(
    joint: SteeredJoint, position: float, velocity: float, wanted: float, age: float
) -> ShortMotion:
    """Return how a joint goes on, from now, that was seen at a position and a velocity.

    The velocity changes evenly to the one that is wanted, or to the one with which the joint comes
    to rest at its limit. It goes no farther beyond a limit than it was seen.

    Args:
        joint: with its limits.
        position: in its unit.
        velocity: in its unit/s; it has kept it since then.
        wanted: the velocity that is commanded.
        age: s since then.
    """
    lower, upper = min(joint.lower, position), max(joint.upper, position)
    stop = position + velocity * (age + STEP / 2.0)  # where it comes to rest if none is wanted
    time = 2.0 * STEP  # what another velocity adds to that is so long its way
    slowest, fastest = min(0.0, (lower - stop) / time), max(0.0, (upper - stop) / time)
    new = clamp(clamp(wanted, -joint.most, joint.most), slowest, fastest)
    reached = stop + new * STEP / 2.0
    kept, rest = reached + new * STEP, reached + new * 1.5 * STEP
    return ShortMotion(
        clamp(reached, lower, upper), clamp(kept, lower, upper), clamp(rest, lower, upper), new
    )
