"""Trajectories against scipy's polynomials and joint_trajectory_controller's own numbers."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from onebot_control.trajectories.trajectory import (
    JointMotion,
    Trajectory,
    Waypoint,
    braking,
    integrated,
)

QUARTERS = [0.25 * quarter for quarter in range(9)]  # s
# joint_trajectory_controller's own trajectory.cpp, compiled and sampled from 0.8 rad at rest
# through 1 rad at 1 s to 2 rad at 2 s.
LINEAR = [0.8, 0.85, 0.9, 0.95, 1.0, 1.25, 1.5, 1.75, 2.0]
CUBIC = [0.8, 0.831, 0.9, 0.969, 1.0, 1.156, 1.5, 1.844, 2.0]
QUINTIC = [0.8, 0.821, 0.9, 0.979, 1.0, 1.104, 1.5, 1.896, 2.0]
REST = (0.0,)


def waypoints(count: int, joints: int, fields: int, seed: int) -> list[Waypoint]:
    """Random points with ``fields`` of positions, velocities and accelerations."""
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.1, 1.0, count))
    values = random.normal(size=(count, fields, joints))
    return [
        Waypoint(float(time), *(tuple(map(float, row)) for row in rows))
        for time, rows in zip(times, values, strict=True)
    ]


def through(start: Waypoint, *points: Waypoint) -> list[float]:
    """The positions of the only joint, each quarter of a second."""
    trajectory = Trajectory(start, points)
    return [trajectory.sample(time).positions[0] for time in QUARTERS]


@pytest.mark.parametrize("fields", [1, 2, 3])
def test_splines_are_those_of_scipy(fields: int) -> None:
    """Positions, velocities and accelerations of 100 points and 7 joints, relative to 1 or more."""
    points = waypoints(100, 7, fields, seed=fields)
    trajectory = Trajectory(points[0], points[1:])
    times = [point.time for point in points]
    position = BPoly.from_derivatives(times, np.array([point[1 : 1 + fields] for point in points]))
    derivatives = [position, position.derivative()]
    if fields > 1:
        derivatives.append(position.derivative(2))
    moments = np.random.default_rng(0).uniform(times[0], times[-1], 200)
    expected = [derivative(moments) for derivative in derivatives]
    for index, moment in enumerate(moments):
        motion = trajectory.sample(moment)
        for values, exact in zip(motion, expected, strict=False):
            error = np.abs(np.array(values) - exact[index])
            assert (error < 1e-12 * np.maximum(1.0, np.abs(exact[index]))).all()
        if fields == 1:
            assert motion.accelerations == (0.0,) * 7


@pytest.mark.parametrize(
    ("fields", "expected"), [(1, LINEAR), (2, CUBIC), (3, QUINTIC), ("accelerations", LINEAR)]
)
def test_sampled_values(fields: int | str, expected: Sequence[float]) -> None:
    """Derivatives that the start has not are 0 there.

    With accelerations without velocities, joint_trajectory_controller commands 0 rad at once: here
    they count for nothing.
    """
    rest = {"accelerations": REST} if fields == "accelerations" else {}
    if isinstance(fields, int):
        rest = dict.fromkeys(("velocities", "accelerations")[: fields - 1], REST)
    start = Waypoint(0.0, (0.8,), REST)
    points = Waypoint(1.0, (1.0,), **rest), Waypoint(2.0, (2.0,), **rest)
    assert through(start, *points) == pytest.approx(expected, abs=6e-4)
    assert through(Waypoint(0.0, (0.8,)), *points) == through(start, *points)


def test_a_segment_has_the_degree_that_both_ends_have_fields_for() -> None:
    """The moving start counts only if the point has velocities, too."""
    moving = Waypoint(0.0, (0.0,), (1.0,), (2.0,))
    linear = Trajectory(moving, [Waypoint(2.0, (1.0,))]).sample(0.5)
    assert linear == JointMotion((0.25,), (0.5,), (0.0,))
    cubic = Trajectory(moving, [Waypoint(2.0, (2.0,), (1.0,))]).sample(0.5)
    assert cubic == JointMotion((0.5,), (1.0,), (0.0,))
    quintic = Trajectory(moving, [Waypoint(2.0, (6.0,), (5.0,), (2.0,))]).sample(0.5)
    assert quintic == JointMotion((0.75,), (2.0,), (2.0,))
    points = [Waypoint(0.0, (0.0,), REST), Waypoint(1.0, (1.0,)), Waypoint(2.0, (3.0,), REST)]
    mixed = Trajectory(points[0], points)
    assert [mixed.sample(time).velocities for time in (0.5, 1.5)] == [(1.0,), (2.0,)]


def test_the_ends() -> None:
    """Before the beginning and after the end, the motion is that of the beginning and the end."""
    end = Waypoint(2.0, (3.0,), (0.5,), (-0.25,))
    trajectory = Trajectory(Waypoint(1.0, (1.0,), (2.0,)), [end])
    assert trajectory.end == 2.0
    assert trajectory.sample(-5.0) == trajectory.sample(1.0) == JointMotion((1.0,), (2.0,), (0.0,))
    for time in (2.0, 2.5, 1e6):
        assert trajectory.sample(time) == JointMotion((3.0,), (0.5,), (-0.25,))
    bare = Trajectory(Waypoint(0.0, (1.0,)), [Waypoint(2.0, (3.0,))])
    assert bare.sample(2.0) == JointMotion((3.0,), (0.0,), (0.0,))


def test_velocities_are_integrated() -> None:
    """The values of ros2_controllers' sample_trajectory_velocity_with_interpolation."""
    start = Waypoint(0.0, (0.0,), (0.0,))
    rates = [Waypoint(time, (), (speed,)) for time, speed in ((1.0, 1.0), (2.0, 2.0), (3.0, 1.0))]
    for begin in (start, Waypoint(0.0, (0.0,))):
        trajectory = Trajectory(begin, integrated(begin, rates))
        for time, position, velocity, acceleration in (
            (0.0, 0.0, 0.0, 1.0),
            (1.5, 1.125, 1.5, 1.0),
            (2.0, 2.0, 2.0, -1.0),
            (3.0, 3.5, 1.0, 0.0),
            (9.0, 3.5, 1.0, 0.0),
        ):
            sampled = [values[0] for values in trajectory.sample(time)]
            assert sampled == pytest.approx([position, velocity, acceleration], abs=1e-12)


def test_accelerations_are_integrated() -> None:
    """The values of its sample_trajectory_acceleration_with_interpolation."""
    start = Waypoint(0.0, (0.0,), (0.0,))
    rates = [Waypoint(time, (), (), (a,)) for time, a in ((1.0, 1.0), (2.0, 2.0), (3.0, 1.0))]
    points = integrated(start, rates)
    assert [point.velocities[0] for point in points] == [0.5, 2.0, 3.5]
    assert [point.positions[0] for point in points] == [0.25, 1.5, 4.25]
    motion = Trajectory(start, points).sample(2.0)
    assert [values[0] for values in motion] == pytest.approx([1.5, 2.0, 2.0], abs=1e-12)


def test_a_point_may_follow_one_with_positions_only() -> None:
    """Each segment has the degree that it would have alone; points with positions are reached."""
    start = Waypoint(0.0, (0.0,), (0.0,))
    given = [Waypoint(1.0, (1.0,)), Waypoint(2.0, (), (2.0,)), Waypoint(3.0, (5.0,), (0.0,))]
    points = integrated(start, given)
    trajectory = Trajectory(start, points)
    assert [trajectory.sample(t).velocities[0] for t in (0.5, 1.0, 1.5)] == [1.0, 0.0, 1.0]
    assert [trajectory.sample(t).positions[0] for t in (1.0, 2.0, 3.0)] == [1.0, 2.0, 5.0]
    stepped = Trajectory(start, points, splines=False)
    assert [stepped.sample(t).positions[0] for t in (0.5, 1.0, 1.5, 2.5)] == [0.0, 2.0, 2.0, 5.0]
    assert integrated(start, [given[0], given[2]]) == [given[0], given[2]]


def test_steps_instead_of_splines() -> None:
    """The start is held; then whenever a point is due, the next one is commanded at once."""
    points = [
        Waypoint(1.0, (1.0,), (0.1,)),
        Waypoint(2.0, (2.0,), (0.2,), (0.3,)),
        Waypoint(3.0, (3.0,)),
    ]
    trajectory = Trajectory(Waypoint(0.0, (0.0,)), points, splines=False)
    motions = [trajectory.sample(time) for time in (-1.0, 0.0, 0.9, 1.0, 1.9, 2.0, 2.9, 3.0, 9.0)]
    assert [motion.positions[0] for motion in motions] == [0, 0, 0, 2, 2, 3, 3, 3, 3]
    assert motions[3] == JointMotion((2.0,), (0.2,), (0.3,))
    assert motions[5] == JointMotion((3.0,), (0.0,), (0.0,))
    late = Trajectory(Waypoint(1.5, (0.0,)), points, splines=False)
    assert late.sample(1.5).positions == (2.0,)


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6),
    st.floats(1e-9, 1e4),
)
def test_a_segment_ends_at_its_end(values: Sequence[float], duration: float) -> None:
    """Just before its end, a quintic is where it ends, whatever the numbers."""
    p, q, v, w, a, b = values
    start = Waypoint(0.0, (p,), (v / duration,), (a / duration**2,))
    end = Waypoint(duration, (q,), (w / duration,), (b / duration**2,))
    motion = Trajectory(start, [end]).sample(math.nextafter(duration, 0.0))
    assert motion.positions == pytest.approx((q,), abs=1e-9)
    assert motion.velocities == pytest.approx((w / duration,), abs=1e-8 / duration)
    assert motion.accelerations == pytest.approx((b / duration**2,), abs=1e-7 / duration**2)


def test_braking() -> None:
    """Each joint has its own constant deceleration, and stops v^2 / 2a ahead after v / a."""
    motion = JointMotion((0.0, 1.0, 2.0), (1.0, -2.0, 0.0), ())
    trajectory = braking(motion, [2.0, 1.0, 3.0])
    assert trajectory.end == 2.0
    assert trajectory.sample(0.0).velocities == motion.velocities
    for time in np.linspace(0.0, 1.99, 50):
        first, second = min(time, 0.5), time
        expected = (first - first**2, 1.0 - 2.0 * second + 0.5 * second**2, 2.0)
        sample = trajectory.sample(time)
        assert sample.positions == pytest.approx(expected, abs=1e-15)
        assert sample.velocities == pytest.approx((1.0 - 2.0 * first, second - 2.0, 0.0), abs=1e-14)
        moving = 1.0 if time < 0.5 else 0.0
        assert sample.accelerations == pytest.approx((-2.0 * moving, 1.0, 0.0), abs=1e-13)
    assert trajectory.sample(2.0) == JointMotion((0.25, -1.0, 2.0), (0.0,) * 3, (0.0,) * 3)
