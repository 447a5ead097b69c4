"""Loads the scene around the robots of a world: walls, ramps, and boxes that can be pushed.

A scene is described in URDF, like a robot. Links that are connected to the root link by fixed
joints do not move, regardless of their mass. A link below a ``floating`` joint, with everything
fixed to it, is a movable body, which falls and can be pushed.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from onebot_control.physics.engine import Bullet, engine
from onebot_control.physics.spawning import (
    LoadedBody,
    RobotSpawn,
    load_fixed,
    load_robot,
)
from onebot_description.description.loading import load_world
from onebot_description.elements.urdf import Description
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import PlanarPose, Transform
from onebot_description.model.rigid_bodies import Body, merged_bodies, rigid_frames
from onebot_description.model.robot_model import JointArrays

_DEPTH = 1e-3  # m; touching bodies overlap by less
# m. According to measurements, PyBullet gently separates bodies that overlap by up to 15 mm; deeper
# ones are thrown: a box of 0.2 m that is half in the ground jumps 0.5 m high. Any other place for
# such a box would be a guess, so it is rejected, like a robot that starts in a wall.
_DEEPEST = 0.01
_SLEEPS, _AWAKE = "ENABLE_SLEEPING ENABLE_WAKEUP", "WAKE_UP"  # suffixes of PyBullet's constants


def load_scene(world: str) -> Description | None:
    """Load the description of a world, and check that it can be simulated.

    Args:
        world: name or file, as in ``load_world``; "" for bare ground.

    Returns:
        The description; None for bare ground.

    Raises:
        OneBotError: the world does not exist, or cannot be simulated.
    """
    if not world:
        return None
    description = load_world(world)
    with closing(Bullet()) as bullet:
        bullet.set_up()
        SceneBodies(description).enter(bullet)
    return description


class SceneBodies:
    """The bodies of a scene in a PyBullet world.

    Attributes:
        description: description of the scene.
        links: the first link of each movable body.
        parts: the movable bodies, in the same order.
        poses: poses of these links' frames in the world, as last read.
        finite: whether these poses are finite.
    """

    def __init__(self, description: Description) -> None:
        """Divide a scene into its bodies; ``enter`` adds them to a world.

        Raises:
            OneBotError: something cannot be simulated, with one line per problem.
        """
        self._firsts = {link: first for link, (first, _) in rigid_frames(description).items()}
        self.description = description
        description.require_tree()
        if problems := [*self._joint_problems()]:
            raise OneBotError("\n".join(problems))
        joints = tuple(replace(joint, kind="fixed") for joint in description.joints)
        poses = rigid_frames(replace(description, joints=joints))  # poses in the root link's frame
        # Each shape becomes a separate body: in each step, PyBullet checks all shapes of a body,
        # but only if the body is nearby.
        self._fixed = []
        for link in description.links:
            for shape in link.collisions:
                if self._firsts[link.name] == description.root_link:
                    self._fixed.append(Body(link.name))
                    part = replace(link, collisions=(shape,))
                    self._fixed[-1].add(part, poses[link.name][1])
        self.links = tuple(joint.child for joint in description.joints if joint.kind == "floating")
        self._free = [self._part(link) for link in self.links]
        self._starts = [matrices.to_origin(poses[name][1]).transform for name in self.links]
        self.poses: Sequence[Transform] = self._starts
        self.finite = True

    def _joint_problems(self) -> Iterator[str]:
        """Report joints that are valid in a robot, but not in a scene."""
        for joint in self.description.joints:
            where = f'{joint.where}: joint "{joint.name}"'
            if joint.kind not in ("fixed", "floating"):
                yield (
                    f'{where} is {joint.kind}; the joints of a world are type="fixed" (stands '
                    'still) or type="floating" (can be pushed)'
                )

    def _part(self, first: str) -> Description:
        """Return the description of the movable body whose first link is ``first``."""
        description = self.description
        links = tuple(link for link in description.links if self._firsts[link.name] == first)
        names = {link.name for link in links} - {first}
        joints = tuple(joint for joint in description.joints if joint.child in names)
        return replace(description, root_link=first, links=links, joints=joints)

    def enter(self, bullet: Bullet, *, free: bool = True) -> None:
        """Load the bodies into a world.

        Args:
            bullet: the world.
            free: also load the movable bodies.

        Raises:
            OneBotError: a body cannot be loaded, or a movable one starts in something else.
        """
        self._bullet = bullet
        self.fixed = {load_fixed(bullet, self.description, body): body.link for body in self._fixed}
        self.parts: list[LoadedBody] = []
        for part, start in zip(self._free if free else (), self._starts, strict=False):
            self.parts.append(load_robot(bullet, RobotSpawn(part, ())))
            self.parts[-1].place(start)
            # A sleeping body takes no time until something touches it; two awake crates took half
            # the time of a step.
            self._activate(self.parts[-1], _SLEEPS)
        if problems := [*self._overlap_problems()]:
            raise OneBotError("\n".join(problems))
        self.read()

    def _overlap_problems(self) -> Iterator[str]:
        """Report boxes that overlap the ground, a fixed body or another box."""
        joints = {joint.child: joint for joint in self.description.joints}
        obstacles: dict[str, list[int]] = {"the ground": [self._bullet.ground]}
        for body, link in self.fixed.items():
            obstacles.setdefault(f'link "{link}"', []).append(body)
        for link, part in zip(self.links, self.parts, strict=False):
            where = f'{joints[link].where}: joint "{joints[link].name}": link "{link}"'
            for obstacle, bodies in obstacles.items():
                if (depth := max(self._depth(part.body, body) for body in bodies)) > _DEEPEST:
                    remedy = f"{'raise' if obstacle == 'the ground' else 'move'} its <origin>"
                    text = f"starts {depth:.3g} m deep in {obstacle}, which would throw it out"
                    yield f"{where} {text}; {remedy}"
            obstacles[f'link "{link}"'] = [part.body]

    def bodies(self) -> Iterator[tuple[int, Body, LoadedBody | None]]:
        """Yield PyBullet's index and the shapes of each body, and the body if it is movable."""
        for index, body in zip(self.fixed, self._fixed, strict=True):
            yield index, body, None
        for part, loaded in zip(self._free, self.parts, strict=False):
            yield loaded.body, merged_bodies(part)[part.root_link], loaded

    def read(self) -> None:
        """Read the poses of the movable bodies."""
        self.poses = [part.pose() for part in self.parts]
        self.finite = math.isfinite(sum(sum(at) + sum(turn) for at, turn in self.poses))

    def put(self, poses: Sequence[Transform]) -> None:
        """Place the movable bodies at ``poses``, at rest."""
        for part, pose in zip(self.parts, poses, strict=True):
            part.place(pose)
            self._activate(part, _AWAKE)
        self.read()

    def put_back(self, robots: Sequence[LoadedBody]) -> None:
        """Place movable bodies at their start, at rest, unless one of ``robots`` is there.

        Call ``read`` afterwards.
        """
        for part, pose, start in zip(self.parts, self.poses, self._starts, strict=True):
            part.place(start)
            if any(self._overlaps(robot, part.body) for robot in robots):
                part.place(pose)
            self._activate(part, _AWAKE)

    def _activate(self, part: LoadedBody, states: str) -> None:
        state = sum(getattr(engine, f"ACTIVATION_STATE_{name}") for name in states.split())
        self._bullet.changeDynamics(part.body, -1, activationState=state)

    def fixed_at(self, robot: LoadedBody) -> dict[int, str]:
        """Return the fixed bodies that ``robot`` overlaps, with the names of their links."""
        return {body: link for body, link in self.fixed.items() if self._overlaps(robot, body)}

    def moving_links_in(self, robot: LoadedBody) -> list[str]:
        """Return the links of fixed bodies that moving links of ``robot`` deeply overlap."""
        return [
            link
            for body, link in self.fixed.items()
            if self._depth(robot.body, body, moved=True) > _DEEPEST
        ]

    def free_at(self, robot: LoadedBody) -> list[str]:
        """Return the movable links that ``robot`` overlaps."""
        return [
            link
            for link, part in zip(self.links, self.parts, strict=True)
            if self._overlaps(robot, part.body)
        ]

    def _overlaps(self, robot: LoadedBody, body: int) -> bool:
        return self._depth(robot.body, body) > _DEPTH

    def _depth(self, one: int, other: int, *, moved: bool = False) -> float:
        """Return the overlap of two bodies, m; 0 if there is none.

        ``moved`` restricts this to the links of ``one`` that are moved by its joints.
        """
        near = self._bullet.getClosestPoints(one, other, 0.0)
        return max((-point[8] for point in near if not moved or point[3] >= 0), default=0.0)


def scene_frames(
    description: Description, world_frame: str
) -> tuple[list[str], list[str], NDArray[np.float64]]:
    """Return the frames of a scene's fixed links, below ``world_frame``.

    Returns:
        The parent of each frame, the frames, and their (N, 7) poses in their parents: x y z in m,
        and a quaternion x y z w.
    """
    joints = JointArrays([joint for joint in description.joints if joint.kind == "fixed"])
    parents, children, values = list(joints.parents), list(joints.children), joints.constant
    if description.root_link != world_frame:
        parents.append(world_frame)
        children.append(description.root_link)
        values = np.vstack([values, np.hstack(PlanarPose().transform)])
    return parents, children, values
