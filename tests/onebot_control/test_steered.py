"""Bicycle, car and tricycle kinematics agree with the equations of the standard controllers."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from onebot_control.drive.steered import SteeredKinematics
from onebot_control.drive.wheels.steering import SteeredGeometry

EXACT = 1e-12


def kinematics_of(*lengths: float, waits: bool = False, **more: float) -> SteeredKinematics:
    return SteeredKinematics(SteeredGeometry(*lengths, **more), waits=waits)


speeds = st.floats(-3.0, 3.0).filter(lambda speed: abs(speed) > 1e-3)
turns = st.floats(-2.0, 2.0)
bases, radii = st.floats(0.2, 3.0), st.floats(0.03, 0.5)
tracks = st.floats(0.1, 2.0)
positions = st.floats(-0.7, 0.7)


@given(speeds, turns, bases, radii)
def test_bicycle_equations(linear, angular, base, radius) -> None:
    phi = math.atan(angular * base / linear)
    kinematics = kinematics_of(base, radius)
    (wheel,), (steering,) = kinematics.command((linear, 0.0, angular))[3:]
    assert (wheel, steering) == pytest.approx((linear / radius, phi), rel=EXACT, abs=EXACT)
    x, y, turn = kinematics.body_motion([wheel], [steering])
    assert (x, y) == pytest.approx((radius * wheel, 0.0), rel=EXACT, abs=EXACT)
    assert turn == pytest.approx(math.tan(phi) * x / base, rel=EXACT, abs=EXACT)
    assert turn == pytest.approx(angular, abs=1e-9)


@given(speeds, turns, bases, radii, tracks)
def test_tricycle_with_two_driven_wheels(linear, angular, base, radius, track) -> None:
    phi = math.atan(angular * base / linear)
    kinematics = kinematics_of(base, radius, track)
    (right, left), (steering,) = kinematics.command((linear, 0.0, angular))[3:]
    speed = linear / radius
    if abs(math.tan(phi)) > 1e-9:
        curve = base / math.tan(phi)
        expected = speed * (curve + track / 2.0) / curve, speed * (curve - track / 2.0) / curve
    else:
        expected = speed, speed
    assert (right, left) == pytest.approx(expected, rel=EXACT, abs=1e-8)
    assert steering == pytest.approx(phi, rel=EXACT, abs=EXACT)


@given(speeds, turns, bases, radii, tracks, tracks)
def test_ackermann_equations(linear, angular, base, radius, track, front) -> None:
    phi = math.atan(angular * base / linear)
    kinematics = kinematics_of(base, radius, track, front)
    (right, left), (right_angle, left_angle) = kinematics.command((linear, 0.0, angular))[3:]
    sin, cos = math.sin(phi), math.cos(phi)
    expected = (
        math.atan2(2.0 * base * sin, 2.0 * base * cos + front * sin),
        math.atan2(2.0 * base * sin, 2.0 * base * cos - front * sin),
    )
    assert (right_angle, left_angle) == pytest.approx(expected, rel=EXACT, abs=EXACT)
    assume(abs(base / math.tan(phi)) > max(track, front) if sin else True)
    x, y, turn = kinematics.body_motion([right, left], [right_angle, left_angle])
    assert (x, y, turn) == pytest.approx((linear, 0.0, angular), abs=1e-9)


@given(st.tuples(speeds, speeds), st.tuples(positions, positions), tracks, tracks)
def test_ackermann_odometry(wheels, steering, track, front) -> None:
    """Of wheels that slipped, and steering that has play, the means count."""
    base, radius = 3.0, 0.1
    (right_speed, left_speed), (right, left) = wheels, steering
    phi = (
        math.atan(base * math.tan(right) / (base - front / 2.0 * math.tan(right)))
        + math.atan(base * math.tan(left) / (base + front / 2.0 * math.tan(left)))
    ) / 2.0
    assume(abs(math.tan(phi)) > 1e-6)
    curve = base / math.tan(phi)
    speed = (
        right_speed * radius * curve / (curve + track / 2.0)
        + left_speed * radius * curve / (curve - track / 2.0)
    ) / 2.0
    kinematics = kinematics_of(base, radius, track, front)
    x, y, turn = kinematics.body_motion(wheels, steering)
    expected = speed, 0.0, math.tan(phi) * speed / base
    assert (x, y, turn) == pytest.approx(expected, rel=EXACT, abs=EXACT)


@given(speeds, turns, bases, radii)
def test_tricycle_controller_equations(linear, angular, base, radius) -> None:
    """The steered wheel is driven."""
    alpha = math.atan(angular * base / linear)
    kinematics = kinematics_of(base, radius, front_driven=True)
    (wheel,), (steering,) = kinematics.command((linear, 0.0, angular))[3:]
    speed = linear / (radius * math.cos(alpha))
    assert (wheel, steering) == pytest.approx((speed, alpha), rel=EXACT, abs=EXACT)
    rim = wheel * radius
    expected = rim * math.cos(alpha), 0.0, rim * math.sin(alpha) / base
    motion = kinematics.body_motion([wheel], [steering])
    assert motion == pytest.approx(expected, rel=EXACT, abs=EXACT)
    assert motion == pytest.approx((linear, 0.0, angular), abs=1e-9)


@pytest.mark.parametrize("angular", [1.0, -0.5])
def test_only_a_driven_front_wheel_turns_on_the_spot(angular: float) -> None:
    tricycle = kinematics_of(0.5, 0.1, front_driven=True)
    assert tricycle.body_motion(*tricycle.command((0.0, 0.0, angular))[3:]) == pytest.approx(
        (0.0, 0.0, angular), abs=1e-12
    )
    for other in (
        kinematics_of(0.5, 0.1, front_driven=True, limit=1.0),
        kinematics_of(0.5, 0.1, 0.3, 0.3, limit=0.6),
        kinematics_of(0.5, 0.1),
    ):
        wheels, (*steering,) = other.command((0.0, 0.0, angular))[3:]
        assert max(map(abs, wheels)) < 1e-12
        assert other.middle_angle(steering) == pytest.approx(math.copysign(other.limit, angular))


@given(speeds, turns)
def test_curves_are_no_narrower_than_the_limit(linear: float, angular: float) -> None:
    car = kinematics_of(0.3, 0.05, 0.2, 0.2, limit=0.5)
    least = 0.3 / math.tan(0.5)
    assert SteeredGeometry(0.3, 0.05, 0.2, 0.2, 0.5).minimum_radius == pytest.approx(least)
    x, _, turn = car.body_motion(*car.command((linear, 0.0, angular))[3:])
    most = abs(linear) / least
    assert (x, turn) == pytest.approx((linear, max(-most, min(most, angular))), abs=1e-9)


def test_wheels_wait_for_the_steering() -> None:
    """As reduce_wheel_speed_until_steering_reached: from 30 degrees on, by the cosine."""
    car = kinematics_of(0.3, 0.05, waits=True)
    full = 1.0 / 0.05
    for off, share in ((0.0, 1.0), (0.5, 1.0), (1.0, math.cos(1.0) / math.cos(math.pi / 6.0))):
        (wheel,), _ = car.command((1.0, 0.0, 0.0), [off])[3:]
        assert wheel == pytest.approx(full * share, rel=EXACT)
    (wheel,), _ = car.command((1.0, 0.0, 0.0), [-2.0])[3:]
    assert wheel == pytest.approx(full * math.cos(1.5608) / math.cos(math.pi / 6.0), rel=EXACT)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ((0.0, 0.1), "wheelbase must be at least 1e-06 m, not 0 m"),
        ((0.5, math.inf), "radius must be"),
        ((0.5, 0.1, 0.3, 0.0, 0.5, True), "only a single wheel can be both steered and driven"),
    ],
)
def test_what_is_no_drive_is_refused(arguments, fault) -> None:
    with pytest.raises(ValueError, match=fault):
        kinematics_of(*arguments)
