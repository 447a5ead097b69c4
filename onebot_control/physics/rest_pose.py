"""Finds the pose of a robot at rest, on level ground or in a scene, by simulating it."""

import math
from collections.abc import Sequence
from contextlib import closing
from typing import NamedTuple

from onebot_control.conventions import WORLD_FRAME
from onebot_control.physics.engine import Bullet, PhysicsSettings, logger
from onebot_control.physics.scene import SceneBodies
from onebot_control.physics.spawning import (
    LoadedBody,
    RobotSpawn,
    load_robot,
)
from onebot_description.description import Description
from onebot_description.description.unit_check import LARGEST_ROBOT, MILLIMETERS, unit_of
from onebot_description.errors import OneBotError, listing
from onebot_description.geometry.poses import (
    PlanarPose,
    Quaternion,
    Transform,
    Triple,
    about_z,
    multiply,
    yaw_of,
)

# A robot is at rest once its speed has been below this (m/s and rad/s) for _RESTING_TIME (s).
_RESTING = 1e-6
_RESTING_TIME = 0.05
_MAX_TILT = math.radians(45.0)

_DEEP = 2e-3  # m, allowed overlap of links with the ground, for a fixed base

# In a scene.
_STEP = 1e-3  # m, step of the search for a height without collision
_ABOVE = 1e-3  # m, height of the release above that, as it may be one step too low
_SWIVELLING = 0.02  # m/s and rad/s, allowed speed, for example of casters that still turn downhill
_AWAY = 0.1  # m, allowed sliding distance before the robot rests


class RestPose(NamedTuple):
    """Height and tilt of a robot at rest on level ground."""

    height: float  # height of the root link's frame above the ground, m
    tilt: Quaternion  # rotation of that frame, x y z w, without any yaw

    def at(self, x: float, y: float, yaw: float) -> Transform:
        """Return the pose of the root link's frame for a robot at rest at x, y (m), yaw (rad)."""
        return Transform((x, y, self.height), multiply(about_z(yaw), self.tilt))


def settle(robot: LoadedBody, spawn: RobotSpawn, starts: Sequence[float]) -> RestPose:
    """Let a robot come to rest on its wheels at the origin, and return its pose.

    Afterwards the robot is at rest there, with all joints exactly at ``starts``. A fixed base does
    not settle: it is placed on the ground, or at the origin if its root link is ``world``.

    Args:
        robot: the robot, alone in its world.
        spawn: the loaded robot.
        starts: start positions of all joints, rad or m.

    Raises:
        OneBotError: the robot does not stay on the ground or upright, or is not in meters.
    """
    bullet, description, driven = robot.bullet, spawn.description, spawn.driven
    if any(starts):
        robot.place(robot.pose(), starts)
    if spawn.fixed_base:
        return _standing(robot, description)
    near = bullet.getClosestPoints(robot.body, bullet.ground, 1e9)
    lowest = min(point[8] for point in near)
    _check_size(robot, description, lowest)
    robot.place(Transform((0.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))
    _come_to_rest(robot)
    position, rotation = robot.pose()
    touching = bullet.getContactPoints(robot.body, bullet.ground)
    _check_rest(description, position, rotation, bool(touching))
    links = {point[3] for point in touching}
    for name in driven:
        if robot.joints[name] not in links:
            logger.warning(
                '%s: the link driven by joint "%s" does not touch the ground',
                description.source,
                name,
            )
    rest_pose = RestPose(position[2], multiply(about_z(-yaw_of(*rotation)), rotation))
    robot.place(rest_pose.at(0.0, 0.0, 0.0), starts)
    return rest_pose


def _standing(robot: LoadedBody, description: Description) -> RestPose:
    """Place the robot with its fixed base at rest, and return its pose."""
    bullet, ground = robot.bullet, robot.bullet.ground
    base = bullet.getClosestPoints(robot.body, ground, 1e9, linkIndexA=-1)
    lowest = min((point[8] for point in base), default=0.0)
    _check_size(robot, description, lowest)
    on_ground = description.root_link != WORLD_FRAME  # Gazebo does not lift a world link either
    rest_pose = RestPose(-lowest if on_ground else 0.0, (0.0, 0.0, 0.0, 1.0))
    robot.place(rest_pose.at(0.0, 0.0, 0.0))
    near = bullet.getClosestPoints(robot.body, ground, 0.0)
    depth, index = max(((-p[8], p[3]) for p in near if p[3] >= 0), default=(0.0, -1))
    if depth > _DEEP:
        link = next(name for name, number in robot.links.items() if number == index)
        logger.warning(
            '%s: link "%s" starts %.3g m deep in the ground, which pushes it; give the joints '
            "other initial_positions, or place the root link elsewhere",
            description.source,
            link,
            depth,
        )
    return rest_pose


def _check_size(robot: LoadedBody, description: Description, lowest: float) -> None:
    """Reject a robot that is not in meters; ``lowest`` is the height of its lowest point, m."""
    if abs(lowest) > MILLIMETERS:
        raise OneBotError(
            f"{description.source}: the robot would start at z = {-lowest:.4g} m; is a <collision> "
            "or an <origin> in millimeters? Lengths are in m"
        )
    for link, index in robot.links.items():
        low, high = robot.bullet.getAABB(robot.body, index)
        length = max(end - start for start, end in zip(low, high, strict=True))
        if length > LARGEST_ROBOT:
            text = (
                f'{description.source}: the <collision> of link "{link}" is {length:.4g} m large, '
                f"including links fixed to it; is it in {unit_of(length)}? Lengths are in m"
            )
            if length > MILLIMETERS:
                raise OneBotError(text)
            logger.warning("%s", text)  # a rail, for example


def _come_to_rest(robot: LoadedBody) -> None:
    """Simulate until the robot rests on the ground, for up to ``settings.settling`` seconds."""
    settings = robot.bullet.settings
    needed, rested = math.ceil(_RESTING_TIME * settings.rate), 0
    for _ in range(round(settings.settling * settings.rate)):
        robot.lift_weightless()
        if robot.rollers:
            robot.center_rollers()
        robot.bullet.stepSimulation()
        rested = rested + 1 if _fastest(robot) < _RESTING else 0
        if rested >= needed:
            return


def _base_speed(robot: LoadedBody) -> float:
    """Return the maximum speed of the base, m/s or rad/s."""
    linear, angular = robot.bullet.getBaseVelocity(robot.body)
    speeds: list[float] = [*linear, *angular]
    return max(map(abs, speeds))


def _fastest(robot: LoadedBody) -> float:
    """Return the maximum speed of the base and the joints, m/s or rad/s."""
    joints = robot.bullet.getJointStates(robot.body, list(robot.joints.values()))
    speeds: list[float] = [_base_speed(robot), *(abs(state[1]) for state in joints)]
    return max(speeds)


def _check_rest(
    description: Description, position: Triple, rotation: Quaternion, touching: bool
) -> None:
    source = description.source
    if not touching:
        raise OneBotError(
            f"{source}: the robot does not stay on the ground (its root link is at z = "
            f"{position[2]:.3g} m); check its <collision> shapes and masses"
        )
    if not _is_upright(rotation):
        raise OneBotError(
            f"{source}: the robot topples over when placed on the ground; it needs a "
            "<collision> on each side of its center of mass, such as a caster"
        )


def _is_upright(rotation: Quaternion) -> bool:
    """Return whether a robot with this rotation is upright, within 45 degrees."""
    x, y = rotation[:2]
    return 1 - 2 * (x * x + y * y) >= math.cos(_MAX_TILT)


def pose_on(
    scene: Description,
    spawn: RobotSpawn,
    settings: PhysicsSettings,
    rest: RestPose,
    where: PlanarPose,
    positions: Sequence[float],
) -> Transform:
    """Return the pose of a robot's root link at rest on the fixed bodies of a scene.

    The robot is released level above them, and must come to rest there on its wheels. A fixed base
    stands level on the highest of them. If its root link is ``world``, it is not moved, and only
    its moving links must not overlap them, as they would be thrown.

    Args:
        scene: the scene's description.
        spawn: the robot.
        settings: settings of the physics.
        rest: the robot's pose on level ground.
        where: planar pose of its root link.
        positions: positions of all joints, rad or m.

    Raises:
        OneBotError: the robot cannot stand there.
    """
    pose = rest.at(*where)
    stays = spawn.fixed_base and spawn.description.root_link == WORLD_FRAME
    with closing(Bullet(settings)) as bullet:
        bullet.set_up()
        bodies = SceneBodies(scene)
        bodies.enter(bullet, free=False)
        robot = load_robot(bullet, spawn)
        robot.place(pose, positions)
        links = bodies.moving_links_in(robot) if stays else _lift(bodies, robot, pose)
        if stays:
            stands = not links
        elif spawn.fixed_base:
            stands = _base_touches(robot, bodies)
        else:
            _come_to_rest(robot)
            stands = _stands(robot, spawn.driven, robot.pose(), where)
        if not stands:
            x, y, yaw = where
            remedy = ", or give its joints other initial_positions" if spawn.commanded else ""
            raise OneBotError(
                f"x {x:g} m, y {y:g} m, yaw {yaw:g} rad: a robot cannot stand there, inside or on "
                f"link {listing(links)} of {scene.source}; put it somewhere else{remedy}"
            )
        return pose if stays else robot.pose()


def _lift(scene: SceneBodies, robot: LoadedBody, pose: Transform) -> list[str]:
    """Lift the robot from ``pose`` until it is free; return the links that it overlapped."""
    (x, y, z), rotation = pose
    met: dict[str, None] = {}
    while links := scene.fixed_at(robot):
        met.update(dict.fromkeys(links.values()))
        z += _STEP
        robot.place(Transform((x, y, z), rotation))
    robot.place(Transform((x, y, z + _ABOVE), rotation))
    return list(met)


def _base_touches(robot: LoadedBody, scene: SceneBodies) -> bool:
    """Return whether something is just below a lifted fixed base."""
    return any(
        point[7][2] > 0.0  # the normal, towards the robot
        for body in scene.fixed
        for point in robot.bullet.getClosestPoints(robot.body, body, 2.0 * _ABOVE, linkIndexA=-1)
    )


def _stands(robot: LoadedBody, driven: Sequence[str], pose: Transform, where: PlanarPose) -> bool:
    """Return whether the robot rests upright on its wheels near its release."""
    (x, y, _), rotation = pose
    touching = robot.bullet.getContactPoints(robot.body)
    links = {point[3] for point in touching}
    return (
        math.hypot(x - where.x, y - where.y) <= _AWAY
        and _base_speed(robot) <= _SWIVELLING
        and _is_upright(rotation)
        and all(robot.joints[name] in links for name in driven)
    )
