"""The limits of commands, of what controllers and operators say: no ROS, network or clock."""

import math
from dataclasses import replace

import pytest

from onebot_bringup.steering.command_limits import (
    DEFAULT,
    NAMES,
    UNKNOWN,
    Braking,
    Controller,
    braking_of,
    limits_of,
)
from onebot_bringup.steering.protocol import SetLimits, Velocity
from onebot_control.drive.speed_limiter import SpeedLimits

FAST = Controller("/fast", SpeedLimits(max_velocity=3.0), SpeedLimits(max_velocity=6.0))
SLOW = Controller(
    "/slow",
    SpeedLimits(max_velocity=0.5, min_velocity=-0.25, max_acceleration=1.0),
    SpeedLimits(max_velocity=8.0),
)


def _in_force(limits, linear=None, angular=None):
    return replace(limits, chosen=SetLimits(linear, angular)).in_force


def test_without_any_limit_there_is_one_nevertheless():
    """It begins low; an operator can choose more, but not anything."""
    limits = limits_of([])
    assert limits.in_force == DEFAULT
    assert limits.linear.source == limits.angular.source == ""
    assert _in_force(limits, 1.5, 3.0) == Velocity(1.5, 3.0)
    assert _in_force(limits, 1e9, 10251000000100.0) == UNKNOWN
    assert limits_of([Controller("/mute")]) == limits


def test_the_strictest_limit_of_each_axis_counts():
    """Also beside the page's parameters, and with the reverse limit of another controller."""
    limits = limits_of([FAST, SLOW], Velocity(0.75, 2.0))
    assert limits.in_force == Velocity(0.5, 2.0)
    assert (limits.linear.source, limits.angular.source) == ("/slow", "max_angular")
    assert limits.range.clamp(Velocity(-9.0, 0.0)) == Velocity(-0.25, 0.0)
    limits = limits_of([FAST, SLOW])
    assert limits.in_force == Velocity(0.5, 6.0) and limits.angular.source == "/fast"
    assert limits_of([], Velocity(9.0, 0.0)).in_force == Velocity(9.0, DEFAULT.angular)


def test_a_chosen_limit_is_lower_or_does_nothing():
    """Backward, too."""
    limits = limits_of([SLOW])
    assert _in_force(limits, 0.125, 9.0) == Velocity(0.125, 8.0)
    chosen = replace(limits, chosen=SetLimits(0.125, None))
    assert chosen.range.clamp(Velocity(-1.0, 0.0)) == Velocity(-0.125, 0.0)


def test_a_limit_of_zero_is_one():
    """A controller that cannot turn is not commanded to."""
    still = Controller("/rails", SpeedLimits(max_velocity=1.0), SpeedLimits(max_velocity=0.0))
    limits = limits_of([still])
    assert limits.in_force == Velocity(1.0, 0.0)
    assert limits.range.clamp(Velocity(0.5, 0.0)) == Velocity(0.5, 0.0)
    assert limits.range.clamp(Velocity(0.0, 1.0)) == Velocity(0.0, 0.0)


def test_a_controller_is_known_by_its_parameters():
    """A limit of velocity makes one; what cannot be a limit is none."""
    assert {"linear.x.max_velocity", "angular.z.min_jerk"} < NAMES
    found = Controller.from_parameters(
        "/robot",
        {
            "linear.x.max_velocity": 0.5,
            "linear.x.min_velocity": 0.5,
            "linear.x.max_deceleration": -2.0,
            "angular.z.max_velocity": math.inf,
        },
    )
    assert found is not None and found.linear.max_velocity == 0.5
    assert math.isnan(found.linear.min_velocity) and math.isnan(found.angular.max_velocity)
    assert found.linear.max_deceleration == -2.0


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"linear.x.max_jerk": 1.0},
        {"angular.z.max_velocity": math.inf},
    ],
)
def test_anything_else_is_no_controller(values):
    """Whatever other parameters it has."""
    assert Controller.from_parameters("/onlooker", values) is None


@pytest.mark.parametrize(
    "given, deceleration, jerk",
    [
        ({}, None, None),
        ({"max_deceleration": -0.5}, None, None),  # does nothing without max_acceleration
        ({"max_acceleration": 2.0, "max_deceleration": -0.5}, 0.5, None),
        ({"max_acceleration": 2.0, "max_deceleration_reverse": 0.25}, 0.25, None),
        ({"max_jerk": 4.0, "min_jerk": -3.0}, None, 3.0),
    ],
)
def test_braking_is_as_the_speed_limiter_brakes(given, deceleration, jerk):
    """What is not given follows from the others; the slower direction counts."""
    found = braking_of([Controller("/robot", SpeedLimits(**given))])
    assert found == Braking(deceleration, jerk)


def test_of_several_controllers_the_one_that_brakes_last_counts():
    """No controller, no braking."""
    assert braking_of([]) is None
    assert braking_of([FAST, SLOW]) == Braking(1.0, None)
