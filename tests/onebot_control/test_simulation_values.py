"""What a simulation is given: transforms, settings, places, and speeds for its motors."""

import math
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.physics.engine import PhysicsSettings
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.spawning import RobotSpawn, checked_place
from onebot_control.physics.world import World
from onebot_description.errors import OneBotError
from tests.onebot_control.simulation_support import DRIVEN, LEFT, RIGHT, robot


@pytest.mark.parametrize(
    ("cycles", "rate", "steps"),
    [
        (0.001, 200, 200_000),
        (2.5, 200, 80),
        (33.3, 233.1, 7),
        (150, 300, 2),
        (250, 250, 1),
        (1000, 1000, 1),
    ],
)
def test_settings_fitted_to_a_control_rate(cycles, rate, steps):
    """The least rate of at least 200 Hz of which a control period has a whole number of steps."""
    fitted = PhysicsSettings(gravity=3.0).fitted(cycles)
    assert fitted == PhysicsSettings(rate=fitted.rate, gravity=3.0)
    assert fitted.rate == pytest.approx(rate)
    assert fitted.steps(1.0 / cycles) == steps


@given(st.floats(0.001, 1000.0))
def test_any_control_rate_has_whole_steps(cycles):
    """Of 1 to 5 ms."""
    fitted = PhysicsSettings().fitted(cycles)
    assert fitted.steps(1.0 / cycles) >= 1
    assert 200.0 <= fitted.rate * (1.0 + 1e-8) and fitted.rate <= 1000.0 * (1.0 + 1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_places_up_to_the_farthest(sign):
    assert checked_place(sign * 1e4, 0, 99) == (sign * 1e4, 0.0, 99.0)
    assert checked_place(0, sign * 1e4, -99) == (0.0, sign * 1e4, -99.0)
    beyond = sign * math.nextafter(1e4, math.inf)
    for place in ((beyond, 0.0, 0.0), (0.0, beyond, 0.0)):
        with pytest.raises(OneBotError, match="exact up to 10000 m from the origin"):
            checked_place(*place)
    with pytest.raises(OneBotError, match="x 20000 m, y -3 m"):
        checked_place(2e4, -3.0, 0.0)
    assert all(type(value) is float for value in checked_place(1, 2, 3))


def motors(description, driven) -> RobotBody:
    """A robot that is in no world."""
    return RobotBody(cast(World, None), RobotSpawn(description, driven))


def test_speeds_are_limited_to_the_joints_own():
    """20 rad/s by the URDF: at the limit as given, beyond it the limit, each with its sign."""
    both = motors(robot(), DRIVEN)
    assert both.targets([20.0, -20.0]) == [20.0, -20.0]
    assert both.targets([20.001, -20.001]) == [20.0, -20.0]
    assert both.targets([-1e300, 19.999]) == [-20.0, 19.999]
    assert both.targets([-19.5, 0.0]) == [-19.5, 0.0]


def test_each_motor_has_its_own_limit():
    description = robot('(left_wheel_joint".*?velocity=)"20"', r'\1"5"', 1)
    assert motors(description, (LEFT, RIGHT)).targets([9.0, 9.0]) == [5.0, 9.0]
    assert motors(description, (RIGHT, LEFT)).targets([9.0, 9.0]) == [9.0, 5.0]


def test_a_velocity_limit_of_zero_keeps_the_joint_still():
    assert motors(robot('velocity="20"', 'velocity="0"'), DRIVEN).targets([1.0, -1.0]) == [0, 0]
