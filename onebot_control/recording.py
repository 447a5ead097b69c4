"""Records the poses and joints of a simulation: as arrays, and moment by moment."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.geometry.poses import Transform, to_rpy

_AXES = ("x", "y", "z", "roll", "pitch", "yaw")


class Moment(NamedTuple):
    """The poses and joints of all robots at one time.

    Attributes:
        time: simulated time, s.
        stamp: that time on ROS topics, ns: one control period later.
        poses: the robots' root links in the world, in the order of ``Simulation.robots``.
        joints: joint positions by name for each robot, rad or m.
        boxes: poses in the world of movable boxes, by link.
    """

    time: float
    stamp: int
    poses: Sequence[Transform]
    joints: Sequence[Mapping[str, float]]
    boxes: Mapping[str, Transform]


class MomentLog:
    """The last moments of a simulation.

    Attributes:
        every: control cycles from one moment to the next.
        moments: the moments, oldest first.
    """

    def __init__(self, every: int, most: int | None) -> None:
        """Begin without moments; ``most`` is how many are kept, None for all."""
        self.every, self.moments = every, deque[Moment](maxlen=most)

    def columns(self, robots: Sequence[str]) -> dict[str, Floats]:
        """Return the moments as arrays (N,), as described in ``Simulation.log``.

        Args:
            robots: names of the robots; the name of a single one is "".
        """
        rows = [self._row(moment, robots) for moment in self.moments]
        names = rows[0] if rows else ()
        return {name: np.array([row[name] for row in rows]) for name in names}

    def _row(self, moment: Moment, robots: Sequence[str]) -> dict[str, float]:
        row = {"time": moment.time}
        for name, pose, joints in zip(robots, moment.poses, moment.joints, strict=True):
            prefix = f"{name}." if name else ""
            row |= {f"{prefix}{key}": value for key, value in _named(pose)}
            row |= {f"{prefix}joints.{joint}": value for joint, value in joints.items()}
        for box, pose in moment.boxes.items():
            row |= {f"boxes.{box}.{key}": value for key, value in _named(pose)}
        return row


def _named(pose: Transform) -> Iterator[tuple[str, float]]:
    translation, rotation = pose
    return zip(_AXES, (*translation, *to_rpy(rotation)), strict=True)
