"""Rotations and homogeneous matrices, as in the package tf_transformations.

Quaternions are x, y, z, w. Matrices are (4, 4). Angles are in radians; Euler angles are about the
axes in a name: "sxyz" means the fixed axes x, y, z, "rzyx" the rotating axes z, y, x. Like the
genuine package, it computes most results with transforms3d, whose quaternions are w, x, y, z.
"""

import math
from typing import Any

import numpy
from numpy.typing import ArrayLike
from transforms3d import affines, axangles, euler, quaternions, reflections, shears, zooms
from transforms3d.euler import _AXES2TUPLE as _AXES2TUPLE
from transforms3d.euler import _TUPLE2AXES as _TUPLE2AXES

Matrix = Any  # an array of floats
Quaternion = tuple[float, float, float, float]

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = numpy.identity(3)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY

_EPS = numpy.finfo(float).eps * 4.0
_NEAR = 1e-8  # tolerance of an eigenvalue


def __getattr__(name: str) -> Any:
    if name.lower().startswith("arcball"):
        raise AttributeError(f"tf_transformations of OneBot has no {name}", name=name)
    raise AttributeError(f"module 'tf_transformations' has no attribute '{name}'", name=name)


# --- matrices -------------------------------------------------------------------------------------


def identity_matrix() -> Matrix:
    """Return the identity matrix."""
    return numpy.identity(4)


def translation_matrix(direction: ArrayLike) -> Matrix:
    """Return the matrix of a translation."""
    return affines.compose(direction, ROTATION_IDENTITY, ZOOM_IDENTITY)


def translation_from_matrix(matrix: ArrayLike) -> Matrix:
    """Return the translation (3,) of a matrix."""
    return affines.decompose(matrix)[0]


def rotation_matrix(angle: float, direction: ArrayLike, point: ArrayLike | None = None) -> Matrix:
    """Return the matrix of a rotation about an axis, through a point if given."""
    return axangles.axangle2aff(direction, angle, point=point)


def rotation_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix]:
    """Return angle, axis (3,) and a point on the axis of the rotation of a matrix."""
    direction, angle, point = axangles.aff2axangle(matrix)
    return angle, direction, point


def reflection_matrix(point: Any, normal: ArrayLike) -> Matrix:
    """Return the matrix that reflects in the plane with a point and a normal."""
    return reflections.rfnorm2aff(normal, point[:3])


def reflection_from_matrix(matrix: ArrayLike) -> tuple[Matrix, Matrix]:
    """Return a point and the normal (3,) of the plane in which a matrix reflects."""
    normal, point = reflections.aff2rfnorm(matrix)
    return point, normal


def scale_matrix(
    factor: float, origin: ArrayLike | None = None, direction: ArrayLike | None = None
) -> Matrix:
    """Return the matrix that scales from an origin, in one direction if given."""
    return zooms.zfdir2aff(factor, direction=direction, origin=origin)


def scale_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix | None]:
    """Return factor, origin and direction (3,) of a scaling matrix; None in all directions."""
    factor, direction, origin = zooms.aff2zfdir(matrix)
    return factor, origin, direction


def shear_matrix(angle: float, direction: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Matrix:
    """Return the matrix that shears by an angle along a direction in a plane."""
    return shears.sadn2aff(angle, direction, normal, point)


def shear_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix, Matrix]:
    """Return angle, direction, point and normal of a shear matrix."""
    angle, direction, normal, point = shears.aff2sadn(matrix)
    return angle, direction, point, normal


def compose_matrix(
    scale: Any = None, shear: Any = None, angles: Any = None, translate: Any = None,
    perspective: Any = None,
) -> Matrix:  # fmt: skip
    """Return the matrix that scales, shears, rotates about fixed axes and translates.

    As in the genuine package, ``perspective`` is ignored.
    """
    return affines.compose(
        TRANSLATION_IDENTITY if translate is None else translate,
        ROTATION_IDENTITY if angles is None else euler.euler2mat(*angles),
        ZOOM_IDENTITY if scale is None else scale,
        SHEAR_IDENTITY if shear is None else shear,
    )


def decompose_matrix(
    matrix: ArrayLike,
) -> tuple[Matrix, Matrix, tuple[float, float, float], Matrix, None]:
    """Return scale, shear, angles about fixed axes, translation and None; see compose_matrix."""
    translation, turn, scale, shear = affines.decompose(matrix)
    return scale, shear, euler_from_matrix(turn), translation, None


def projection_matrix(
    point: Any, normal: Any, direction: Any = None, perspective: Any = None, pseudo: bool = False
) -> Matrix:
    """Return the matrix that projects onto a plane, along its normal by default.

    Args:
        point: a point of the plane.
        normal: its normal.
        direction: the direction to project in.
        perspective: the point to project from, instead.
        pseudo: with ``perspective``, whether to preserve relative depth.
    """
    across, place = unit_vector(normal[:3]), numpy.asarray(point, float)[:3]
    along = across if direction is None else numpy.asarray(direction, float)[:3]
    matrix, height = numpy.identity(4), place @ across
    if perspective is None:
        along = along / (along @ across)
        matrix[:3, :3] -= numpy.outer(along, across)
        matrix[:3, 3] = height * along
        return matrix
    eye = numpy.asarray(perspective, float)[:3]
    end = eye + across if pseudo else eye
    matrix[:3, :3] = ROTATION_IDENTITY * ((eye - place) @ across) - numpy.outer(end, across)
    matrix[:3, 3] = height * end
    matrix[3] = [*-across, eye @ across]
    return matrix


def projection_from_matrix(
    matrix: ArrayLike, pseudo: bool = False
) -> tuple[Matrix, Matrix, Matrix | None, Matrix | None, bool]:
    """Return point, normal, direction, perspective and pseudo; see ``projection_matrix``."""
    affine = numpy.asarray(matrix, float)
    if not pseudo and (fixed := _eigenvectors(affine, 1.0)):
        directions, normals = (
            _eigenvectors(part, 0.0) for part in (affine[:3, :3], affine.T[:3, :3])
        )
        if not directions:
            raise ValueError("no eigenvector corresponding to eigenvalue 0")
        return fixed[-1] / fixed[-1][3], normals[0], directions[0], None, False
    values, vectors = numpy.linalg.eig(affine)
    point = numpy.real(vectors[:, abs(numpy.real(values)) > _NEAR][:, -1])
    point, normal = point / point[3], -affine[3, :3]
    perspective = affine[:3, 3] / (point[:3] @ normal) - (normal if pseudo else 0.0)
    return point, normal, None, perspective, pseudo


def clip_matrix(
    left: float, right: float, bottom: float, top: float, near: float, far: float,
    perspective: bool = False,
) -> Matrix:  # fmt: skip
    """Return the matrix that maps a frustum, or a box, to coordinates from -1 to 1."""
    if left >= right or bottom >= top or near >= far:
        raise ValueError("invalid frustrum")
    if perspective and near <= _EPS:
        raise ValueError("invalid frustum: near <= 0")
    low, high = numpy.array([left, bottom, near]), numpy.array([right, top, far])
    size, middle = high - low, (low + high) / (high - low)
    if not perspective:
        return affines.compose(-middle, ROTATION_IDENTITY, 2.0 / size)
    matrix = numpy.zeros((4, 4))
    matrix[[0, 1, 2], [0, 1, 2]] = [*(-2.0 * near / size[:2]), -middle[2]]
    matrix[:2, 2] = middle[:2]
    matrix[2:, 3], matrix[3, 2] = [2.0 * near * far / size[2], 0.0], -1.0
    return matrix


def orthogonalization_matrix(lengths: ArrayLike, angles: ArrayLike) -> Matrix:
    """Return the matrix of the coordinates in a crystal's cell, given lengths and angles, deg."""
    a, b, c = numpy.asarray(lengths, float)
    (cos_a, cos_b, cos_g), (sin_a, sin_b, _) = (
        f(numpy.radians(angles)) for f in (numpy.cos, numpy.sin)
    )
    cosine = (cos_a * cos_b - cos_g) / (sin_a * sin_b)
    matrix = numpy.diag([a * sin_b * math.sqrt(1.0 - cosine**2), b * sin_a, c, 1.0])
    matrix[1, 0], matrix[2, :2] = -a * sin_b * cosine, [a * cos_b, b * cos_a]
    return matrix


def superimposition_matrix(
    v0: ArrayLike, v1: ArrayLike, scaling: bool = False, usesvd: bool = True
) -> Matrix:
    """Return the matrix that best moves points (3 or 4, N) onto others, with or without scaling.

    ``usesvd`` has no effect.
    """
    source, target = (numpy.asarray(points, float)[:3] for points in (v0, v1))
    if source.shape != target.shape or source.shape[1] < 3:
        raise ValueError("Vector sets are of wrong shape or type.")
    start, end = (numpy.mean(points, axis=1) for points in (source, target))
    source, target = source - start[:, None], target - end[:, None]
    left, _, right = numpy.linalg.svd(target @ source.T)
    left[:, 2] *= numpy.sign(numpy.linalg.det(left @ right))
    zoom = math.sqrt(numpy.sum(target**2) / numpy.sum(source**2)) if scaling else 1.0
    turn = left @ right
    return affines.compose(end - zoom * turn @ start, turn, [zoom] * 3)


def inverse_matrix(matrix: ArrayLike) -> Matrix:
    """Return the inverse of a square matrix."""
    return numpy.linalg.inv(numpy.asarray(matrix, float))


def concatenate_matrices(*matrices: ArrayLike) -> Matrix:
    """Return the product of matrices."""
    product = numpy.identity(4)
    for matrix in matrices:
        product = product @ numpy.asarray(matrix)
    return product


def is_same_transform(matrix0: ArrayLike, matrix1: ArrayLike) -> bool:
    """Return whether two matrices are the same transform."""
    first, second = (numpy.array(matrix, float) for matrix in (matrix0, matrix1))
    return bool(numpy.allclose(first / first[3, 3], second / second[3, 3]))


# --- rotations ------------------------------------------------------------------------------------


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Matrix:
    """Return the matrix of a rotation by three angles."""
    return affines.compose(TRANSLATION_IDENTITY, euler.euler2mat(ai, aj, ak, axes), ZOOM_IDENTITY)


def euler_from_matrix(matrix: ArrayLike, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Return the three angles of the rotation of a matrix (3, 3) or (4, 4)."""
    angles: tuple[float, float, float] = euler.mat2euler(matrix, axes)
    return angles


def euler_from_quaternion(quaternion: ArrayLike, axes: Any = "sxyz") -> tuple[float, float, float]:
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


def quaternion_slerp(
    quat0: ArrayLike, quat1: ArrayLike, fraction: float, spin: int = 0, shortestpath: bool = True
) -> Matrix:
    """Return the quaternion (4,) at a fraction of the way from one to another.

    ``spin`` adds that many half turns.
    """
    first, second = unit_vector(quat0), unit_vector(quat1)
    product = float(first @ second)
    if fraction == 1.0:
        return second
    if fraction == 0.0 or abs(abs(product) - 1.0) < _EPS:
        return first
    if shortestpath and product < 0.0:
        product, second = -product, -second
    angle = math.acos(product) + spin * math.pi
    if abs(angle) < _EPS:
        return first
    parts = math.sin((1.0 - fraction) * angle), math.sin(fraction * angle)
    return (parts[0] * first + parts[1] * second) / math.sin(angle)


def random_quaternion(rand: ArrayLike | None = None) -> Matrix:
    """Return a random unit quaternion (4,); ``rand`` are three numbers from 0 to 1."""
    share, one, two = numpy.random.rand(3) if rand is None else numpy.asarray(rand, float)
    angles = 2.0 * math.pi * numpy.array([one, one, two, two])
    parts = [math.sqrt(1.0 - share)] * 2 + [math.sqrt(share)] * 2
    return numpy.where([True, False] * 2, numpy.sin(angles), numpy.cos(angles)) * parts


def random_rotation_matrix(rand: ArrayLike | None = None) -> Matrix:
    """Return the matrix of a random rotation; see ``random_quaternion``."""
    return quaternion_matrix(random_quaternion(rand))


# --- vectors --------------------------------------------------------------------------------------


def vector_norm(data: ArrayLike, axis: int | None = None, out: Any = None) -> Any:
    """Return the length of vectors along an axis, or write it to ``out``."""
    array = numpy.array(data, float)
    if out is None and array.ndim == 1:
        return math.sqrt(array @ array)
    lengths = numpy.atleast_1d(numpy.sqrt(numpy.sum(array * array, axis=axis)))
    if out is None:
        return lengths
    out[...] = lengths
    return None


def unit_vector(data: ArrayLike, axis: int | None = None, out: Any = None) -> Any:
    """Return vectors along an axis divided by their lengths, or write them to ``out``."""
    array = numpy.array(data, float)
    if array.ndim == 1 and out is None:
        return array / math.sqrt(array @ array)
    unit = array / numpy.sqrt(numpy.sum(array * array, axis=axis, keepdims=axis is not None))
    if out is None:
        return unit
    out[...] = unit
    return None


def random_vector(size: Any) -> Matrix:
    """Return random numbers from 0 to 1."""
    return numpy.random.random(size)


def _with_w_first(quaternion: Any) -> Quaternion:
    x, y, z, w = quaternion
    return w, x, y, z


def _with_w_last(quaternion: Any) -> Quaternion:
    w, x, y, z = quaternion
    return x, y, z, w


def _eigenvectors(matrix: Matrix, value: float) -> list[Matrix]:
    """Return the real eigenvectors of an eigenvalue."""
    values, vectors = numpy.linalg.eig(matrix)
    found = numpy.flatnonzero(abs(numpy.real(values) - value) < _NEAR)
    return [numpy.real(vectors[:, index]) for index in found]
