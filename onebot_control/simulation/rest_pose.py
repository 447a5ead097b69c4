"""The pose of a robot at rest on level ground, determined by simulating until it rests."""

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
from onebot_description.description.sizes import LARGEST
from onebot_description.errors import OneBotError

# Faster than this after the settling time, m/s and rad/s: a warning.
_MAX_SPEED = 1e-3
# A stable robot that is slower than this for so many seconds has come to rest.
_RESTING = 1e-6
_RESTING_TIME = 0.05
_MIN_SUPPORT = 1e-3  # m, half width of the area that supports a stable robot
_MAX_TILT = math.radians(45.0)


class RestPose(NamedTuple):
    """Height and tilt of the robot at rest."""

    height: float  # of the root link's frame above the ground, m
    tilt: Quaternion  # rotation of that frame, x y z w, without any yaw

    def at(self, x: float, y: float, yaw: float) -> Transform:
        """Pose of the root link's frame of a robot at rest at x, y (m), yaw (rad)."""
        return (x, y, self.height), multiply(about_z(yaw), self.tilt)


def link_pose(client: int, robot: LoadedRobot) -> Transform:
    """Pose of the root link's frame in the world: position in m, quaternion x y z w."""
    mass_pose = engine.getBasePositionAndOrientation(robot.body, client)
    position, (x, y, z, w) = compose(mass_pose, robot.link_frame)
    # Of the two quaternions of a rotation, the one with w >= 0.
    return position, (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)


def place(client: int, robot: LoadedRobot, pose: Transform) -> None:
    """Set the pose of the root link's frame, with zero velocity; joints are not changed."""
    mass_pose = compose(pose, robot.mass_frame)
    engine.resetBasePositionAndOrientation(robot.body, *mass_pose, physicsClientId=client)
    engine.resetBaseVelocity(robot.body, (0, 0, 0), (0, 0, 0), physicsClientId=client)
    for index in robot.hubs:
        engine.resetJointState(robot.body, index, 0.0, 0.0, physicsClientId=client)


def settle(
    client: int,
    robot: LoadedRobot,
    description: Description,
    driven: Sequence[str],
    settings: Settings,
) -> RestPose:
    """Let the robot come to rest on its wheels at the origin, joints at 0.

    The motors must be set to 0 before. Afterwards the robot is at rest there, all joints exactly 0.

    Raises:
        OneBotError: it does not stay on the ground or upright, or is in another unit than metres.
    """
    near = engine.getClosestPoints(robot.body, robot.ground, 1e9, physicsClientId=client)
    lowest = min(point[8] for point in near)
    _check_size(client, robot, description, lowest)
    place(client, robot, ((0.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))
    come_to_rest(client, robot, settings)
    position, rotation = link_pose(client, robot)
    touching = engine.getContactPoints(robot.body, robot.ground, physicsClientId=client)
    _check_rest(description, position, rotation, bool(touching))
    linear, angular = engine.getBaseVelocity(robot.body, physicsClientId=client)
    if max(map(abs, (*linear, *angular))) > _MAX_SPEED:
        logger.warning(
            "%s: the robot has not come to rest within %g s on the ground",
            description.source,
            settings.settling,
        )
    links = {point[3] for point in touching}
    for name in driven:
        if robot.joints[name] not in links:
            logger.warning(
                '%s: the link driven by joint "%s" does not touch the ground',
                description.source,
                name,
            )
    for index in robot.joints.values():
        engine.resetJointState(robot.body, index, 0.0, 0.0, physicsClientId=client)
    rest_pose = RestPose(position[2], multiply(about_z(-yaw_of(*rotation)), rotation))
    place(client, robot, rest_pose.at(0.0, 0.0, 0.0))
    return rest_pose


def _check_size(client: int, robot: LoadedRobot, description: Description, lowest: float) -> None:
    """Refuse a robot that is in another unit than metres; ``lowest`` is where it ends, m."""
    if abs(lowest) > LARGEST:
        raise OneBotError(
            f"{description.source}: the robot would start at z = {-lowest:.4g} m; is a <collision> "
            "or an <origin> in millimetres? Lengths are in m"
        )
    links = {robot.joints[joint.name]: joint.child for joint in description.moving_joints}
    for index, link in {-1: description.root_link, **links}.items():
        low, high = engine.getAABB(robot.body, index, physicsClientId=client)
        length = max(most - least for least, most in zip(low, high, strict=True))
        if length > LARGEST:
            raise OneBotError(
                f'{description.source}: the <collision> of link "{link}" is {length:.4g} m large, '
                "with what is fixed to it; is it in millimetres? Lengths are in m"
            )


def come_to_rest(client: int, robot: LoadedRobot, settings: Settings) -> None:
    """Simulate until the robot rests on the ground, for ``settings.settling`` seconds at most."""
    needed, still = math.ceil(_RESTING_TIME * settings.rate), 0
    for _ in range(round(settings.settling * settings.rate)):
        engine.stepSimulation(client)
        still = still + 1 if _fastest(client, robot) < _RESTING else 0
        if still >= needed:
            if _is_stable(client, robot):
                return
            still = 0


def _fastest(client: int, robot: LoadedRobot) -> float:
    """The greatest speed of the base and of the joints, m/s or rad/s."""
    linear, angular = engine.getBaseVelocity(robot.body, client)
    joints = engine.getJointStates(robot.body, list(robot.joints.values()), client)
    speeds: list[float] = [*linear, *angular, *(state[1] for state in joints)]
    return max(map(abs, speeds))


def _is_stable(client: int, robot: LoadedRobot) -> bool:
    """Whether an area supports the robot, not a point or a line on which it only balances.

    At rest the mean of the contact forces is below the centre of mass; their least standard
    deviation over all horizontal directions is a measure of the width of the area.
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
    return (xx + yy) / 2.0 - math.hypot((xx - yy) / 2.0, xy) > _MIN_SUPPORT**2


def _check_rest(
    description: Description, position: Triple, rotation: Quaternion, touching: bool
) -> None:
    source = description.source
    if not math.isfinite(sum(position) + sum(rotation)):
        raise OneBotError(
            f"{source}: the simulation diverged while the robot was set on the ground; "
            "check for masses and inertias that differ by many powers of ten"
        )
    if not touching:
        raise OneBotError(
            f"{source}: the robot does not stay on the ground (its root link is at z = "
            f"{position[2]:.3g} m); check its <collision> shapes and masses"
        )
    if not is_upright(rotation):
        raise OneBotError(
            f"{source}: the robot topples over when it is set on the ground; it needs a "
            "<collision> on each side of its centre of mass, such as a caster"
        )


def is_upright(rotation: Quaternion) -> bool:
    """Return whether a robot of this rotation has not toppled over."""
    x, y = rotation[:2]
    return 1 - 2 * (x * x + y * y) >= math.cos(_MAX_TILT)
