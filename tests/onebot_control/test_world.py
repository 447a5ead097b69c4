"""Several robots in one world; test_roller_wheels.py drives them beside each other as alone."""

from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.simulation_support import (
    DRIVEN,
    bits,
    robot,
    wheels,
)

STARTS = [(0.0, 0.0, 0.0), (3.0, 0.0, 1.0), (0.0, -4.0, -2.0)]


def _world(starts=STARTS):
    description = robot()
    return World([RobotSpawn(description, DRIVEN, PlanarPose(*start)) for start in starts])


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
