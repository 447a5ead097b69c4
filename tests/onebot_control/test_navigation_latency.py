"""How late a robot follows, measured from its velocities, and where it then is."""

import math
from collections import deque

import numpy as np
import pytest

from onebot_control.navigation.footprint import Vehicle
from onebot_control.navigation.latency import Latency
from onebot_control.navigation.navigator import Navigator
from onebot_description.geometry.poses import PlanarPose, Triple
from tests.onebot_control.test_navigation_map import room_scan

PERIOD = 0.05
SQUARE = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
VEHICLE = Vehicle(SQUARE, 1.0, 0.5, 0.0, 2.0, 2.0, 6.0)


class LateRobot:
    """A robot that reaches the velocities of its commands some periods later."""

    def __init__(self, delay: int) -> None:
        self.pose, self.speed = PlanarPose(), np.zeros(3)
        self._pending = deque([(0.0, 0.0, 0.0)] * delay)

    def drive(self, command: Triple) -> None:
        self._pending.append(command)
        step = np.array((2.0, 2.0, 6.0)) * PERIOD
        last = self.speed
        self.speed = last + np.clip(self._pending.popleft() - last, -step, step)
        for _ in range(20):
            x, y, turn = ((last + self.speed) / 2.0 * PERIOD / 20).tolist()
            self.pose = self.pose.compose(PlanarPose(x, y, turn))


@pytest.mark.parametrize("delay", [0, 1, 3, 6])
def test_the_delay_is_measured_and_what_follows_is_predicted(delay):
    generator = np.random.default_rng(delay)
    robot, latency = LateRobot(delay), Latency(VEHICLE, PERIOD)
    expected: deque[tuple[PlanarPose, Triple]] = deque()
    for step in range(200):
        latency.measure(tuple(robot.speed.tolist()))
        if step > 100:
            assert latency.periods == delay
            expected.append(latency.ahead(robot.pose, tuple(robot.speed.tolist())))
        if len(expected) > delay:
            pose, speed = expected.popleft()
            assert np.allclose(robot.speed, speed, atol=1e-12)
            assert math.hypot(robot.pose.x - pose.x, robot.pose.y - pose.y) < 1e-3
            assert robot.pose.yaw == pytest.approx(pose.yaw, abs=1e-9)
        robot.drive(latency.remember((*generator.uniform(-1.0, 1.0, 2), generator.uniform(-2, 2))))


def test_a_steady_robot_keeps_the_delay_that_was_measured():
    robot, latency = LateRobot(2), Latency(VEHICLE, PERIOD)
    for step in range(200):
        latency.measure(tuple(robot.speed.tolist()))
        robot.drive(latency.remember((0.5 if step > 10 else 0.0, 0.0, 0.0)))
    assert latency.periods == 2


def test_commands_that_take_effect_late_do_not_drive_it_into_a_wall():
    """At 1 m/s towards a wall, 0.25 s are 25 cm."""
    robot, navigator = LateRobot(5), Navigator(VEHICLE, PlanarPose())
    nearest = math.inf
    for cycle in range(120):
        scan = room_scan(robot.pose)
        speed = tuple(robot.speed.tolist())
        command = navigator.update(cycle * PERIOD, robot.pose, speed, scan=scan)
        if cycle == 5:
            navigator.drive_straight(10.0, 1.0)
        robot.drive(command)
        nearest = min(nearest, float(scan.ranges.min()))
    assert navigator.failure is not None
    assert 0.1 < nearest < 0.3
