"""Where a robot starts among what stands still in a scene: on a ramp, say, but not in a wall."""

import math

from onebot_control.poses import Transform
from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import LoadedRobot, load_robot, make_world
from onebot_control.simulation.rest_pose import (
    RestPose,
    come_to_rest,
    is_upright,
    link_pose,
    place,
)
from onebot_control.simulation.robot import RobotBody
from onebot_control.simulation.scene import SceneBodies
from onebot_control.simulation.settings import RobotSpawn, Settings, SpawnPose
from onebot_description.description import Description
from onebot_description.errors import OneBotError, listing

_STEP, _FINE = 0.01, 1e-4  # m, of the search for the height above what is there
_ABOVE = 1e-3  # m, from where the robot is let go
_RESTING = 0.02  # m/s and rad/s; casters may still be swivelling downhill
_AWAY = 0.1  # m that a robot may slide before it rests


def pose_on(
    scene: Description, spawn: RobotSpawn, settings: Settings, rest: RestPose, where: SpawnPose
) -> Transform:
    """Return the pose of a robot's root link at rest on what stands still there.

    The robot is held level above it, let go, and has to come to rest there on its wheels.

    Args:
        scene: what stands around.
        spawn: the robot.
        settings: of the simulation.
        rest: of the robot on level ground.
        where: x, y and yaw.

    Raises:
        OneBotError: it cannot stand there.
    """
    client: int = engine.connect(engine.DIRECT)
    try:
        ground = make_world(client, settings)
        bodies = SceneBodies(scene)
        bodies.enter(client, ground, settings, free=False)
        robot = RobotBody(spawn.description, spawn.driven)
        parts = load_robot(client, ground, spawn.description, settings)
        robot.enter(client, parts)
        links = _lift(client, bodies, parts, rest.at(*where))
        come_to_rest(client, parts, settings)
        pose = link_pose(client, parts)
        if not _stands(client, robot, pose, where):
            raise OneBotError(_inside(scene, links, where))
        return pose
    finally:
        engine.disconnect(client)


def _lift(client: int, scene: SceneBodies, robot: LoadedRobot, pose: Transform) -> list[str]:
    """Lift the robot from ``pose`` until it is free; return the links that it was in."""
    (x, y, z), rotation = pose

    def links_at(height: float) -> dict[int, str]:
        place(client, robot, ((x, y, z + height), rotation))
        return scene.fixed_at(robot)

    low = high = 0.0
    met: list[str] = []
    while found := links_at(high):
        met += [link for link in found.values() if link not in met]
        low, high = high, high + _STEP
    while high - low > _FINE:
        middle = (low + high) / 2.0
        low, high = (middle, high) if links_at(middle) else (low, middle)
    links_at(high + _ABOVE)
    return met


def _stands(client: int, robot: RobotBody, pose: Transform, where: SpawnPose) -> bool:
    """Whether the robot rests upright on its wheels, where it was let go."""
    (x, y, _), rotation = pose
    linear, angular = engine.getBaseVelocity(robot.parts.body, client)
    touching = engine.getContactPoints(robot.parts.body, physicsClientId=client)
    links = {point[3] for point in touching}
    return (
        math.hypot(x - where[0], y - where[1]) <= _AWAY
        and max(map(abs, (*linear, *angular))) <= _RESTING
        and is_upright(rotation)
        and all(robot.parts.joints[name] in links for name in robot.driven)
    )


def _inside(scene: Description, links: list[str], where: SpawnPose) -> str:
    x, y, yaw = where
    return (
        f"x {x:g} m, y {y:g} m, yaw {yaw:g} rad: a robot cannot stand there, inside or on link "
        f"{listing(links)} of {scene.source}; put it somewhere else"
    )
