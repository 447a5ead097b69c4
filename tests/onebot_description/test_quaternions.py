"""Rotations and homogeneous transforms as arrays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from onebot_description.geometry import matrices, quaternions
from onebot_description.geometry.poses import ZERO, Origin, of_arrays


def test_batches_turn_as_in_scipy():
    """By the formulas of ``poses``, whose tests have signs and conventions."""
    random = np.random.default_rng(1)
    a, b = random.normal(size=(2, 5, 4))
    product = Rotation.from_quat(a) * Rotation.from_quat(b)
    found = quaternions.normalized(quaternions.multiply(a, b))
    np.testing.assert_allclose(quaternions.to_matrix(3.0 * found), product.as_matrix(), atol=1e-12)
    vector = random.normal(size=3)
    np.testing.assert_allclose(quaternions.rotate(found, vector), product.apply(vector), atol=1e-12)
    rpy = random.uniform(-3.2, 3.2, (5, 3))
    turns = Rotation.from_euler("xyz", rpy)
    assert ((Rotation.from_quat(quaternions.from_rpy(rpy)) * turns.inv()).magnitude() < 1e-9).all()
    back = quaternions.from_matrix(turns[0].as_matrix())
    assert (Rotation.from_quat(back) * turns[0].inv()).magnitude() < 1e-6


def test_a_quaternion_of_no_length_is_no_rotation():
    with np.errstate(all="raise"):
        unit = quaternions.normalized(np.zeros((2, 4)))
    np.testing.assert_array_equal(unit, [[0, 0, 0, 1]] * 2)
    np.testing.assert_array_equal(quaternions.to_matrix(np.zeros(4)), np.eye(3))
    batch = np.array([[0, 0, 0, 1e-9], [0, 0, 0.2, 0.2]])
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(quaternions.to_matrix(batch), [np.eye(3), quarter], atol=1e-12)


def test_matrices_of_poses():
    generator = np.random.default_rng(2)
    poses = generator.normal(size=(2, 3, 7))
    expected = matrices.of_poses(poses)
    assert expected.shape == (2, 3, 4, 4) and (expected[..., 3, :] == (0, 0, 0, 1)).all()
    turns = Rotation.from_quat(poses[0, :, 3:]).as_matrix()
    np.testing.assert_allclose(expected[0, :, :3, :3], turns, atol=1e-12)
    np.testing.assert_array_equal(expected[..., :3, 3], poses[..., :3])
    found = matrices.of_transform(of_arrays(*np.split(poses[1, 2], [3])))
    np.testing.assert_allclose(found, expected[1, 2], atol=1e-15)
    np.testing.assert_array_equal(matrices.of_transform((ZERO, (0.0, 0.0, 0.0, 0.0))), np.eye(4))


def test_points_are_those_of_the_parent():
    matrix = matrices.of_origin(Origin((1.0, 2.0, 3.0), (0.0, 0.0, np.pi / 2)))
    found = matrices.transformed(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]), matrix)
    np.testing.assert_allclose(found, [[1.0, 3.0, 3.0], [0.0, 2.0, 3.5]], atol=1e-15)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -0.2, 1.0), (0.7, np.pi / 2, 0.0)])
def test_origins(rpy):
    """At a pitch of a quarter turn, an origin has no yaw."""
    origin = Origin((1.0, 2.0, 3.0), rpy)
    matrix = matrices.of_origin(origin)
    turn = Rotation.from_euler("xyz", rpy).as_matrix()
    np.testing.assert_allclose(matrix[:3, :3], turn, atol=1e-12)
    back = matrices.to_origin(matrix)
    assert back.xyz == origin.xyz and back.rpy == pytest.approx(rpy)
