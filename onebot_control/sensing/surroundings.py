"""What sensors see: ground, world, boxes and robots, by their visual shapes."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.poses import Transform
from onebot_control.sensing.rays import NOTHING, Surface, Targets
from onebot_control.sensing.solids import solid_of
from onebot_control.simulation.bodies import link_poses
from onebot_description.description import Description
from onebot_description.description.description import Geometry
from onebot_description.model.robot_model import RobotModel

Floats = NDArray[np.float64]


class SensedRobot(NamedTuple):
    """A robot that is seen."""

    description: Description
    joints: Sequence[str]  # that move, in the order of their positions
    held: Mapping[str, float]  # others, to their positions


class RobotState(NamedTuple):
    """Where a robot is."""

    translation: Floats  # (3,) of the root link in the world
    rotation: Floats  # (4,), likewise, x y z w
    positions: Floats  # of ``SensedRobot.joints``


class LinkPose(NamedTuple):
    """A link's frame in the world."""

    rotation: Floats  # (3, 3)
    position: Floats  # (3,)


class Surroundings:
    """What can be seen.

    Attributes:
        still: what does not move, in the world's frame.
        robots: those that can be seen.
    """

    def __init__(self, world: Description | None, robots: Sequence[SensedRobot]) -> None:
        self._made: dict[tuple[Geometry, ...], Surface] = {}
        firsts = link_poses(world) if world else {}
        boxes = [joint.child for joint in world.joints if joint.kind == "floating"] if world else []
        parts: dict[str, list[tuple[Geometry, Floats]]] = {name: [] for name in ("", *boxes)}
        for link in world.links if world else ():
            first, pose = firsts[link.name]
            body = first if first in parts else ""
            parts[body] += [(visual, pose) for visual in link.visuals]
        self.still = Surface(solid_of(parts[""]))
        self._surfaces = [Surface(solid_of(parts[box])) for box in boxes]
        self.robots = [self._enter(robot) for robot in robots]
        spheres = [surface.solid.sphere for surface in self._surfaces]
        self._centers = np.array([center for center, _ in spheres]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in spheres])

    def _enter(self, robot: SensedRobot) -> "RobotLinks":
        """Add the surfaces of a robot's links."""
        targets = {}
        for link in robot.description.links:
            if link.visuals not in self._made:
                solid = solid_of([(visual, np.eye(4)) for visual in link.visuals])
                self._made[link.visuals] = Surface(solid)
            if len(self._made[link.visuals].solid.faces):
                self._surfaces.append(self._made[link.visuals])
                targets[link.name] = len(self._surfaces)
        return RobotLinks(robot, targets)

    @cached_property
    def _kinds(self) -> list[tuple[Surface, NDArray[np.intp]]]:
        """Each surface, with the targets that have it."""
        kinds: dict[Surface, list[int]] = {}
        for index, surface in enumerate(self._surfaces):
            kinds.setdefault(surface, []).append(index)
        return [(surface, np.array(rows, np.intp)) for surface, rows in kinds.items()]

    def target(self, row: int, link: str) -> int:
        """Return the index of a robot's link among the targets, as ``cast`` counts them."""
        return self.robots[row].targets.get(link, NOTHING)

    def targets(
        self, boxes: Sequence[Transform], links: Sequence[tuple[Floats, Floats]]
    ) -> Targets:
        """Return what moves, with its boxes and the robots' links at these poses."""
        pairs = [(np.array(turn), np.array(at)) for at, turn in boxes]
        rotations = [matrices(np.array([turn for turn, _ in pairs]).reshape(-1, 4))]
        positions = [np.array([at for _, at in pairs]).reshape(-1, 3)]
        for robot, (turns, places) in zip(self.robots, links, strict=True):
            rotations.append(turns[robot.seen])
            positions.append(places[robot.seen])
        turned, at = np.concatenate(rotations), np.concatenate(positions)
        centers = np.einsum("bij,bj->bi", turned, self._centers) + at
        return Targets(self._surfaces, self._kinds, turned, at, centers, self._radii)


class Placed:
    """Surroundings at one time; what nobody asks for is not computed."""

    def __init__(
        self,
        surroundings: Surroundings,
        boxes: Sequence[Transform],
        states: Sequence[RobotState],
    ) -> None:
        self._surroundings, self._boxes, self._states = surroundings, boxes, states
        self._links: dict[int, tuple[Floats, Floats]] = {}

    @cached_property
    def targets(self) -> Targets:
        """What may have moved."""
        links = [self._links_of(row) for row in range(len(self._states))]
        return self._surroundings.targets(self._boxes, links)

    def link(self, row: int, name: str) -> LinkPose | None:
        """Return where a link of a robot is; None if it has no such link."""
        number = self._surroundings.robots[row].numbers.get(name)
        if number is None:
            return None
        turns, places = self._links_of(row)
        return LinkPose(turns[number], places[number])

    def _links_of(self, row: int) -> tuple[Floats, Floats]:
        if row not in self._links:
            self._links[row] = self._surroundings.robots[row].poses(self._states[row])
        return self._links[row]


class RobotLinks:
    """A robot's links.

    Attributes:
        targets: the targets that they are, by name; what has no shape is none.
        numbers: of all links, by name.
        seen: numbers of those that are targets.
    """

    def __init__(self, robot: SensedRobot, targets: Mapping[str, int]) -> None:
        self._model = model = RobotModel.from_description(robot.description)
        self.targets, self.numbers = targets, {name: row for row, name in enumerate(model.links)}
        self.seen = np.array([self.numbers[name] for name in targets], np.intp)
        self._positions = model.positions(
            {name: at for name, at in robot.held.items() if name in model.joints}
        )
        self._rows = np.array([model.row(name) for name in robot.joints], np.intp)

    def poses(self, state: RobotState) -> tuple[Floats, Floats]:
        """Return rotations (L, 3, 3) and positions (L, 3) of all links in the world."""
        positions = self._positions.copy()
        positions[self._rows] = state.positions
        poses = self._model.link_poses(positions)
        base = matrices(state.rotation[None])[0]
        return base @ matrices(poses[:, 3:]), poses[:, :3] @ base.T + state.translation


def matrices(rotations: Floats) -> Floats:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4), x y z w."""
    x, y, z, w = rotations.T
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    rows = (
        (1 - yy - zz, xy - wz, xz + wy),
        (xy + wz, 1 - xx - zz, yz - wx),
        (xz - wy, yz + wx, 1 - xx - yy),
    )
    result: Floats = np.array(rows).transpose(2, 0, 1)
    return result
