"""Differential-drive kinematics."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.odometry import DiffDriveKinematics

speeds = st.floats(-10.0, 10.0)
lengths = st.floats(0.01, 2.0)


def test_wheel_speeds_are_those_of_the_formula() -> None:
    """Each wheel turns with (v -/+ w sep / 2) / r of its own side."""
    kinematics = DiffDriveKinematics(0.4, 0.1, 0.2)
    assert kinematics.wheel_velocities(1.0, 2.0) == pytest.approx((6.0, 7.0))


@given(speeds, speeds, lengths, lengths, lengths)
def test_body_motion_undoes_wheel_velocities(
    linear: float, angular: float, separation: float, left: float, right: float
) -> None:
    """What the wheels do is what was asked for, whatever the geometry."""
    kinematics = DiffDriveKinematics(separation, left, right)
    back = kinematics.body_motion(*kinematics.wheel_velocities(linear, angular))
    assert back == pytest.approx((linear, angular), abs=1e-9 / separation)


def test_body_motion_is_that_of_the_formula() -> None:
    """Half the sum of both ways forward, their difference by the separation to the left."""
    kinematics = DiffDriveKinematics(0.4, 0.1, 0.2)
    assert kinematics.body_motion(6.0, 7.0) == pytest.approx((1.0, 2.0))
    assert kinematics.body_motion(1.0, 0.0) == pytest.approx((0.05, -0.25))


@pytest.mark.parametrize("wrong", [0.0, -0.1, math.nan, math.inf])
@pytest.mark.parametrize("name", ["separation", "left_radius", "right_radius"])
def test_geometry_no_robot_has_is_refused(name: str, wrong: float) -> None:
    """Lengths are above 0 and finite; the error names the one that is not."""
    lengths = {"separation": 0.3, "left_radius": 0.1, "right_radius": 0.1}
    with pytest.raises(ValueError, match=f"{name} must be above 0"):
        DiffDriveKinematics(**{**lengths, name: wrong})
