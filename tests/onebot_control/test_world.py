"""Several robots in one world: each as if alone, all at the same time, and in each other's way."""

import numpy as np

from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.simulation_support import (
    DRIVEN,
    bits,
    robot,
    simulate,
    wheels,
)

STARTS = [(0.0, 0.0, 0.0), (3.0, 0.0, 1.0), (0.0, -4.0, -2.0)]


def _world(starts=STARTS):
    description = robot()
    return World([RobotSpawn(description, DRIVEN, PlanarPose(*start)) for start in starts])


def test_each_drives_as_it_would_alone():
    with _world() as world:
        for _ in range(100):
            for number, body in enumerate(world.robots):
                body.turn(wheels(0.2, 0.3 * number))
            world.step(0.01)
        for number, (body, (x, y, yaw)) in enumerate(zip(world.robots, STARTS, strict=True)):
            with simulate(x=x, y=y, yaw=yaw) as alone:
                for _ in range(100):
                    alone.step(wheels(0.2, 0.3 * number), 0.01)
                expected, found = alone.base_pose(), body.state()[1]
                np.testing.assert_allclose(found.translation, expected.translation, atol=1e-4)
                np.testing.assert_allclose(
                    body.positions[:2], alone.joint_states().positions[:2], atol=1e-3
                )


def test_efforts_are_of_the_last_step_whether_or_not_a_speed_is_given_again():
    with _world() as told_once, _world() as told_again:
        for body in told_once.robots:
            body.turn(wheels(0.3, 0.5))
        for _ in range(5):
            told_once.step(0.1)
            for body in told_again.robots:
                body.turn(wheels(0.3, 0.5))
            told_again.step(0.1)
        for once, again in zip(told_once.robots, told_again.robots, strict=True):
            assert bits(once) == bits(again)
