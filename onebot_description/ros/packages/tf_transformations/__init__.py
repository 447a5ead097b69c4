"""Rotations and homogeneous matrices, as in the package tf_transformations.

Quaternions are x, y, z, w. Matrices are (4, 4). Angles are in radians; Euler angles are about the
axes in a name: "sxyz" means the fixed axes x, y, z, "rzyx" the rotating axes z, y, x. Like the
genuine package, it computes with transforms3d, whose quaternions are w, x, y, z; matrices that it
lacks, or that have no rotation by angles or quaternions, come from trimesh, with the same origin.
"""

from typing import Any

import numpy
from numpy.typing import ArrayLike
from transforms3d import affines, euler, quaternions
from transforms3d.euler import _AXES2TUPLE as _AXES2TUPLE
from transforms3d.euler import _TUPLE2AXES as _TUPLE2AXES

from onebot_description.ros.packages.late_attributes import provide

Matrix = Any  # an array of floats
Quaternion = tuple[float, float, float, float]

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = numpy.identity(3)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY


def _of_trimesh(name: str) -> Any:
    from trimesh import transformations  # slow to import

    return getattr(transformations, name)


provide(
    __name__,
    "identity_matrix translation_matrix translation_from_matrix rotation_matrix inverse_matrix "
    "concatenate_matrices random_vector rotation_from_matrix reflection_matrix "
    "reflection_from_matrix scale_matrix scale_from_matrix shear_matrix shear_from_matrix "
    "projection_matrix projection_from_matrix clip_matrix orthogonalization_matrix "
    "is_same_transform quaternion_slerp vector_norm unit_vector".split(),
    _of_trimesh,
)


# --- matrices -------------------------------------------------------------------------------------


def compose_matrix(scale=None, shear=None, angles=None, translate=None, perspective=None) -> Matrix:
    """Return the matrix that scales, shears, rotates about fixed axes and translates.

    As in the genuine package, ``perspective`` is ignored.
    """
    return affines.compose(
        TRANSLATION_IDENTITY if translate is None else translate,
        ROTATION_IDENTITY if angles is None else euler.euler2mat(*angles),
        ZOOM_IDENTITY if scale is None else scale,
        SHEAR_IDENTITY if shear is None else shear,
    )


def decompose_matrix(matrix: ArrayLike) -> tuple[Matrix, Matrix, Any, Matrix, None]:
    """Return scale, shear, angles about fixed axes, translation and None; see compose_matrix."""
    translation, turn, scale, shear = affines.decompose(matrix)
    return scale, shear, euler_from_matrix(turn), translation, None


def superimposition_matrix(v0, v1, scaling=False, usesvd=True) -> Matrix:
    """Return the matrix that best moves points (3 or 4, N) onto others, with or without scaling."""
    return _of_trimesh("superimposition_matrix")(v0, v1, scaling, usesvd)


# --- rotations ------------------------------------------------------------------------------------


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Matrix:
    """Return the matrix of a rotation by three angles."""
    return affines.compose(TRANSLATION_IDENTITY, euler.euler2mat(ai, aj, ak, axes), ZOOM_IDENTITY)


def euler_from_matrix(matrix: ArrayLike, axes: Any = "sxyz") -> Any:
    """Return the three angles of the rotation of a matrix (3, 3) or (4, 4)."""
    return euler.mat2euler(matrix, axes)


def euler_from_quaternion(quaternion: ArrayLike, axes: Any = "sxyz") -> Any:
    """Return the three angles of a quaternion."""
    return euler_from_matrix(quaternion_matrix(quaternion), axes)


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Quaternion:
    """Return the quaternion of a rotation by three angles."""
    return _with_w_last(euler.euler2quat(ai, aj, ak, axes))


def quaternion_about_axis(angle: float, axis: ArrayLike) -> Quaternion:
    """Return the quaternion of a rotation about an axis of any length."""
    return _with_w_last(quaternions.axangle2quat(axis, angle))


def quaternion_matrix(quaternion: ArrayLike) -> Matrix:
    """Return the matrix of a quaternion of any length; the identity for length 0."""
    turn = quaternions.quat2mat(_with_w_first(quaternion))
    return affines.compose(TRANSLATION_IDENTITY, turn, ZOOM_IDENTITY)


def quaternion_from_matrix(matrix: ArrayLike) -> Quaternion:
    """Return the quaternion with w >= 0 of the rotation of a matrix (4, 4)."""
    return _with_w_last(quaternions.mat2quat(affines.decompose(matrix)[1]))


def quaternion_multiply(quaternion1: ArrayLike, quaternion0: ArrayLike) -> Quaternion:
    """Return the product of two quaternions: the rotation ``quaternion0``, then the other."""
    return _with_w_last(quaternions.qmult(*map(_with_w_first, (quaternion1, quaternion0))))


def quaternion_conjugate(quaternion: ArrayLike) -> Matrix:
    """Return the conjugate (4,) of a quaternion."""
    return numpy.asarray(quaternion, float) * (-1.0, -1.0, -1.0, 1.0)


def quaternion_inverse(quaternion: ArrayLike) -> Matrix:
    """Return the inverse (4,) of a quaternion of any length."""
    return quaternion_conjugate(quaternion) / numpy.dot(quaternion, quaternion)


def random_quaternion(rand: ArrayLike | None = None) -> Matrix:
    """Return a random unit quaternion (4,); ``rand`` are three numbers from 0 to 1."""
    numbers = numpy.random.rand(3) if rand is None else numpy.asarray(rand, float)
    return numpy.roll(_of_trimesh("random_quaternion")(numbers), -1)


def random_rotation_matrix(rand: ArrayLike | None = None) -> Matrix:
    """Return the matrix of a random rotation; see ``random_quaternion``."""
    return quaternion_matrix(random_quaternion(rand))


def _with_w_first(quaternion: Any) -> Quaternion:
    x, y, z, w = quaternion
    return w, x, y, z


def _with_w_last(quaternion: Any) -> Quaternion:
    w, x, y, z = quaternion
    return x, y, z, w
