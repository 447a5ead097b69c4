"""Loads robots and scenes into PyBullet worlds."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from onebot_control.physics.engine import FARTHEST, Bullet, captured, engine, log, scratch_file
from onebot_control.physics.friction import set_contact, soften
from onebot_control.physics.physics_urdf import HUB, SkidAxle, physics_urdf, rigid_bodies
from onebot_control.physics.roller_wheels import RollerAxle
from onebot_description.elements.meshes import read_mesh
from onebot_description.elements.urdf import Description, Link, Mesh, Mimic
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import (
    PlanarPose,
    Transform,
    Triple,
    compose,
    inverse,
    total,
)
from onebot_description.model.rigid_bodies import Body

# Gears: fraction of the error that is corrected in a step, and the maximum force, N or Nm.
_GEAR_CORRECTION, _GEAR_FORCE = 0.5, 1000.0
_HOLDING = 1e6  # N, maximum force that holds the hub of a skidding wheel on its axle
_DETERMINATE = 3  # maximum number of wheels with determinate loads; more are simulated as springs


class RobotSpawn(NamedTuple):
    """A robot to add to a world."""

    description: Description
    driven: Sequence[str]  # joints with a motor that follows velocities; see ``RobotBody``
    start: PlanarPose = PlanarPose()  # start pose of the root link's frame
    name: str = ""  # name in error messages
    commanded: Sequence[str] = ()  # joints with a motor that follows positions
    steering: Sequence[str] = ()  # the commanded joints that steer wheels
    gears: Mapping[str, Mimic] = MappingProxyType({})  # gears of joints that follow commanded ones
    starts: Mapping[str, float] = MappingProxyType({})  # start positions of joints; others are at 0
    fixed_base: bool = False  # whether the root link is fixed
    links: tuple[Link, ...] = ()  # the original links, if some have other shapes when simulated
    held: Mapping[str, float] = MappingProxyType({})  # positions of the joints made fixed
    wheel_mimics: Mapping[str, Mimic] = MappingProxyType({})  # joints made fixed that mimic wheels

    @property
    def converges_slowly(self) -> bool:
        """Whether the solver needs many iterations: for an arm with a fixed base, or a linkage.

        In a linkage, such as fingers, several rotating joints are geared to one.
        """
        kinds = {joint.name: joint.kind for joint in self.description.joints}
        gears = self.gears.items()
        leaders = [mimic.joint for name, mimic in gears if kinds[name] != "prismatic"]
        has_linkage = len(leaders) > len({*leaders})
        return has_linkage or bool(self.fixed_base and self.commanded)


def checked_place(x: float, y: float, yaw: float) -> PlanarPose:
    """Check the place of a robot, m and rad, and return it as floats.

    Raises:
        OneBotError: a value is not finite, or the pose is too far from the origin to be exact.
    """
    if not (math.isfinite(yaw) and abs(x) <= FARTHEST and abs(y) <= FARTHEST):
        raise OneBotError(
            f"x {x:g} m, y {y:g} m, yaw {yaw:g} rad must be finite; the simulation is exact up to "
            f"{FARTHEST:g} m from the origin"
        )
    return PlanarPose(float(x), float(y), float(yaw))


class LoadedBody(NamedTuple):
    """A robot, or a box of a scene, with PyBullet's indices of its parts."""

    bullet: Bullet  # its world
    body: int
    joints: Mapping[str, int]  # moving joints by name, in the description's order
    links: Mapping[str, int]  # the first links of rigid bodies; -1: the root's
    hubs: Sequence[int]  # joints on which the hubs of skidding wheels and of rollers slide
    # PyBullet's base frame: center of mass and principal axes of the root body, in the root link's
    # frame.
    mass_frame: Transform
    link_frame: Transform  # the root link's frame in ``mass_frame``
    # Bodies with parts without gravity: index, point of the lifting force, m, and the force, N.
    weightless: Sequence[tuple[int, Triple, float]] = ()
    rollers: Sequence[int] = ()  # the hubs on which wheels with rollers slide freely

    def pose(self) -> Transform:
        """Return the pose of the root link's frame in the world: m, and quaternion x y z w."""
        mass_pose = Transform(*self.bullet.getBasePositionAndOrientation(self.body))
        position, (x, y, z, w) = compose(mass_pose, self.link_frame)
        # Of the two quaternions of the rotation, return the one with w >= 0.
        return Transform(position, (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w))

    def link_pose(self, index: int) -> Transform:
        """Return the pose in the world of the first link of a rigid body; -1: the root's."""
        if index < 0:
            return self.pose()
        state = self.bullet.getLinkState(self.body, index, computeForwardKinematics=True)
        return Transform(state[4], state[5])

    def apply_force(self, index: int, point: Triple, force: Triple) -> None:
        """Apply a force during the next physics step.

        Args:
            index: PyBullet's index of the rigid body; -1: the root.
            point: point of the force in the frame of the body's first link, m.
            force: force in the world's axes, N.
        """
        at = self.link_pose(index).at(point)
        self.bullet.applyExternalForce(self.body, index, force, at, engine.WORLD_FRAME)

    def lift_weightless(self) -> None:
        """Cancel gravity for the parts without gravity, during the next physics step."""
        for index, point, force in self.weightless:
            self.apply_force(index, point, (0.0, 0.0, force))

    def center_rollers(self) -> None:
        """Move wheels with rollers back to the center of their axles, keeping their velocities."""
        states = self.bullet.getJointStates(self.body, self.rollers)
        self.bullet.resetJointStatesMultiDof(
            self.body,
            self.rollers,
            [(0.0,)] * len(states),
            [(velocity,) for _, velocity, *_ in states],
        )

    def place(self, pose: Transform, positions: Iterable[float] | None = None) -> None:
        """Set the pose of the root link's frame, at rest, and ``positions`` of all joints."""
        mass_pose = compose(pose, self.mass_frame)
        body, bullet = self.body, self.bullet
        bullet.resetBasePositionAndOrientation(body, *mass_pose)
        bullet.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))
        for index in self.hubs:
            bullet.resetJointState(body, index, 0.0, 0.0)
        if positions is not None:
            for index, position in zip(self.joints.values(), positions, strict=True):
                bullet.resetJointState(body, index, position, 0.0)


def load_robot(bullet: Bullet, spawn: RobotSpawn) -> LoadedBody:
    """Load a robot into a world, with its root link's frame at the origin.

    Motors hold their joints until they get a velocity. PyBullet's output is logged.

    Args:
        bullet: the world.
        spawn: the robot; its pose is not used.

    Raises:
        OneBotError: the robot cannot be simulated.
    """
    description, motors = spawn.description, {*spawn.driven, *spawn.commanded}
    grasping = {*spawn.commanded, *spawn.gears}
    bodies = rigid_bodies(description)
    if not (spawn.fixed_base or any(body.collisions for body in bodies.values())):
        raise OneBotError(
            f'{description.source}: "{description.root_link}" would fall through the ground: no '
            "link has a <collision>"
        )
    robot = _load(bullet, description, bodies, fixed_base=spawn.fixed_base)
    moving = description.moving_joints
    root, *moved = bodies.values()
    indices, hubs, rollers = {}, [], []
    for index in range(bullet.getNumJoints(robot)):
        info = bullet.getJointInfo(robot, index)
        name = info[1].decode()
        if name.startswith(HUB):
            hubs.append(index)
            slides = isinstance(moving[int(name.removeprefix(HUB))], RollerAxle)
            if slides:
                rollers.append(index)
            bullet.setJointMotorControl2(
                robot, index, engine.POSITION_CONTROL, force=0.0 if slides else _HOLDING
            )
            continue
        number = int(name)
        joint = moving[number]
        indices[number] = index
        # Without a motor, friction is a motor with target velocity 0 and the friction's torque.
        torque = joint.effort if joint.name in motors else info[7]
        bullet.setJointMotorControl2(robot, index, engine.VELOCITY_CONTROL, force=torque)
        grasps = joint.name in grasping
        set_contact(bullet, robot, index, moved[number], grasps=grasps)
    set_contact(bullet, robot, -1, root)
    joints = {joint.name: indices[number] for number, joint in enumerate(moving)}
    for name, mimic in spawn.gears.items():
        _add_gear(bullet, robot, joints[name], joints[mimic.joint], mimic)
    skidding = [joints[joint.name] for joint in moving if isinstance(joint, SkidAxle)]
    if len(skidding) > _DETERMINATE:
        soften(bullet, robot, skidding, total(body.mass for body in bodies.values()))
    for damping in ("linearDamping", "angularDamping"):
        # One key per call: with either of these PyBullet ignores the link index.
        bullet.changeDynamics(robot, -1, **{damping: 0.0})
    dynamics = bullet.getDynamicsInfo(robot, -1)
    mass_frame = Transform(dynamics[3], dynamics[4])
    weightless = [
        (index, tuple((moment / mass).tolist()), mass * bullet.settings.gravity)
        for index, body in [(-1, root), *zip(joints.values(), moved, strict=True)]
        for mass, moment in [body.weightless]
        if mass > 0.0
    ]
    return LoadedBody(
        bullet=bullet,
        body=robot,
        joints=joints,
        links={description.root_link: -1, **{j.child: joints[j.name] for j in moving}},
        hubs=hubs,
        mass_frame=mass_frame,
        link_frame=inverse(mass_frame),
        weightless=weightless,
        rollers=rollers,
    )


def _add_gear(bullet: Bullet, robot: int, joint: int, leader: int, mimic: Mimic) -> None:
    """Make a joint mimic another one, as with gear wheels."""
    constraint = bullet.createConstraint(
        robot,
        leader,
        robot,
        joint,
        engine.JOINT_GEAR,
        jointAxis=(0, 1, 0),
        parentFramePosition=(0, 0, 0),
        childFramePosition=(0, 0, 0),
    )
    bullet.changeConstraint(
        constraint,
        gearRatio=-1.0 / mimic.multiplier,
        relativePositionTarget=-mimic.offset / mimic.multiplier,
        erp=_GEAR_CORRECTION,
        maxForce=_GEAR_FORCE,
    )


def load_fixed(bullet: Bullet, description: Description, body: Body) -> int:
    """Load a fixed body of a scene, with its frame at the origin; return PyBullet's index."""
    index = _load(bullet, description, {body.link: body}, fixed=True)
    set_contact(bullet, index, -1, body)
    return index


def _load(
    bullet: Bullet,
    description: Description,
    bodies: Mapping[str, Body],
    *,
    fixed: bool = False,
    fixed_base: bool = False,
) -> int:
    flags = engine.URDF_USE_INERTIA_FROM_FILE | engine.URDF_USE_IMPLICIT_CYLINDER
    with (
        converted_meshes(bodies.values(), convex=not fixed) as meshes,
        scratch_file() as (file, path),
    ):
        urdf = physics_urdf(description, bodies, meshes, fixed=fixed, fixed_base=fixed_base)
        file.write(urdf.encode())
        file.flush()
        try:
            with captured() as lines:
                body: int = bullet.loadURDF(path, useFixedBase=fixed or fixed_base, flags=flags)
        except engine.error:
            reason = "; ".join(lines) or "no reason given"
            raise OneBotError(
                f"{description.source}: PyBullet cannot load this: {reason}"
            ) from None
    log(lines)
    return body


@contextmanager
def converted_meshes(bodies: Iterable[Body], *, convex: bool = True) -> Iterator[Mapping[str, str]]:
    """Convert the collision meshes of bodies to temporary files that PyBullet can load.

    Args:
        bodies: the bodies with the meshes.
        convex: write the convex hulls, for moving bodies.

    Yields:
        The path of each file, by the mesh's URI.

    Raises:
        OneBotError: a mesh cannot be read.
    """
    meshes = {
        shape.uri: (shape, link)
        for body in bodies
        for shape, _, link in body.collisions
        if isinstance(shape, Mesh)
    }
    if not meshes:
        yield {}
        return
    # Imported late, like trimesh below: most robots have no collision meshes.
    from tempfile import TemporaryDirectory

    written: dict[str, str] = {}
    with TemporaryDirectory() as folder:
        for uri, (mesh, link) in meshes.items():
            file = Path(folder) / f"{len(written)}.obj"
            try:
                file.write_text(_as_obj(mesh, convex), encoding="utf-8")
            except OneBotError as error:
                raise OneBotError(
                    f'{link.where}: link "{link.name}": collision mesh {error}'
                ) from None
            written[uri] = str(file)
        yield written


def _as_obj(mesh: Mesh, convex: bool) -> str:
    """Return a mesh, or its convex hull, in meters, as text of a Wavefront OBJ file."""
    corners, faces = read_mesh(mesh)
    if convex and len(np.unique(corners, axis=0)) > 3:  # fewer points have no hull
        # PyBullet uses the hull anyway, but may take minutes to compute it.
        from trimesh.convex import convex_hull

        hull = convex_hull(corners, repair=False)
        corners, faces = hull.vertices, hull.faces
    lines = ["v " + " ".join(map(repr, corner)) for corner in corners.tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (faces + 1).tolist()]
    return "\n".join(lines) + "\n"
