"""The pose in which a robot rests on level ground, found by letting it come to rest there."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from onebot_control.poses import (
    Quaternion,
    Transform,
    Triple,
    about_z,
    compose,
    multiply,
    yaw_of,
)
from onebot_control.simulation.engine import engine, logger
from onebot_control.simulation.loading import LoadedRobot
from onebot_control.simulation.settings import Settings
from onebot_description.description import Description
from onebot_description.errors import OneBotError

# The robot counts as resting below this speed, m/s and rad/s.
_STILL = 1e-3
# One that stands firmly, and is slower than this for so many seconds, has come to rest.
_RESTING = 1e-6
_LONG_ENOUGH = 0.05
_NARROWEST = 1e-3  # m, what a robot stands on
_STEEPEST = math.radians(45.0)


class RestPose(NamedTuple):
    """How the robot stands when its heading is 0."""

    height: float  # of the root link's frame above the ground, m
    tilt: Quaternion  # rotation of that frame, x y z w, without any yaw

    def at(self, x: float, y: float, yaw: float) -> Transform:
        """Pose of the root link's frame of a robot that stands at x, y (m), yaw (rad)."""
        return (x, y, self.height), multiply(about_z(yaw), self.tilt)


def link_pose(client: int, robot: LoadedRobot) -> Transform:
    """Pose of the root link's frame in the world: position in m, quaternion x y z w."""
    mass_pose = engine.getBasePositionAndOrientation(robot.body, client)
    position, (x, y, z, w) = compose(mass_pose, robot.link_frame)
    # Of the two quaternions of a rotation always the same one.
    return position, (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)


def place(client: int, robot: LoadedRobot, pose: Transform) -> None:
    """Put the root link's frame at a pose, without speed; joints stay as they are."""
    mass_pose = compose(pose, robot.mass_frame)
    engine.resetBasePositionAndOrientation(robot.body, *mass_pose, physicsClientId=client)
    engine.resetBaseVelocity(robot.body, (0, 0, 0), (0, 0, 0), physicsClientId=client)


def settle(
    client: int,
    robot: LoadedRobot,
    description: Description,
    driven: Sequence[str],
    settings: Settings,
) -> RestPose:
    """Let the robot come to rest on its wheels at the origin, joints at 0.

    The motors must hold already. Afterwards the robot stands there with all joints at exactly 0.

    Raises:
        OneBotError: it does not stay on the ground or upright.
    """
    near = engine.getClosestPoints(robot.body, robot.ground, 1e3, physicsClientId=client)
    lowest = min(point[8] for point in near)
    place(client, robot, ((0.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))
    _come_to_rest(client, robot, settings)
    position, rotation = link_pose(client, robot)
    touching = engine.getContactPoints(robot.body, robot.ground, physicsClientId=client)
    _check_standing(description, position, rotation, bool(touching))
    linear, angular = engine.getBaseVelocity(robot.body, physicsClientId=client)
    if max(map(abs, (*linear, *angular))) > _STILL:
        logger.warning(
            "%s: the robot has not come to rest %g s after it was set down",
            description.source,
            settings.settling,
        )
    links = {point[3] for point in touching}
    for name in driven:
        if robot.joints[name] not in links:
            logger.warning(
                '%s: what joint "%s" drives does not touch the ground', description.source, name
            )
    for index in robot.joints.values():
        engine.resetJointState(robot.body, index, 0.0, 0.0, physicsClientId=client)
    rest_pose = RestPose(position[2], multiply(about_z(-yaw_of(*rotation)), rotation))
    place(client, robot, rest_pose.at(0.0, 0.0, 0.0))
    return rest_pose


def _come_to_rest(client: int, robot: LoadedRobot, settings: Settings) -> None:
    """Let time pass until the robot rests for good, ``settings.settling`` seconds at most."""
    needed, still = math.ceil(_LONG_ENOUGH * settings.rate), 0
    for _ in range(round(settings.settling * settings.rate)):
        engine.stepSimulation(client)
        still = still + 1 if _fastest(client, robot) < _RESTING else 0
        if still >= needed:
            if _stands_firmly(client, robot):
                return
            still = 0


def _fastest(client: int, robot: LoadedRobot) -> float:
    """The greatest speed of the base and of the joints, m/s or rad/s."""
    linear, angular = engine.getBaseVelocity(robot.body, client)
    joints = engine.getJointStates(robot.body, list(robot.joints.values()), client)
    speeds: list[float] = [*linear, *angular, *(state[1] for state in joints)]
    return max(map(abs, speeds))


def _stands_firmly(client: int, robot: LoadedRobot) -> bool:
    """Whether its weight lies on an area, not on a point or a line on which it is but balanced.

    The middle of the forces is the centre of mass where nothing moves, and their least deviation
    from it, sideways in whatever direction, is how far it is from the area's edge.
    """
    touching = engine.getContactPoints(robot.body, robot.ground, physicsClientId=client)
    forces: list[Triple] = [(point[9], *point[6][:2]) for point in touching]
    total = sum(force for force, _, _ in forces)
    if not total > 0.0:
        return False
    a = sum(force * x for force, x, _ in forces) / total
    b = sum(force * y for force, _, y in forces) / total
    xx = sum(force * (x - a) ** 2 for force, x, _ in forces) / total
    yy = sum(force * (y - b) ** 2 for force, _, y in forces) / total
    xy = sum(force * (x - a) * (y - b) for force, x, y in forces) / total
    return (xx + yy) / 2.0 - math.hypot((xx - yy) / 2.0, xy) > _NARROWEST**2


def _check_standing(
    description: Description, position: Triple, rotation: Quaternion, touching: bool
) -> None:
    source = description.source
    if not math.isfinite(sum(position) + sum(rotation)):
        raise OneBotError(
            f"{source}: the simulation broke down while the robot was set on the ground; "
            "look for masses and inertias that differ by many powers of ten"
        )
    if not touching:
        raise OneBotError(
            f"{source}: the robot does not stay on the ground (its root link is at z = "
            f"{position[2]:.3g} m); look at its <collision> shapes and masses"
        )
    x, y = rotation[:2]
    if 1 - 2 * (x * x + y * y) < math.cos(_STEEPEST):
        raise OneBotError(
            f"{source}: the robot topples over when it is set on the ground; it needs a "
            "<collision> on each side of its centre of mass, such as a caster"
        )
