"""The surroundings seen by sensors: the visual shapes of world, boxes and robots."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from onebot_control.sensing.rays import NOTHING, Surface, Targets
from onebot_control.sensing.solids import solid_of
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.elements.urdf import Geometry
from onebot_description.geometry.poses import Transform
from onebot_description.geometry.quaternions import to_matrix
from onebot_description.model.rigid_bodies import rigid_frames
from onebot_description.model.robot_model import RobotModel

K = TypeVar("K", bound=Hashable)


class SensedRobot(NamedTuple):
    """A robot as seen by sensors."""

    description: Description
    joints: Sequence[str]  # moving joints, in the order of their positions
    held: Mapping[str, float]  # positions of the other joints, by name


RobotState = tuple[Transform, Sequence[float]]
"""The pose of a robot's root link, and the positions of ``SensedRobot.joints``, rad or m."""


class LinkPose(NamedTuple):
    """The pose of a link's frame in the world, or several poses."""

    rotation: Floats  # (..., 3, 3)
    position: Floats  # (..., 3)


class VisibleSurfaces:
    """The visible surfaces of a world, its boxes and robots, without their poses.

    Attributes:
        still: the surface of all fixed bodies, in the world's frame.
        kinds: the robots, grouped by description.
    """

    def __init__(self, world: Description | None, robots: Sequence[SensedRobot]) -> None:
        """Build all surfaces; robots with the same description share them."""
        still, *boxes = map(solid_of, _visuals(world))
        self.still = Surface(still)
        self._surfaces = [Surface(box) for box in boxes]
        self._made: dict[tuple[Geometry, ...], Surface] = {}
        self._targets = [self._enter(robot.description) for robot in robots]
        rows = _alike(
            (robot.description.urdf, tuple(robot.joints), tuple(robot.held.items()))
            for robot in robots
        )
        self.kinds = [RobotKind(robots[group[0]], group, self._targets) for group in rows.values()]
        self._alike = {
            surface: np.array(group, np.intp) for surface, group in _alike(self._surfaces).items()
        }
        spheres = [surface.solid.sphere for surface in self._surfaces]
        self._centers = np.array([center for center, _ in spheres]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in spheres])
        self._boxes = np.array([surface.solid.box for surface in self._surfaces])

    def _enter(self, robot: Description) -> dict[str, int]:
        """Add the surfaces of a robot's links; return their target indices by link."""
        targets = {}
        for link in robot.links:
            if link.visuals not in self._made:
                solid = solid_of([(visual, np.eye(4)) for visual in link.visuals])
                self._made[link.visuals] = Surface(solid)
            if len(self._made[link.visuals].solid.faces):
                self._surfaces.append(self._made[link.visuals])
                targets[link.name] = len(self._surfaces)
        return targets

    def target(self, row: int, link: str) -> int:
        """Return the index of a robot's link among the targets of ``cast``; NOTHING without one."""
        return self._targets[row].get(link, NOTHING)

    def link(self, row: int, name: str, states: Sequence[RobotState]) -> LinkPose | None:
        """Return the poses of a robot's link in several states; None if it has no such link."""
        for kind in self.kinds:
            if row in kind.rows and name in kind.numbers:
                rotations, positions = kind.links(states)
                return LinkPose(rotations[:, kind.numbers[name]], positions[:, kind.numbers[name]])
        return None

    def targets(
        self, boxes: Sequence[Transform], links: Sequence[tuple[Floats, Floats]]
    ) -> Targets:
        """Return the moving surfaces at their poses.

        Args:
            boxes: poses of the boxes in the world.
            links: for each of ``kinds``, rotations (R, L, 3, 3) and positions (R, L, 3) of its
                links in the world.
        """
        turns, places = np.empty((len(self._surfaces), 3, 3)), np.empty((len(self._surfaces), 3))
        if boxes:
            places[: len(boxes)] = [position for position, _ in boxes]
            turns[: len(boxes)] = to_matrix([turn for _, turn in boxes])
        for kind, (rotations, positions) in zip(self.kinds, links, strict=True):
            turns[kind.targets] = rotations[:, kind.seen]
            places[kind.targets] = positions[:, kind.seen]
        centers = np.einsum("bij,bj->bi", turns, self._centers) + places
        return Targets(
            self._surfaces, self._alike, turns, places, centers, self._radii, self._boxes
        )


def _visuals(world: Description | None) -> list[list[tuple[Geometry, Floats]]]:
    """Return the visuals of a world's fixed bodies, then of each movable box.

    Each visual has the pose (4, 4) of its link in the frame of its rigid body.
    """
    if world is None:
        return [[]]
    boxes = [joint.child for joint in world.joints if joint.kind == "floating"]
    parts: dict[str, list[tuple[Geometry, Floats]]] = {name: [] for name in ("", *boxes)}
    poses = rigid_frames(world)
    for link in world.links:
        first, pose = poses[link.name]
        parts[first if first in parts else ""] += [(visual, pose) for visual in link.visuals]
    return [*parts.values()]


def _alike(keys: Iterable[K]) -> dict[K, list[int]]:
    """Return the indices of each key."""
    indices: dict[K, list[int]] = {}
    for index, key in enumerate(keys):
        indices.setdefault(key, []).append(index)
    return indices


class Placed:
    """Visible surfaces at one time; poses are computed when first needed."""

    def __init__(
        self,
        surroundings: VisibleSurfaces,
        boxes: Sequence[Transform],
        states: Sequence[RobotState],
    ) -> None:
        """Store the poses of boxes in the world, and the states of robots, by row."""
        self.surroundings, self._boxes, self._states = surroundings, boxes, states

    @cached_property
    def targets(self) -> Targets:
        """The moving surfaces at their poses."""
        return self.surroundings.targets(self._boxes, self._links)

    @cached_property
    def _links(self) -> list[tuple[Floats, Floats]]:
        kinds = self.surroundings.kinds
        return [kind.links([self._states[row] for row in kind.rows]) for kind in kinds]

    def link(self, row: int, name: str) -> LinkPose | None:
        """Return the pose of a link of the robot ``row``; None if it has no such link."""
        for kind, (rotations, positions) in zip(self.surroundings.kinds, self._links, strict=True):
            if row in kind.rows and name in kind.numbers:
                place = kind.rows.index(row), kind.numbers[name]
                return LinkPose(rotations[place], positions[place])
        return None


class RobotKind:
    """Robots with the same description, whose link poses are computed together.

    Attributes:
        rows: rows of these R robots in their world.
        numbers: indices of the L links, by name.
        seen: indices of the S links with a shape.
        targets: (R, S), indices of these links among the surfaces.
    """

    def __init__(
        self, robot: SensedRobot, rows: Sequence[int], targets: Sequence[Mapping[str, int]]
    ) -> None:
        self._model = model = RobotModel.from_description(robot.description)
        self.rows, self.numbers = rows, {name: row for row, name in enumerate(model.links)}
        self.seen = [self.numbers[name] for name in targets[rows[0]]]
        self.targets = np.array([[*targets[row].values()] for row in rows], np.intp) - 1
        self._positions = model.positions(
            {name: at for name, at in robot.held.items() if name in model.joints}
        )
        self._joints = [model.row(name) for name in robot.joints]

    def links(self, states: Sequence[RobotState]) -> tuple[Floats, Floats]:
        """Return rotations (R, L, 3, 3) and positions (R, L, 3) of all links in the world."""
        positions = np.tile(self._positions, (len(states), 1))
        positions[:, self._joints] = [joints for _, joints in states]
        poses = self._model.link_poses(positions)
        bases = to_matrix([pose.rotation for pose, _ in states])
        turns = to_matrix(poses[..., 3:])
        places = poses[..., :3] @ bases.transpose(0, 2, 1)
        places += np.array([pose.translation for pose, _ in states])[:, None]
        return bases[:, None] @ turns, places
