"""Wheel odometry."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onebot_control.odometry import DiffDriveKinematics, Odometry

KINEMATICS = DiffDriveKinematics(0.3, 0.06, 0.06)
DT = 0.01


def drive(
    linear: float, angular: float, steps: int, start: tuple[float, float] = (0.0, 0.0)
) -> Odometry:
    """Odometry of wheels that begin at ``start`` and turn evenly."""
    odometry = Odometry(KINEMATICS)
    left, right = KINEMATICS.wheel_velocities(linear, angular)
    for step in range(steps + 1):
        t = step * DT
        odometry.update_from_positions(start[0] + left * t, start[1] + right * t, DT)
    return odometry


@given(
    st.floats(-2.0, 2.0),
    st.floats(-3.0, 3.0),
    st.integers(1, 300),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
)
def test_follows_the_closed_form_arc(
    linear: float, angular: float, steps: int, start: tuple[float, float]
) -> None:
    """Even motion ends where the arc's formula says, wherever the wheels stood at the start."""
    assume(angular == 0.0 or abs(angular) > 1e-6)
    odometry = drive(linear, angular, steps, start)
    time = steps * DT
    turn = angular * time
    if angular:
        radius = linear / angular
        expected = (radius * math.sin(turn), radius * (1.0 - math.cos(turn)))
    else:
        expected = (linear * time, 0.0)
    assert (odometry.x, odometry.y) == pytest.approx(expected, abs=1e-8)
    assert odometry.heading == pytest.approx(turn, abs=1e-9)


@given(st.floats(-1e-5, 1e-5), st.floats(0.1, 1.0))
def test_nearly_straight_is_continuous(turn: float, way: float) -> None:
    """Around the change-over from the straight line to the exact arc, nothing jumps."""
    odometry = Odometry(DiffDriveKinematics(1.0, 1.0, 1.0))
    odometry.update_open_loop(way, turn, 1.0)
    assert odometry.x == pytest.approx(way, abs=1e-9)
    assert odometry.y == pytest.approx(way * turn / 2.0, abs=1e-9)


def test_heading_is_not_wrapped() -> None:
    """Ten turns on the spot are 20 pi."""
    odometry = drive(0.0, 2.0 * math.pi, 1000)
    assert odometry.heading == pytest.approx(20.0 * math.pi)


def test_no_jump_from_wheels_that_do_not_stand_at_zero() -> None:
    """The first positions are where it begins, not how far the wheels have come."""
    odometry = Odometry(KINEMATICS)
    odometry.update_from_positions(123.4, -56.7, DT)
    assert (odometry.x, odometry.y, odometry.heading) == (0.0, 0.0, 0.0)
    assert (odometry.linear, odometry.angular) == (0.0, 0.0)


def test_twist_is_the_mean_of_those_there_are() -> None:
    """A window filled in part divides by its own count; a full one drops the oldest."""
    odometry = Odometry(KINEMATICS, window=2)
    positions = [0.0, 0.01, 0.03, 0.09]
    seen = []
    for position in positions:
        odometry.update_from_positions(position, position, 0.1)
        seen.append(odometry.linear)
    assert seen == pytest.approx([0.0, 0.006, 0.009, 0.024])


def test_window_can_change_while_driving() -> None:
    """A shorter window keeps the latest values."""
    odometry = Odometry(KINEMATICS, window=10)
    for position in (0.0, 0.01, 0.03):
        odometry.update_from_positions(position, position, 0.1)
    odometry.set_window(1)
    odometry.update_from_positions(0.07, 0.07, 0.1)
    assert odometry.linear == pytest.approx(0.04 * 0.06 / 0.1)


def test_open_loop_reports_the_command_and_does_not_jump() -> None:
    """The first command moves it by one period only, however late it comes."""
    odometry = Odometry(KINEMATICS)
    odometry.update_open_loop(0.5, 0.0, 0.1)
    assert (odometry.x, odometry.linear) == pytest.approx((0.05, 0.5))


def test_velocities_and_positions_agree() -> None:
    """Both kinds of feedback give the same pose for the same motion."""
    left, right = KINEMATICS.wheel_velocities(0.4, 0.7)
    by_velocity = Odometry(KINEMATICS)
    for _ in range(200):
        by_velocity.update_from_velocities(left, right, DT)
    by_position = drive(0.4, 0.7, 200)
    assert by_velocity.x == pytest.approx(by_position.x, abs=1e-9)
    assert by_velocity.y == pytest.approx(by_position.y, abs=1e-9)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_feedback_that_is_not_finite_does_no_harm(wrong: float) -> None:
    """It is left out, and the way meanwhile is made up for: the pose and twist stay right."""
    odometry = Odometry(KINEMATICS, window=1)
    odometry.update_from_positions(0.0, 0.0, 0.1)
    assert not odometry.update_from_positions(wrong, 0.1, 0.1)
    assert odometry.update_from_positions(0.2, 0.2, 0.1)
    assert odometry.x == pytest.approx(0.012)
    assert odometry.linear == pytest.approx(0.012 / 0.2)
    assert not odometry.update_from_velocities(wrong, 0.1, 0.1)
    assert odometry.x == pytest.approx(0.012)


def test_reset_begins_again_at_zero() -> None:
    """After a reset, with wheels anywhere, pose and twist are zero and stay so at rest."""
    odometry = drive(0.5, 0.5, 100)
    odometry.reset()
    for _ in range(3):
        odometry.update_from_positions(7.0, 8.0, DT)
    pose = (odometry.x, odometry.y, odometry.heading)
    assert (*pose, odometry.linear, odometry.angular) == (0.0,) * 5
