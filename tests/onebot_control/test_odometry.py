"""Wheel odometry, and the kinematics of a differential drive."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from onebot_control.drive.diff_drive import DiffDriveKinematics
from onebot_control.drive.odometry import Odometry
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity

KINEMATICS = DiffDriveKinematics(0.3, 0.06, 0.06)
DT = 0.01


def drive(
    linear: float, angular: float, steps: int, start: tuple[float, float] = (0.0, 0.0)
) -> Odometry:
    """Odometry of wheels that begin at ``start`` and turn evenly."""
    odometry = Odometry(KINEMATICS)
    left, right = KINEMATICS.command(PlanarVelocity(linear, 0.0, angular)).wheels
    for step in range(steps + 1):
        t = step * DT
        odometry.update_from_positions((start[0] + left * t, start[1] + right * t), DT)
    assert not any(odometry.covariance), "of wheels without noise"
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


def state(odometry: Odometry) -> tuple[float, ...]:
    """Pose and twist."""
    o = odometry
    return o.x, o.y, o.heading, o.twist.linear, o.twist.angular


turns = st.one_of(st.floats(-3.0, 3.0), st.floats(-2e-6, 2e-6))


@given(st.floats(-100.0, 100.0), turns, st.floats(-3.0, 3.0))
def test_a_step_does_not_depend_on_where_it_begins(way: float, turn: float, yaw: float) -> None:
    """From any pose it is the same step, straight or along an arc; its chord is the formula's."""
    at_zero, elsewhere = Odometry(KINEMATICS), Odometry(KINEMATICS)
    start = PlanarPose(1.0, -2.0, yaw)
    elsewhere.set_pose(*start)
    for odometry in (at_zero, elsewhere):
        odometry.update_open_loop(PlanarVelocity(way, 0.0, turn), 1.0)
    step = PlanarPose(at_zero.x, at_zero.y, at_zero.heading)
    reached = (elsewhere.x, elsewhere.y, elsewhere.heading)
    assert reached == pytest.approx(tuple(start.compose(step)), abs=1e-7)
    half = turn / 2.0
    chord = way * (math.sin(half) / half if half else 1.0)
    assert step[:2] == pytest.approx((chord * math.cos(half), chord * math.sin(half)), abs=1e-7)
    assert step.yaw == turn


@pytest.mark.parametrize(("size", "expected"), [(1, 10.0), (2, 7.0), (3, 6.0), (9, 5.0)])
def test_a_changed_window_begins_with_the_last_twists(size: int, expected: float) -> None:
    odometry = Odometry(KINEMATICS, window=3)
    for velocity in (100.0, 2.0, 4.0, 4.0):
        odometry.update_from_velocities((velocity, velocity), DT)
    odometry.set_window(size)
    odometry.update_from_velocities((10.0, 10.0), DT)
    assert odometry.twist.linear == pytest.approx(0.06 * expected)


def test_both_twists_are_means_of_the_window() -> None:
    """The turning too, also of a window that was changed, and after the wheels were forgotten."""
    odometry = Odometry(KINEMATICS, window=5)
    odometry.set_window(2)

    def turned() -> list[float]:
        seen, right = [], 0.0
        for step in (0.0, 0.1, 0.3, 0.6):
            right += step
            odometry.update_from_positions((0.0, right), 0.1)
            seen.append((odometry.twist.linear, odometry.twist.angular))
        assert [linear for linear, _ in seen] == pytest.approx([a * 0.15 for _, a in seen])
        return [angular for _, angular in seen]

    unit = KINEMATICS.right_radius / KINEMATICS.separation / 0.1
    expected = [0.0, 0.1 * unit, 0.2 * unit, 0.45 * unit]
    assert turned() == pytest.approx(expected)
    odometry.forget_wheels()
    assert turned() == pytest.approx(expected)


def test_forgotten_wheels_leave_the_pose() -> None:
    """The twist is zero at once; positions anywhere are a new start."""
    odometry = drive(0.5, 0.5, 100)
    pose = state(odometry)[:3]
    odometry.forget_wheels()
    assert state(odometry) == (*pose, 0.0, 0.0)
    odometry.update_from_positions((-70.0, 900.0), 0.1)
    assert state(odometry) == (*pose, 0.0, 0.0)
    odometry.update_from_positions((-69.9, 900.1), 0.1)
    assert odometry.twist.linear == pytest.approx(0.06)
    assert odometry.twist.angular == pytest.approx(0.0, abs=1e-12)


# Covariance ---------------------------------------------------------------------------------

NOISE = (0.02**2, 0.03**2)  # of the left and the right wheels, m^2 a meter
steps = st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=20)


def noisy(noise: tuple[float, float] = NOISE, separation: float = 0.3) -> Odometry:
    """Odometry of noisy wheels."""
    odometry = Odometry(DiffDriveKinematics(separation, 0.06, 0.06))
    odometry.noise = noise
    return odometry


def matrix(odometry: Odometry) -> NDArray[np.float64]:
    """The covariance of x, y and yaw."""
    xx, xy, yy, xt, yt, tt = odometry.covariance
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])


def propagated(before: NDArray[np.float64], start: PlanarPose, end: PlanarPose, left, right):
    """The book's error propagation, of wheels that went ``left`` and ``right`` m."""
    b, (kl, kr) = 0.3, NOISE
    middle, way = (start.yaw + end.yaw) / 2.0, (left + right) / 2.0
    c, s = math.cos(middle), math.sin(middle)
    of_pose = np.array([[1, 0, start.y - end.y], [0, 1, end.x - start.x], [0, 0, 1]])
    of_wheels = np.array(
        [
            [c / 2 + way / (2 * b) * s, c / 2 - way / (2 * b) * s],
            [s / 2 - way / (2 * b) * c, s / 2 + way / (2 * b) * c],
            [-1 / b, 1 / b],
        ]
    )
    noise = np.diag([kl * abs(left), kr * abs(right)])
    return of_pose @ before @ of_pose.T + of_wheels @ noise @ of_wheels.T


@given(steps)
def test_covariance_is_that_of_the_book(ways: list[tuple[float, float]]) -> None:
    odometry, expected, pose = noisy(), np.zeros((3, 3)), PlanarPose()
    for left, right in ways:
        odometry.update_open_loop(
            PlanarVelocity((left + right) / 2.0, 0.0, (right - left) / 0.3), 1.0
        )
        reached = PlanarPose(odometry.x, odometry.y, odometry.heading)
        expected, pose = propagated(expected, pose, reached, left, right), reached
    np.testing.assert_allclose(matrix(odometry), expected, rtol=1e-9, atol=1e-12)


ways = st.floats(-100.0, 100.0) | st.floats(-0.01, 0.01)
noises = st.sampled_from([0.0, 1e-12, 1e-6, 1.0]) | st.floats(0.0, 1.0)


@given(st.lists(st.tuples(ways, ways, st.integers(1, 30)), max_size=10), st.tuples(noises, noises))
def test_covariance_is_one_after_any_way(
    ways: list[tuple[float, float, int]], noise: tuple[float, float]
) -> None:
    """It is positive semi-definite, out and back, of one noisy wheel or of exact ones, too."""
    odometry = noisy(noise)
    for linear, angular, times in ways:
        for _ in range(times):
            odometry.update_open_loop(PlanarVelocity(linear, 0.0, angular), 1.0)
    found = matrix(odometry)
    scale = np.sqrt(np.maximum(np.diag(found), 1e-300))
    assert np.linalg.eigvalsh(found / np.outer(scale, scale)).min() >= -1e-6
    assert any(noise) or not found.any()


def test_a_message_holds_the_covariance() -> None:
    """Rows and columns are x, y, z, roll, pitch and yaw; what stays zero on flat ground is sure."""
    odometry = noisy()
    odometry.update_open_loop(PlanarVelocity(0.5, 0.0, 0.2), 1.0)
    values = np.zeros(36)
    odometry.covariance.fill(values)
    message, planar = values.reshape(6, 6), np.ix_([0, 1, 5], [0, 1, 5])
    assert (message[planar] == matrix(odometry)).all() and message[0, 5] == message[5, 0] != 0.0
    message[planar] = 0.0
    assert (message == np.diag([0.0, 0.0, 1e-6, 1e-6, 1e-6, 0.0])).all()


def test_a_pose_that_is_set_is_exact() -> None:
    """Forgotten wheels change nothing, nor does rest."""
    odometry = noisy()
    odometry.update_open_loop(PlanarVelocity(0.5, 0.0, 0.2), 1.0)
    grown = matrix(odometry)
    odometry.forget_wheels()
    for _ in range(10):
        odometry.update_from_positions((1.0, 2.0), DT)
    assert (matrix(odometry) == grown).all() and grown[0, 0] > 0.0
    odometry.set_pose(1.0, 2.0, 3.0)
    assert not matrix(odometry).any()
    odometry.update_open_loop(PlanarVelocity(0.5, 0.0, 0.2), 1.0)
    assert matrix(odometry)[2, 2] == pytest.approx(grown[2, 2])
    odometry.set_pose(0.0, 0.0, 0.0)
    odometry.forget_wheels()
    assert not matrix(odometry).any()
    assert state(odometry) == (0.0,) * 5
    odometry.update_from_positions((7.0, 8.0), DT)
    assert state(odometry) == (0.0,) * 5


# Kinematics ---------------------------------------------------------------------------------

speeds = st.floats(-10.0, 10.0)
lengths = st.floats(0.01, 2.0)


def test_wheel_speeds_are_those_of_the_formula() -> None:
    """Each wheel turns with (v -/+ w sep / 2) / r of its own side."""
    kinematics = DiffDriveKinematics(0.4, 0.1, 0.2)
    assert kinematics.command(PlanarVelocity(1.0, 0.0, 2.0)).wheels == pytest.approx((6.0, 7.0))


@given(speeds, speeds, lengths, lengths, lengths)
def test_body_motion_undoes_wheel_velocities(
    linear: float, angular: float, separation: float, left: float, right: float
) -> None:
    kinematics = DiffDriveKinematics(separation, left, right)
    command = kinematics.command(PlanarVelocity(linear, 0.0, angular))
    back = kinematics.body_motion(command.wheels)
    assert back == pytest.approx((linear, 0.0, angular), abs=1e-9 / separation)


@pytest.mark.parametrize("wrong", [0.0, -0.1, 1e-7, 1e-320, math.nan, math.inf])
@pytest.mark.parametrize("name", ["separation", "left_radius", "right_radius"])
def test_geometry_no_robot_has_is_refused(name: str, wrong: float) -> None:
    """Lengths are at least 1 um and finite; the error names the one that is not."""
    lengths = {"separation": 0.3, "left_radius": 0.1, "right_radius": 0.1}
    DiffDriveKinematics(**{**lengths, name: 1e-6})
    with pytest.raises(ValueError, match=f"{name} must be at least 1e-06 m, not"):
        DiffDriveKinematics(**{**lengths, name: wrong})
