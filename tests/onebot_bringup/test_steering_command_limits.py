"""The limits of commands, of what controllers and operators say: no ROS, network or clock."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.steering.command_limits import (
    DEFAULT,
    UNKNOWN,
    braking_of,
    limits_of,
)
from onebot_bringup.steering.protocol import SetLimits, Velocity
from onebot_control.drive.controller_limits import NAMES, ControllerLimits
from onebot_control.drive.speed_limiter import SpeedLimits

FAST = ControllerLimits("/fast", SpeedLimits(max_velocity=3.0), SpeedLimits(max_velocity=6.0))
SLOW = ControllerLimits(
    "/slow",
    SpeedLimits(max_velocity=0.5, min_velocity=-0.25, max_acceleration=1.0),
    SpeedLimits(max_velocity=8.0),
)


def _in_force(limits, *chosen):
    return replace(limits, chosen=SetLimits(*chosen)).in_force


def test_without_any_limit_there_is_one_nevertheless():
    """It begins low; an operator can choose more, but not anything."""
    limits = limits_of([])
    assert limits.in_force == DEFAULT._replace(lateral=0.0)
    assert limits.linear.source == limits.angular.source == ""
    assert _in_force(limits, 1.5, 3.0) == Velocity(1.5, 3.0)
    assert _in_force(limits, 1e9, 10251000000100.0) == UNKNOWN._replace(lateral=0.0)
    assert limits_of([ControllerLimits("/mute")]) == limits
    sliding = limits_of([ControllerLimits("/mute", lateral=SpeedLimits())])
    assert sliding.in_force == DEFAULT
    assert _in_force(sliding, 1e9, 1e9, 1e9) == UNKNOWN


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
    still = ControllerLimits("/rails", SpeedLimits(max_velocity=1.0), SpeedLimits(max_velocity=0.0))
    limits = limits_of([still])
    assert limits.in_force == Velocity(1.0, 0.0)
    assert limits.range.clamp(Velocity(0.5, 0.0)) == Velocity(0.5, 0.0)
    assert limits.range.clamp(Velocity(0.0, 1.0)) == Velocity(0.0, 0.0)


def test_a_controller_is_known_by_its_parameters():
    """A limit of velocity makes one; what cannot be a limit is none."""
    assert {"linear.y.max_velocity", "angular.z.min_jerk", "wheel_names", "wheelbase"} < NAMES
    values = {"linear.x.max_velocity": 0.5, "angular.z.max_velocity": math.inf}
    found = ControllerLimits.from_parameters("/robot", values)
    assert found is not None and found.linear.max_velocity == 0.5
    assert math.isnan(found.angular.max_velocity)
    assert found.lateral is None and found.minimum_radius == 0.0
    for values in ({}, {"linear.x.max_jerk": 1.0}, {"angular.z.max_velocity": math.inf}):
        assert ControllerLimits.from_parameters("/onlooker", values) is None


@pytest.mark.parametrize(
    ("values", "most", "reverse"),
    [
        ({"linear.y.max_velocity": 0.25}, 0.25, 0.25),
        ({"linear.y.max_velocity": 0.25, "linear.y.min_velocity": -0.125}, 0.25, 0.125),
        ({"linear.y.max_velocity": math.nan}, DEFAULT.lateral, DEFAULT.lateral),  # no limit
        ({"linear.y.max_velocity": 0.0}, 0.0, 0.0),  # it cannot, after all
        ({"robot_radius": 0.2, "wheel_names": ["a", "b", "c"]}, DEFAULT.lateral, DEFAULT.lateral),
        ({"robot_radius": 0.2}, 0.0, 0.0),  # a costmap's
        ({"linear.x.max_velocity": 1.0}, 0.0, 0.0),
    ],
)
def test_a_drive_that_goes_sideways_is_known_by_its_parameters(values, most, reverse):
    """The mecanum drive's limits, also unset, or the omni drive's lengths."""
    found = ControllerLimits.from_parameters("/robot", {"angular.z.max_velocity": 1.0, **values})
    allowed = limits_of([found]).range
    assert allowed.forward.lateral == most
    assert allowed.clamp(Velocity(0.0, 0.0, -9.0)) == Velocity(0.0, 0.0, -reverse)


def test_the_pages_own_linear_limit_holds_sideways_too():
    """Whoever lowers it for safety need not know the drive."""
    fixed = Velocity(0.3, 0.0, 0.3)
    wide = ControllerLimits("/wide", lateral=SpeedLimits(max_velocity=0.5))
    limits = limits_of([wide, FAST], fixed)
    assert limits.in_force == Velocity(0.3, 6.0, 0.3) and limits.lateral.source == "max_linear"
    assert limits_of([FAST], fixed).in_force == Velocity(0.3, 6.0, 0.0)
    slow = ControllerLimits("/slow", lateral=SpeedLimits(max_velocity=0.125))
    assert limits_of([wide, slow], fixed).lateral.source == "/slow"


CAR = {"wheelbase": 0.5, "steering_joints_names": ["right", "left"]}


@pytest.mark.parametrize(
    ("values", "radius"),
    [
        ({**CAR, "minimum_turning_radius": 0.47}, 0.47),
        ({**CAR, "wheelbase": 0.0, "minimum_turning_radius": 2.0}, 2.0),  # read from the URDF
        (CAR, 0.5 / math.tan(0.5)),
        ({**CAR, "minimum_turning_radius": math.nan}, 0.5 / math.tan(0.5)),
        ({"wheelbase": 1.0, "steering_joint_name": "fork"}, 1.0 / math.tan(0.5)),
        ({"wheelbase": 0.5, "minimum_turning_radius": 0.47}, 0.0),  # a planner's
        ({**CAR, "linear.y.max_velocity": 1.0}, 0.0),  # each wheel steers
    ],
)
def test_a_drive_that_steers_has_a_minimum_radius(values, radius):
    """It is known by that alone: the standard controllers of cars have no limits."""
    found = ControllerLimits.from_parameters("/car", values)
    assert (found.minimum_radius if found else 0.0) == pytest.approx(radius)


_speeds = st.floats(-1e300, 1e300)


@given(_speeds, _speeds, st.floats(0.01, 10.0))
def test_no_curve_is_tighter_than_the_minimum_radius(linear, angular, radius):
    """A wider one stays as it is; standing still, nothing turns."""
    allowed = limits_of([ControllerLimits("/car", minimum_radius=radius), FAST]).range
    clamped = allowed.clamp(Velocity(linear, angular))
    assert abs(clamped.angular) * radius <= abs(clamped.linear) * (1.0 + 1e-12)
    assert clamped.angular * angular >= 0.0 and clamped.linear * linear >= 0.0
    if abs(angular) * radius <= abs(linear):
        assert clamped == allowed._replace(minimum_radius=0.0).clamp(Velocity(linear, angular))
    assert allowed.within(allowed._replace(minimum_radius=11.0)).minimum_radius == 11.0


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
    found = braking_of([SpeedLimits(**given)])
    assert found == {"deceleration": deceleration, "jerk": jerk}


def test_of_several_controllers_the_one_that_brakes_last_counts():
    """No controller that has the axis, no braking."""
    assert braking_of([]) is braking_of([None]) is None
    assert braking_of([FAST.linear, None, SLOW.linear]) == {
        "deceleration": 1.0,
        "jerk": None,
    }
