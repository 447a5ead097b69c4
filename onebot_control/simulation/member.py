"""What a world is told of each of its robots."""

from collections.abc import Sequence
from typing import NamedTuple

from onebot_description.description import Description


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
