"""Poses in space and in the plane, as floats."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from onebot_description.geometry.poses import (
    Origin,
    PlanarPose,
    about,
    about_z,
    compose,
    conjugate,
    cross,
    from_rpy,
    inverse,
    multiply,
    rotate,
    rpy_of_rows,
    to_rpy,
    yaw_of,
)

coordinate = st.floats(-10.0, 10.0)
triple = st.tuples(coordinate, coordinate, coordinate)
angle = st.floats(-3.0, 3.0)
rotation = st.tuples(angle, angle, angle).map(
    lambda rpy: tuple(Rotation.from_euler("xyz", rpy).as_quat().tolist())
)
transform = st.tuples(triple, rotation)


def _matrix(value):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = Rotation.from_quat(value[1]).as_matrix(), value[0]
    return result


@given(transform, transform, triple)
def test_transforms_are_those_of_matrices(outer, inner, point):
    a, b = _matrix(outer), _matrix(inner)
    np.testing.assert_allclose(_matrix(compose(outer, inner)), a @ b, atol=1e-9)
    np.testing.assert_allclose(_matrix(inverse(outer)), np.linalg.inv(a), atol=1e-9)
    turn = a[:3, :3]
    np.testing.assert_allclose(rotate(outer[1], point), turn @ point, atol=1e-9)
    np.testing.assert_allclose(rotate(conjugate(outer[1]), point), turn.T @ point, atol=1e-9)


@given(rotation, rotation)
def test_a_product_of_rotations_is_a_unit_quaternion_with_its_sign(first, second):
    """Hamilton's product itself, not only the rotation that it stands for."""
    i, j, k = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)
    assert (multiply(i, j), multiply(j, k), multiply(k, i)) == (k, i, j)
    assert multiply(j, i) == conjugate(k)
    product = multiply(first, second)
    assert math.hypot(*product) == pytest.approx(1.0)
    assert multiply(first, conjugate(first)) == pytest.approx((0, 0, 0, 1), abs=1e-12)


@given(triple, triple)
def test_vector_product(first, second):
    assert cross(first, second) == pytest.approx(tuple(np.cross(first, second)), abs=1e-12)


def test_what_is_not_given_is_no_motion():
    identity = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert Origin().transform == PlanarPose().transform == identity
    assert PlanarPose(1.0, 2.0, 0.5).transform == ((1.0, 2.0, 0.0), about_z(0.5))


@given(angle)
def test_a_rotation_about_the_vertical(yaw):
    expected = (math.cos(yaw), math.sin(yaw), 0.0)
    assert rotate(about_z(yaw), (1.0, 0.0, 0.0)) == pytest.approx(expected, abs=1e-12)


@given(angle, triple)
def test_a_rotation_about_an_axis(turn, direction):
    length = math.hypot(*direction)
    if length > 0.1:
        axis = tuple(value / length for value in direction)
        expected = Rotation.from_rotvec(np.array(axis) * turn)
        assert (Rotation.from_quat(about(axis, turn)) * expected.inv()).magnitude() < 1e-6


@given(st.tuples(angle, st.floats(-1.5, 1.5), angle))
def test_rpy_is_the_urdf_convention(rpy):
    """Roll, pitch, yaw turn about the fixed axes, as scipy's extrinsic xyz."""
    rotation = from_rpy(rpy)
    expected = Rotation.from_euler("xyz", rpy)
    assert (Rotation.from_quat(rotation) * expected.inv()).magnitude() < 1e-6
    assert to_rpy(rotation) == pytest.approx(rpy, abs=1e-9)
    origin = Origin((1.0, 2.0, 3.0), rpy)
    back = Origin.from_transform(origin.transform)
    assert back.xyz == origin.xyz and back.rpy == pytest.approx(rpy, abs=1e-9)


@pytest.mark.parametrize("pitch", [-math.pi / 2, math.pi / 2])
def test_rpy_of_a_quarter_turn(pitch):
    """Up and down, where roll and yaw turn about the same axis: yaw is zero, as in tf2."""
    turn = Rotation.from_euler("xyz", (0.3, pitch, 0.5))
    rows = turn.as_matrix().tolist()
    rpy = rpy_of_rows(rows)
    assert rpy[1:] == pytest.approx((pitch, 0.0))
    assert (Rotation.from_euler("xyz", rpy) * turn.inv()).magnitude() < 1e-6


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
    x, y, z, w = Rotation.from_euler("xyz", (roll, pitch, yaw)).as_quat()
    assert yaw_of(x, y, z, w) == pytest.approx(yaw, abs=1e-9)
    assert yaw_of(-x, -y, -z, -w) == pytest.approx(yaw, abs=1e-9)
