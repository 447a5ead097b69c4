"""What a world is made of: how finely it is computed, and which robots start where."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from onebot_description.description import Description
from onebot_description.errors import OneBotError

# Farther out, rounding is no longer small against the micrometres that a wheel's contact gives, m.
FARTHEST = 10_000.0


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation; the defaults were found by measuring."""

    # Physics steps in a simulated second, 1/s. A whole number of them has to fit into each control
    # period, which rules out PyBullet's own 240 at 100 Hz.
    rate: int = 400
    # Of the constraint solver in each step. They never end early, so that a robot at rest creeps by
    # nanometres instead of millimetres.
    iterations: int = 200
    gravity: float = 9.81  # m/s^2, downwards
    # Of the ground, and of every link for which the URDF gives no <contact><lateral_friction>; that
    # of a pair is the product of both.
    friction: float = 1.0
    # Simulated seconds the robot is given to come to rest before it starts; fewer if it soon does.
    settling: float = 2.0

    def __post_init__(self) -> None:
        """Refuse numbers that no world can be computed with.

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


class RobotSpawn(NamedTuple):
    """A robot to put into a world, and where its root link's frame starts."""

    description: Description
    driven: Sequence[str]  # its joints with a motor; see ``Simulation``
    x: float = 0.0  # m
    y: float = 0.0  # m
    yaw: float = 0.0  # heading, rad


SpawnPose = tuple[float, float, float]  # x and y of the root link's frame, m, and yaw, rad


def checked_spawn_pose(x: float, y: float, yaw: float) -> SpawnPose:
    """Return a pose that a robot may be put at, m and rad.

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
