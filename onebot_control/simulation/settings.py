"""How finely the world is computed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from onebot_description.description import Description
from onebot_description.errors import OneBotError

# What a world is told of each of its robots.


class Member(NamedTuple):
    """A robot to put into a world.

    Attributes:
        description: a checked robot.
        driven: its joints with a motor; see ``Simulation``.
        x: where the root link's frame starts, m.
        y: likewise, m.
        yaw: its heading, rad.
    """

    description: Description
    driven: Sequence[str]
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0


# Places on the ground where a robot may stand.

Place = tuple[float, float, float]

# Farther out, rounding is no longer small against the micrometres that a wheel's contact gives.
FARTHEST = 10_000.0


def checked_place(x: float, y: float, yaw: float) -> Place:
    """Return a place to stand at.

    Args:
        x: of the root link's frame, m.
        y: likewise, m.
        yaw: its heading, rad.

    Raises:
        ValueError: a value is not finite.
        OneBotError: it is too far away to be exact there.
    """
    if not all(map(math.isfinite, (x, y, yaw))):
        raise ValueError(f"x, y and yaw must be finite, not {x}, {y}, {yaw}")
    if max(abs(x), abs(y)) > FARTHEST:
        raise OneBotError(
            f"x {x:g} m, y {y:g} m: the simulation is exact up to {FARTHEST:g} m from the origin"
        )
    return float(x), float(y), float(yaw)


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation; the defaults were found by measuring.

    Attributes:
        rate: physics steps in a simulated second, 1/s. A whole number of them has to fit into each
            control period, which rules out PyBullet's own 240 at 100 Hz.
        iterations: of the constraint solver in each step. They never end early, so that a robot at
            rest creeps by nanometres instead of millimetres.
        gravity: m/s^2, downwards.
        friction: of the ground, and of every link for which the URDF says nothing else by
            ``<contact><lateral_friction>``; that of a pair is the product of both.
        settling: simulated seconds the robot is given to come to rest before it starts; of one
            that soon rests for good the rest of them is left out.
    """

    rate: int = 400
    iterations: int = 200
    gravity: float = 9.81
    friction: float = 1.0
    settling: float = 2.0

    def __post_init__(self) -> None:
        """Refuse numbers no world can be made of.

        Raises:
            OneBotError: one is not finite, or not above zero.
        """
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise OneBotError(f"simulation: {name} must be above 0 and finite, not {value}")
        for name in ("rate", "iterations"):
            if int(getattr(self, name)) != getattr(self, name):
                raise OneBotError(
                    f"simulation: {name} must be a whole number, not {getattr(self, name)}"
                )

    def steps(self, duration: float) -> int:
        """Return how many physics steps ``duration`` (s) is.

        Raises:
            ValueError: it is no whole number of them, or none at all.
        """
        exact = duration * self.rate
        count = round(exact) if math.isfinite(exact) else 0
        if count < 1 or abs(exact - count) > 1e-6:
            raise ValueError(
                f"duration must be a whole number of physics steps of 1/{self.rate} s, "
                f"not {duration} s"
            )
        return count
