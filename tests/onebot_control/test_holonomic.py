"""Mecanum and omni kinematics agree with the equations of the standard controllers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.drive.holonomic import HolonomicKinematics
from onebot_description.geometry.poses import PlanarPose

EXACT = 1e-12

speeds = st.floats(-3.0, 3.0)
lengths = st.floats(0.03, 1.5)
twists = st.tuples(speeds, speeds, speeds)
angles = st.floats(-math.pi, math.pi)


@given(twists, st.floats(0.03, 0.4), lengths, st.tuples(*[st.integers(1, 3)] * 4))
def test_mecanum_equations(twist, radius, reach, counts) -> None:
    """As in mecanum_drive_controller: front left, front right, rear right, rear left."""
    x, y, turn = twist
    fl, fr, rr, rl = (
        (x - y - reach * turn) / radius,
        (x + y + reach * turn) / radius,
        (x - y + reach * turn) / radius,
        (x + y - reach * turn) / radius,
    )
    kinematics = HolonomicKinematics.mecanum(radius, reach, counts)
    wheels = kinematics.command(twist).wheels
    expected = np.repeat([fl, fr, rr, rl], counts)
    assert wheels == pytest.approx(expected, abs=EXACT, rel=EXACT)
    assert kinematics.body_motion(wheels) == pytest.approx(twist, abs=EXACT * 100)


@given(st.tuples(*[speeds] * 4), st.floats(0.03, 0.4), lengths)
def test_mecanum_odometry(wheels, radius, reach) -> None:
    """Wheels that slipped move the body as their means say."""
    fl, fr, rr, rl = wheels
    motion = HolonomicKinematics.mecanum(radius, reach).body_motion(wheels)
    expected = (
        radius / 4.0 * (fl + rl + rr + fr),
        radius / 4.0 * (-fl + rl - rr + fr),
        radius / (4.0 * reach) * (-fl - rl + rr + fr),
    )
    assert motion == pytest.approx(expected, abs=EXACT, rel=EXACT)


@given(twists, st.tuples(speeds, speeds, angles))
def test_mecanum_base_offset(twist, offset) -> None:
    """As base_frame_offset: the twist of the base is turned and moved to the wheels' middle."""
    x, y, turn = twist
    across, ahead, theta = offset[1], offset[0], offset[2]
    center = (
        math.cos(theta) * x - math.sin(theta) * y + across * turn,
        math.sin(theta) * x + math.cos(theta) * y - ahead * turn,
        turn,
    )
    plain = HolonomicKinematics.mecanum(0.1, 0.5)
    moved = HolonomicKinematics.mecanum(0.1, 0.5, offset=PlanarPose(*offset))
    wheels = moved.command(twist).wheels
    assert wheels == pytest.approx(plain.command(center).wheels, abs=1e-10)
    vx, vy, _ = plain.body_motion(wheels)
    px, py = (
        -math.cos(theta) * ahead - math.sin(theta) * across,
        math.sin(theta) * ahead - math.cos(theta) * across,
    )
    base = (
        math.cos(theta) * vx + math.sin(theta) * vy + py * turn,
        -math.sin(theta) * vx + math.cos(theta) * vy - px * turn,
        turn,
    )
    assert moved.body_motion(wheels) == pytest.approx(base, abs=1e-10)


@given(twists, st.floats(0.03, 0.4), lengths, st.integers(3, 8), angles)
def test_omni_equations(twist, radius, robot_radius, count, offset) -> None:
    """As in omni_wheel_drive_controller, whose odometry uses the pseudo-inverse."""
    x, y, turn = twist
    directions = [offset + 2.0 * math.pi * wheel / count for wheel in range(count)]
    expected = [
        (math.sin(angle) * x - math.cos(angle) * y - robot_radius * turn) / radius
        for angle in directions
    ]
    kinematics = HolonomicKinematics.omni(radius, robot_radius, count, offset)
    wheels = kinematics.command(twist).wheels
    assert wheels == pytest.approx(expected, abs=EXACT, rel=EXACT)
    slipped = np.array(wheels) + np.cos(np.arange(count))
    rows = [[math.sin(a), -math.cos(a), -robot_radius] for a in directions]
    best = radius * np.linalg.pinv(rows) @ slipped
    assert kinematics.body_motion(slipped) == pytest.approx(best, abs=EXACT * 100)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: HolonomicKinematics.mecanum(0.0, 0.5), "radius must be at least 1e-06 m, not 0 m"),
        (lambda: HolonomicKinematics.omni(0.1, 0.0, 3), "must point in different directions"),
        (lambda: HolonomicKinematics.omni(0.1, 0.2, 2), "it needs three wheels or more"),
    ],
)
def test_what_is_no_drive_is_refused(make, fault) -> None:
    with pytest.raises(ValueError, match=fault):
        make()
