"""Creates PyBullet worlds with level ground, and loads robots into them."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from onebot_control.poses import Transform, inverse
from onebot_control.simulation.bodies import (
    HUB,
    Body,
    SkidAxle,
    physics_urdf,
    rigid_bodies,
)
from onebot_control.simulation.engine import captured, engine, log
from onebot_control.simulation.settings import FARTHEST, Settings
from onebot_control.simulation.shapes import as_obj
from onebot_description.description.description import Description, Link, Mesh
from onebot_description.errors import OneBotError, listing

# The solver ignores contact points of two bodies farther apart than this, m. PyBullet keeps the
# points where a rolling wheel has touched the ground, up to four per wheel, and solves them all:
# at 1 m/s that takes four times as long, for forces of zero.
_TOUCHING = 1e-6

_HOLDING = 1e6  # N, greatest force that holds the hub of a wheel on its axle
# m by which wheels that skid yield to their load. More than three rigid wheels have no definite
# loads, and the friction decides which of them carry the robot.
_SAG = 1e-4
_SLAB = (FARTHEST, FARTHEST, 1.0)  # half the size of the ground's visual, m


class LoadedRobot(NamedTuple):
    """PyBullet's indices of a robot and its parts."""

    body: int
    joints: Mapping[str, int]  # the moving ones, by name
    hubs: Sequence[int]  # the joints on which the hubs of wheels that skid slide
    ground: int
    # Centre of mass and principal axes of the root body in the root link's frame; that frame, not
    # the link's, is PyBullet's base.
    mass_frame: Transform
    link_frame: Transform  # the root link's frame in ``mass_frame``


def make_world(client: int, settings: Settings) -> int:
    """Set up the physics of the empty world ``client``; return the index of its ground."""
    engine.setTimeStep(1.0 / settings.rate, physicsClientId=client)
    engine.setGravity(0.0, 0.0, -settings.gravity, physicsClientId=client)
    engine.setPhysicsEngineParameter(
        numSolverIterations=settings.iterations,
        solverResidualThreshold=0.0,
        # With the cache a changed file would be loaded in its old version.
        enableFileCaching=0,
        physicsClientId=client,
    )
    plane = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=client)
    # Without a visual PyBullet shows a plane, whose texture takes 7 ms and 6 MB.
    slab = engine.createVisualShape(
        engine.GEOM_BOX,
        halfExtents=_SLAB,
        visualFramePosition=(0.0, 0.0, -_SLAB[2]),
        physicsClientId=client,
    )
    ground: int = engine.createMultiBody(0, plane, slab, physicsClientId=client)
    engine.changeDynamics(ground, -1, lateralFriction=settings.friction, physicsClientId=client)
    return ground


def load_robot(
    client: int, ground: int, description: Description, settings: Settings
) -> LoadedRobot:
    """Load a robot into the world ``client``, its root link's frame at the origin.

    PyBullet's output is logged.

    Args:
        client: the world.
        ground: its ground, as ``make_world`` returned it.
        description: of the robot.
        settings: of the world.

    Raises:
        OneBotError: the robot cannot be loaded.
    """
    bodies = rigid_bodies(description)
    if not any(body.collisions for body in bodies.values()):
        raise OneBotError(
            f"{description.source}: no link has a <collision>, so the robot would fall through "
            "the ground; give the wheels one"
        )
    body = _load(client, description, bodies)
    names = [joint.name for joint in description.moving_joints]
    root, *moved = bodies.values()
    joints, hubs = {}, []
    for index in range(engine.getNumJoints(body, physicsClientId=client)):
        info = engine.getJointInfo(body, index, physicsClientId=client)
        if info[1].decode().startswith(HUB):
            hubs.append(index)
            _hold(client, body, index)
            continue
        row = int(info[1])
        joints[names[row]] = index
        # The joint's friction: a motor with target 0 and that torque.
        engine.setJointMotorControl2(
            body, index, engine.VELOCITY_CONTROL, force=info[7], physicsClientId=client
        )
        _set_contact(client, body, index, moved[row], description, settings)
    _set_contact(client, body, -1, root, description, settings)
    skidding = [
        joints[joint.name] for joint in description.moving_joints if isinstance(joint, SkidAxle)
    ]
    _soften(client, body, skidding, sum(each.mass for each in bodies.values()), settings)
    for damping in ("linearDamping", "angularDamping"):
        # One key per call: with either of these PyBullet ignores the link index.
        engine.changeDynamics(body, -1, **{damping: 0.0}, physicsClientId=client)
    dynamics = engine.getDynamicsInfo(body, -1, physicsClientId=client)
    mass_frame = dynamics[3], dynamics[4]
    return LoadedRobot(body, joints, hubs, ground, mass_frame, inverse(mass_frame))


def _soften(client: int, body: int, wheels: Sequence[int], mass: float, settings: Settings) -> None:
    """Let wheels share the weight of ``mass`` as tyres do: by springs, critically damped."""
    for index in wheels:
        share = mass / len(wheels)
        stiffness = share * settings.gravity / _SAG
        engine.changeDynamics(
            body,
            index,
            contactStiffness=stiffness,
            contactDamping=2.0 * math.sqrt(stiffness * share),
            physicsClientId=client,
        )


def _hold(client: int, body: int, index: int) -> None:
    """Hold a joint at 0."""
    engine.setJointMotorControl2(
        body, index, engine.POSITION_CONTROL, 0.0, force=_HOLDING, physicsClientId=client
    )


def load_fixed(client: int, description: Description, body: Body, settings: Settings) -> int:
    """Load a body of a scene that stands still, at the origin; return its index.

    Raises:
        OneBotError: it cannot be loaded.
    """
    index = _load(client, description, {body.link: body}, fixed=True)
    _set_contact(client, index, -1, body, description, settings)
    return index


def _load(
    client: int, description: Description, bodies: Mapping[str, Body], *, fixed: bool = False
) -> int:
    flags = engine.URDF_USE_INERTIA_FROM_FILE | engine.URDF_USE_IMPLICIT_CYLINDER
    with (
        converted_meshes(bodies.values(), convex=not fixed) as meshes,
        _file(physics_urdf(description, bodies, meshes, fixed=fixed)) as path,
    ):
        try:
            with captured() as lines:
                body: int = engine.loadURDF(
                    path, useFixedBase=fixed, flags=flags, physicsClientId=client
                )
        except engine.error:
            reason = "; ".join(lines) or "it gives no reason"
            raise OneBotError(
                f"{description.source}: PyBullet cannot load this: {reason}"
            ) from None
    log(lines)
    return body


@contextmanager
def _file(text: str) -> Iterator[str]:
    """The path of a file in memory with ``text``."""
    with open(os.memfd_create("robot.urdf"), "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        yield f"/proc/self/fd/{file.fileno()}"


def _set_contact(
    client: int, robot: int, index: int, body: Body, description: Description, settings: Settings
) -> None:
    """Set a body's friction, and check that PyBullet has loaded all of its shapes."""
    found = len(engine.getCollisionShapeData(robot, index, physicsClientId=client))
    if found < len(body.collisions):
        raise OneBotError(
            f"{description.source}: PyBullet loaded {found} of the {len(body.collisions)} "
            f'collision shapes of link "{body.link}"; use box, cylinder, sphere or a simpler mesh'
        )
    friction = settings.friction if body.friction is None else body.friction
    engine.changeDynamics(
        robot,
        index,
        lateralFriction=friction,
        contactProcessingThreshold=_TOUCHING,
        physicsClientId=client,
    )


@contextmanager
def converted_meshes(bodies: Iterable[Body], *, convex: bool = True) -> Iterator[Mapping[str, str]]:
    """Convert the collision meshes of ``bodies`` to files that exist within the block.

    Args:
        bodies: have the meshes.
        convex: write their convex hulls, of which moving bodies consist.

    Yields:
        The file of each mesh by URI.

    Raises:
        OneBotError: meshes cannot be read; each is named with its links.
    """
    meshes: dict[str, tuple[Mesh, list[Link]]] = {}
    for body in bodies:
        for mesh, link in body.meshes:
            meshes.setdefault(mesh.uri, (mesh, []))[1].append(link)
    if not meshes:
        yield {}
        return
    # Imported late, like trimesh below: most robots have no collision meshes.
    from tempfile import TemporaryDirectory

    written: dict[str, str] = {}
    failures: dict[str, list[Link]] = {}  # reason to links
    with TemporaryDirectory() as folder:
        for uri, (mesh, links) in meshes.items():
            try:
                text = as_obj(mesh, convex)
            except OneBotError as error:
                failures.setdefault(str(error), []).extend(links)
                continue
            copy = Path(folder) / f"{len(written)}.obj"
            copy.write_text(text, encoding="utf-8")
            written[uri] = str(copy)
        if failures:
            raise OneBotError(
                "\n".join(
                    f"{links[0].where}: link {listing(link.name for link in links)}: "
                    f"collision mesh {reason}"
                    for reason, links in failures.items()
                )
            )
        yield written
