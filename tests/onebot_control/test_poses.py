"""Frame names and planar poses."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.poses import PlanarPose, prefixed, yaw_of


@pytest.mark.parametrize(
    ("enabled", "prefix", "namespace", "expected"),
    [
        (False, "test_prefix", "/test_namespace", "odom"),
        (True, "test_prefix", "/", "test_prefix/odom"),
        (True, "", "/", "odom"),
        (True, "", "/test_namespace", "test_namespace/odom"),
        (True, "/test_prefix/", "/", "test_prefix/odom"),
        (True, "/", "/test_namespace", "odom"),
        (True, "", "/a/b", "a/b/odom"),
        (True, "/", "/", "odom"),
        (True, "//a//", "/", "/a//odom"),
    ],
)
def test_prefix(enabled: bool, prefix: str, namespace: str, expected: str) -> None:
    """diff_drive_controller's cases: off, given, or the namespace; slashes made right."""
    assert prefixed("odom", enabled, prefix, namespace) == expected


coordinates = st.floats(-100.0, 100.0)
poses = st.builds(PlanarPose, coordinates, coordinates, st.floats(-3.0, 3.0))


@given(poses, poses)
def test_inverse_undoes(one: PlanarPose, other: PlanarPose) -> None:
    assert one.compose(one.inverse()) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert one.inverse().compose(one.compose(other)) == pytest.approx(tuple(other), abs=1e-9)


def test_then_is_seen_from_the_first_pose() -> None:
    there = PlanarPose(1.0, 2.0, math.pi / 2).compose(PlanarPose(3.0, 1.0, 0.5))
    assert there == pytest.approx((0.0, 5.0, math.pi / 2 + 0.5))
    assert PlanarPose(1.0, 2.0, math.pi / 2).inverse() == pytest.approx((-2.0, 1.0, -math.pi / 2))


@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0))
def test_yaw_of_a_tilted_body(yaw: float, pitch: float, roll: float) -> None:
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(a / 2), math.sin(a / 2)) for a in (yaw, pitch, roll))
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    w = cr * cp * cy + sr * sp * sy
    assert yaw_of(x, y, z, w) == pytest.approx(yaw, abs=1e-9)
    assert yaw_of(-x, -y, -z, -w) == pytest.approx(yaw, abs=1e-9)
