"""Records the contacts of the robots of a world, in each physics step of a control cycle.

PyBullet only lists the contacts of the last step, including separated points with forces of earlier
steps. It only knows the loaded rigid bodies; among links that are fixed to each other, a contact
names the link with the nearest shape.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from onebot_control.physics.engine import Bullet, engine
from onebot_control.physics.friction import TOUCHING
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.scene import SceneBodies
from onebot_control.physics.spawning import RobotSpawn
from onebot_description.arrays import Floats
from onebot_description.elements.meshes import read_mesh
from onebot_description.elements.urdf import Box, Cylinder, Link, Mesh, Shape, Sphere
from onebot_description.geometry.poses import Transform, Triple, inverse
from onebot_description.model.rigid_bodies import merged_bodies, rigid_frames

GROUND, WORLD = "ground", "world"  # names of bodies other than robots
_BELOW = math.cos(math.radians(45.0))  # minimum z of the normal of a supporting surface

_FAST = 2.0  # m/s, expected maximum speed of bodies
_AGAIN = (20, 2)  # cycles between searches for nearby bodies: if there are none, and otherwise

_Place = tuple[int, int]  # PyBullet's indices of a body and its link
# A robot's body, and its minimum and maximum x, y, z.
_Box = tuple[int, Sequence[float], Sequence[float]]
_Names = tuple[str, str, str]  # the first fields of a ``Contact``
_Shapes = Sequence[tuple[Shape, Floats, Link]]  # see ``Body.collisions``
# PyBullet's list after a step, and poses before it of bodies of several links.
_Listed = tuple[Sequence[Sequence[Any]], Mapping[_Place, Transform]]


class Contact(NamedTuple):
    """A contact point of a robot in the last control cycle.

    Attributes:
        link: the robot's link, as in its URDF.
        other: the other body: "ground", "world", or the name of another robot.
        other_link: that body's link, as in its URDF; "" for the ground.
        point: position of the contact in the world, m.
        normal: unit vector in the world, from the other body towards the robot.
        force: normal force on the robot along ``normal``, mean over the cycle, N.
    """

    link: str
    other: str
    other_link: str
    point: Triple
    normal: Triple
    force: float


class _Touch(NamedTuple):
    """A point of PyBullet's list, from the side of one of the two bodies."""

    own: _Place
    other: _Place
    points: tuple[Triple, Triple]  # on the own body, and on the other one
    normal: Triple
    force: float


class ContactRecorder:
    """Records the contacts of a world's robots.

    Attributes:
        collided: whether each robot has touched something other than its support, since it was
            placed.
        always: whether there may be a contact in any cycle, because of arms or pushes.
        wanted: whether contacts have been requested; then each cycle records them.
    """

    def __init__(self, robots: Sequence[RobotBody], scene: SceneBodies | None) -> None:
        """Start without contacts; ``load`` must follow."""
        self._robots, self._scene = robots, scene
        self._links = [(_shapes(robot.spawn), _moved_links(robot.spawn)) for robot in robots]

    def load(self, bullet: Bullet) -> None:
        """Start without contacts in a world in which all bodies have just been loaded."""
        self._bullet = bullet
        self._rows = {robot.parts.body: row for row, robot in enumerate(self._robots)}
        self._filter = tuple(self._rows) if len(self._robots) == 1 else ()
        self._shapes: dict[_Place, _Shapes] = {}
        self._moved_places: set[_Place] = set()
        self._indices: dict[int, list[int]] = {}  # links of each robot that have shapes
        for robot, (shapes, moved) in zip(self._robots, self._links, strict=True):
            places = {link: (robot.parts.body, robot.parts.links[link]) for link in shapes}
            self._indices[robot.parts.body] = [index for _, index in places.values()]
            self._shapes |= {place: shapes[link] for link, place in places.items()}
            self._moved_places |= {place for link, place in places.items() if link in moved}
        self._sleepers: set[int] = set()  # boxes
        self._loaded = {robot.parts.body: robot.parts for robot in self._robots}
        for index, body, loaded in self._scene.bodies() if self._scene else ():
            self._shapes[index, -1] = body.collisions
            if loaded:
                self._loaded[index] = loaded
                if any(robot.spawn.fixed_base for robot in self._robots):
                    self._sleepers.add(index)
        self._merged = {
            place
            for place, shapes in self._shapes.items()
            if len({link.name for _, _, link in shapes}) > 1 and place[0] in self._loaded
        }
        # PyBullet's list after each step of the last cycle; None if it was not recorded.
        self._listed: list[_Listed] | None = []
        self._moved = {*range(len(self._robots))}  # robots that have been placed since then
        self._poses: dict[_Place, Transform] = {}
        self.collided, self.wanted = [False] * len(self._robots), False
        self.always = any(robot.spawn.starts for robot in self._robots)
        self._is_near, self._valid = False, 0  # whether robots are near anything; cycles left

    def may_collide(self, period: float) -> bool:
        """Return whether a robot may touch something in the next ``period``, s.

        Robots with commanded joints always may, others if they are near anything. Robots that have
        already collided are ignored.
        """
        robots = [
            robot
            for robot, collided in zip(self._robots, self.collided, strict=True)
            if self._sleepers or not collided
        ]
        self._valid -= 1
        if robots and not self.always and self._valid < 0:
            boxes = [self._box(robot) for robot in robots if self._indices[robot.parts.body]]
            for cycles in _AGAIN:
                reach = 2.0 * _FAST * cycles * period
                # Until the next step, PyBullet finds a placed robot at its former position.
                self._is_near = bool(self._moved) or any(self._nears(box, reach) for box in boxes)
                self._valid = cycles - 1
                if not self._is_near:
                    break
        return bool(robots) and (self.always or self._is_near)

    def _box(self, robot: RobotBody) -> _Box:
        """Return the current bounding box of a robot, along the world's axes."""
        body = robot.parts.body
        lows, highs = zip(
            *(self._bullet.getAABB(body, i) for i in self._indices[body]), strict=True
        )
        low, high = map(min, zip(*lows, strict=True)), map(max, zip(*highs, strict=True))
        return body, tuple(low), tuple(high)

    def _nears(self, box: _Box, reach: float) -> bool:
        """Return whether anything but the ground is within ``reach`` of a robot, m."""
        body, (left, back, bottom), (right, front, top) = box
        near = self._bullet.getOverlappingObjects(
            (left - reach, back - reach, bottom - reach),
            (right + reach, front + reach, top + reach),
        )
        return any(neighbor not in (body, self._bullet.ground) for neighbor, _ in near or ())

    def begin(self, *, recorded: bool) -> None:
        """Start a control cycle."""
        self._listed = [] if recorded else None
        self._moved.clear()
        if not recorded:
            self._poses.clear()

    def forget(self, robot: RobotBody) -> None:
        """Discard the contacts of a robot that has been moved to another place."""
        row = self._rows[robot.parts.body]
        self._moved.add(row)
        self._valid = 0
        self.collided[row] = False
        self._poses.clear()

    def record(self) -> None:
        """Record the contacts of the last physics step."""
        self._listed = self._listed or []
        poses, self._poses = self._poses, {}
        points = self._bullet.getContactPoints(*self._filter)
        self._listed.append((points, poses))
        merged, ground, always = self._merged, self._bullet.ground, bool(self._moved_places)
        for point in points:
            body, other_body = point[1], point[2]
            for place in ((body, point[3]), (other_body, point[4])):
                if place in merged and place not in self._poses:
                    self._poses[place] = self._loaded[place[0]].link_pose(place[1])
            if always or (other_body != ground and body != ground):
                for touch in self._touches(point):
                    self._judge(touch)

    def _touches(self, point: Sequence[Any]) -> Iterator[_Touch]:
        """Yield a point of PyBullet's list from the side of each robot that is part of it."""
        _, body, other_body, index, other_index, at, on, normal, apart, force, *_ = point
        # The solver skips points that are farther apart, whose force remains an old one.
        if force > 0.0 and apart <= TOUCHING:
            first, second, (x, y, z) = (body, index), (other_body, other_index), normal
            if body in self._rows:
                yield _Touch(first, second, (at, on), normal, force)
            if other_body in self._rows:
                yield _Touch(second, first, (on, at), (-x, -y, -z), force)

    def _judge(self, touch: _Touch) -> None:
        """Decide whether a contact is a collision."""
        row, other_body = self._rows[touch.own[0]], touch.other[0]
        if other_body in self._sleepers and touch.own[1] < 0 and self._robots[row].spawn.fixed_base:
            # PyBullet would keep the forces of the step in which a body fell asleep, without
            # gravity. Bodies beside moving ones do not sleep.
            self._sleepers.remove(other_body)
            state = engine.ACTIVATION_STATE_DISABLE_SLEEPING
            self._bullet.changeDynamics(other_body, -1, activationState=state)
        stands = other_body not in self._rows and touch.normal[2] > _BELOW
        if not stands or touch.own in self._moved_places:
            self.collided[row] = True

    def contacts(self, row: int) -> list[Contact]:
        """Return the contacts of a robot in the last cycle, at their last positions.

        They are recorded in each cycle from now on. If the last cycle was not recorded, these are
        the contacts of its last physics step.
        """
        self.wanted = True
        if row in self._moved:
            return []
        if self._listed is None:
            self.record()
        listed = self._listed or []
        sums = defaultdict[_Names, float](float)
        last: dict[_Names, list[_Touch]] = {}  # touches of the last step with any
        for points, poses in listed:
            touches = defaultdict[_Names, list[_Touch]](list)
            for touch in (item for point in points for item in self._touches(point)):
                if self._rows[touch.own[0]] == row:
                    names = self._names(touch, poses)
                    touches[names].append(touch)
                    sums[names] += touch.force
            last |= touches
        contacts = []
        for names, touched in last.items():
            share = sums[names] / len(listed) / sum(touch.force for touch in touched)
            contacts += [
                Contact(*names, touch.points[0], touch.normal, share * touch.force)
                for touch in touched
            ]
        return contacts

    def _names(self, touch: _Touch, poses: Mapping[_Place, Transform]) -> _Names:
        """Return the robot's link, the other body, and that body's link."""
        link, place = self._link(touch.own, touch.points[0], poses), touch.other
        if place not in self._shapes:
            return link, GROUND, ""
        row = self._rows.get(place[0])
        body = WORLD if row is None else self._robots[row].spawn.name
        return link, body, self._link(place, touch.points[1], poses)

    def _link(self, place: _Place, point: Triple, poses: Mapping[_Place, Transform]) -> str:
        """Return the link of a body whose shape is nearest to a point in the world."""
        shapes = self._shapes[place]
        if place not in self._merged:
            return shapes[0][2].name
        pose = poses.get(place) or self._loaded[place[0]].link_pose(place[1])
        at = np.array(inverse(pose).at(point))
        return min(shapes, key=lambda item: abs(_height(item[0], item[1], at)))[2].name


def _shapes(spawn: RobotSpawn) -> Mapping[str, _Shapes]:
    """Return the collision shapes of each rigid body of a robot, by its first link.

    A wheel that rolls on a thin cylinder has its original shapes, if they belong to other links.
    """
    shapes = {}
    written = merged_bodies(replace(spawn.description, links=spawn.links)) if spawn.links else {}
    for first, body in merged_bodies(spawn.description).items():
        names = [link.name for _, _, link in body.collisions]
        collisions = written[first].collisions if first in written else body.collisions
        differs = collisions and {*names} != {link.name for _, _, link in collisions}
        if names:
            shapes[first] = collisions if differs else body.collisions
    return shapes


def _moved_links(spawn: RobotSpawn) -> set[str]:
    """Return the first links of the bodies moved by commanded joints, which never support."""
    frames = rigid_frames(spawn.description)
    joints = {joint.child: joint for joint in spawn.description.moving_joints}
    commanded, moved = {*spawn.commanded, *spawn.gears} - {*spawn.steering}, set()
    for first in joints:
        link = first
        while link in joints and joints[link].name not in spawn.driven:
            if joints[link].name in commanded:
                moved.add(first)
            link, _ = frames[joints[link].parent]
    return moved


def _height(shape: Shape, pose: Floats, point: Floats) -> float:
    """Return the distance of a point (3,) in the body's frame to a surface, m; inside: < 0."""
    local = pose[:3, :3].T @ (point - pose[:3, 3])
    if isinstance(shape, Mesh):
        normals, offsets = _planes(shape)
        return float((normals @ local - offsets).max())
    if isinstance(shape, Sphere):
        return float(np.linalg.norm(local)) - shape.radius
    around, along = math.hypot(local[0], local[1]), abs(float(local[2]))
    if isinstance(shape, Box):
        beyond = np.abs(local) - np.array(shape.size) / 2.0
    elif isinstance(shape, Cylinder):
        beyond = np.array([around - shape.radius, along - shape.length / 2.0])
    else:
        return math.hypot(around, max(0.0, along - shape.length / 2.0)) - shape.radius
    return float(np.linalg.norm(np.maximum(beyond, 0.0)) + min(0.0, beyond.max()))


@lru_cache(maxsize=256)
def _planes(mesh: Mesh) -> tuple[Floats, Floats]:
    """Return the planes of a mesh's convex hull, as in PyBullet: normals (F, 3), offsets."""
    from trimesh.convex import convex_hull  # slow to import

    hull = convex_hull(read_mesh(mesh)[0])
    return hull.face_normals, (hull.face_normals * hull.triangles[:, 0]).sum(axis=1)
