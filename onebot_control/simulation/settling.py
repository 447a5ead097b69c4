"""Setting a robot down on the ground so that it stands still there."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from onebot_control.frames import yaw_of
from onebot_control.simulation.engine import engine
from onebot_control.simulation.frames import (
    Quaternion,
    Transform,
    Triple,
    about_z,
    compose,
    inverse,
    multiply,
)
from onebot_control.simulation.loading import Robot
from onebot_control.simulation.output import logger
from onebot_control.simulation.settings import Settings
from onebot_description.description import Description
from onebot_description.errors import OneBotError

# The robot counts as resting below this speed, m/s and rad/s.
_STILL = 1e-3
_STEEPEST = math.radians(45.0)


class Stance(NamedTuple):
    """How the robot stands when its heading is 0.

    Attributes:
        height: of the root link's frame above the ground, m.
        tilt: rotation of that frame, quaternion x y z w, without any yaw.
    """

    height: float
    tilt: Quaternion

    def at(self, x: float, y: float, yaw: float) -> Transform:
        """Pose of the root link's frame of a robot that stands at x, y (m), yaw (rad)."""
        return (x, y, self.height), multiply(about_z(yaw), self.tilt)


def link_pose(client: int, robot: Robot) -> Transform:
    """Pose of the root link's frame in the world: position in m, quaternion x y z w."""
    mass_pose = engine.getBasePositionAndOrientation(robot.body, physicsClientId=client)
    position, (x, y, z, w) = compose(mass_pose, inverse(robot.mass_frame))
    # Of the two quaternions of a rotation always the same one.
    return position, (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)


def place(client: int, robot: Robot, pose: Transform) -> None:
    """Put the root link's frame at a pose, without speed; joints stay as they are."""
    mass_pose = compose(pose, robot.mass_frame)
    engine.resetBasePositionAndOrientation(robot.body, *mass_pose, physicsClientId=client)
    engine.resetBaseVelocity(robot.body, (0, 0, 0), (0, 0, 0), physicsClientId=client)


def settle(
    client: int,
    robot: Robot,
    description: Description,
    driven: Sequence[str],
    settings: Settings,
) -> Stance:
    """Let the robot come to rest on its wheels at the origin, joints at 0.

    The motors must hold already. Afterwards the robot stands there with all joints at exactly 0.

    Raises:
        OneBotError: it does not stay on the ground or upright.
    """
    near = engine.getClosestPoints(robot.body, robot.ground, 1e3, physicsClientId=client)
    lowest = min(point[8] for point in near)
    place(client, robot, ((0.0, 0.0, -lowest), (0.0, 0.0, 0.0, 1.0)))
    for _ in range(round(settings.settling * settings.rate)):
        engine.stepSimulation(physicsClientId=client)
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
    stance = Stance(position[2], multiply(about_z(-yaw_of(*rotation)), rotation))
    place(client, robot, stance.at(0.0, 0.0, 0.0))
    return stance


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
