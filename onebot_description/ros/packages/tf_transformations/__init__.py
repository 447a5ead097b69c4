"""Rotations and homogeneous matrices, as the package tf_transformations has them.

Quaternions are x, y, z, w. Matrices are (4, 4). Angles are in radians; three of them are about the
axes that a name has: "sxyz" are the fixed axes x, y, z, "rzyx" the axes that turn along. They are
computed with the formulas of K. Shoemake, "Euler Angle Conversion", Graphics Gems IV, 1994.
"""

import math
from typing import Any

import numpy
from numpy.typing import ArrayLike

from onebot_description.geometry import poses as _poses
from onebot_description.geometry import quaternions as _quaternions

Matrix = Any  # an array of floats

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = numpy.identity(3)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY

_EPS = numpy.finfo(float).eps * 4.0
_NEAR = 1e-8  # tolerance of an eigenvalue
_NEXT_AXIS = [1, 2, 0, 1]
_AXES2TUPLE = {  # inner axis, parity, repetition, frame
    **{
        f"s{'xyz'[first]}{'xyz'[second]}{'xyz'[third]}": (first, parity, int(third == first), 0)
        for first in range(3)
        for parity in range(2)
        for second in [_NEXT_AXIS[first + parity]]
        for third in (3 - first - second, first)
    }
}
_AXES2TUPLE |= {f"r{name[:0:-1]}": (*code[:3], 1) for name, code in _AXES2TUPLE.items()}
_TUPLE2AXES = {code: name for name, code in _AXES2TUPLE.items()}


def __getattr__(name: str) -> Any:
    if name.lower().startswith(("arcball", "clip_", "orthogonal", "projection_", "superimpos")):
        raise AttributeError(f"tf_transformations of OneBot has no {name}", name=name)
    raise AttributeError(f"module 'tf_transformations' has no attribute '{name}'", name=name)


# --- matrices -------------------------------------------------------------------------------------


def identity_matrix() -> Matrix:
    """Return the matrix that changes nothing."""
    return numpy.identity(4)


def translation_matrix(direction: ArrayLike) -> Matrix:
    """Return the matrix of a translation."""
    return _affine(ROTATION_IDENTITY, direction)


def translation_from_matrix(matrix: ArrayLike) -> Matrix:
    """Return the translation (3,) of a matrix."""
    return numpy.array(matrix, float)[:3, 3]


def rotation_matrix(angle: float, direction: ArrayLike, point: ArrayLike | None = None) -> Matrix:
    """Return the matrix of a rotation about an axis, through a point if it is given."""
    turn = quaternion_matrix(quaternion_about_axis(angle, direction))[:3, :3]
    return _about(turn, point)


def rotation_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix]:
    """Return angle, axis (3,) and a point (3,) on the axis of the rotation of a matrix."""
    affine = numpy.array(matrix, float)
    *axis, w = quaternion_from_matrix(affine)
    length = math.hypot(*axis)
    direction = numpy.array(axis) / length if length else numpy.array([1.0, 0.0, 0.0])
    return 2.0 * math.atan2(length, w), direction, _fixed_point(affine)


def reflection_matrix(point: ArrayLike, normal: ArrayLike) -> Matrix:
    """Return the matrix that mirrors at the plane with a point and a normal."""
    across = unit_vector(numpy.asarray(normal)[:3])
    return _about(ROTATION_IDENTITY - 2.0 * numpy.outer(across, across), point)


def reflection_from_matrix(matrix: ArrayLike) -> tuple[Matrix, Matrix]:
    """Return a point (3,) and the normal (3,) of the plane at which a matrix mirrors."""
    affine = numpy.array(matrix, float)
    return _fixed_point(affine), _eigenvectors(affine[:3, :3], -1.0)[0]


def scale_matrix(
    factor: float, origin: ArrayLike | None = None, direction: ArrayLike | None = None
) -> Matrix:
    """Return the matrix that scales from an origin, in one direction if it is given."""
    scale = ROTATION_IDENTITY * factor
    if direction is not None:
        along = unit_vector(numpy.asarray(direction)[:3])
        scale = ROTATION_IDENTITY + (factor - 1.0) * numpy.outer(along, along)
    return _about(scale, origin)


def scale_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix | None]:
    """Return factor, origin (3,) and direction (3,) of a scaling matrix; None in all directions."""
    affine = numpy.array(matrix, float)
    factor = float(numpy.trace(affine[:3, :3])) - 2.0
    direction = None
    try:
        direction = _eigenvectors(affine[:3, :3], factor)[0]
    except ValueError:
        factor = (factor + 2.0) / 3.0
    return factor, _fixed_point(affine), direction


def shear_matrix(angle: float, direction: ArrayLike, point: ArrayLike, normal: ArrayLike) -> Matrix:
    """Return the matrix that shears by an angle along a direction in a plane."""
    along, across = unit_vector(direction), unit_vector(normal)
    if abs(along @ across) > 1e-5:
        raise ValueError("direction and normal vectors are not orthogonal")
    return _about(ROTATION_IDENTITY + math.tan(angle) * numpy.outer(along, across), point)


def shear_from_matrix(matrix: ArrayLike) -> tuple[float, Matrix, Matrix, Matrix]:
    """Return angle, direction, point and normal (3,) of a shear matrix."""
    affine = numpy.array(matrix, float)
    # The shear is tan(angle) direction normal^T, of which the singular vectors are the two.
    left, sizes, right = numpy.linalg.svd(affine[:3, :3] - ROTATION_IDENTITY)
    return math.atan(sizes[0]), left[:, 0], _fixed_point(affine), right[0]


def compose_matrix(
    scale: ArrayLike | None = None,
    shear: ArrayLike | None = None,
    angles: ArrayLike | None = None,
    translate: ArrayLike | None = None,
    perspective: ArrayLike | None = None,
) -> Matrix:
    """Return the matrix that scales, shears, turns about fixed axes and translates.

    As in the genuine package, ``perspective`` is ignored.
    """
    shears = numpy.identity(3)
    if shear is not None:
        shears[0, 1], shears[0, 2], shears[1, 2] = numpy.asarray(shear)
    turn = ROTATION_IDENTITY if angles is None else euler_matrix(*numpy.asarray(angles))[:3, :3]
    scales = numpy.diag(ZOOM_IDENTITY if scale is None else numpy.asarray(scale, float))
    translation = TRANSLATION_IDENTITY if translate is None else translate
    return _affine(turn @ scales @ shears, translation)


def decompose_matrix(
    matrix: ArrayLike,
) -> tuple[Matrix, Matrix, tuple[float, float, float], Matrix, None]:
    """Return scale, shear, angles about fixed axes, translation and None; see compose_matrix."""
    affine = numpy.array(matrix, float)
    turn, remainder = _factors(affine)
    scale = numpy.diag(remainder).copy()
    shear = numpy.array(
        [remainder[0, 1] / scale[0], remainder[0, 2] / scale[0], remainder[1, 2] / scale[1]]
    )
    return scale, shear, euler_from_matrix(turn), affine[:3, 3], None


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


# --- three angles ---------------------------------------------------------------------------------


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Matrix:
    """Return the matrix of a rotation by three angles."""
    return quaternion_matrix(quaternion_from_euler(ai, aj, ak, axes))


def euler_from_matrix(matrix: ArrayLike, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Return the three angles of the rotation of a matrix (3, 3) or (4, 4)."""
    i, j, k, parity, repetition, frame = _axes(axes)
    m = numpy.array(matrix, float)[:3, :3]
    cosine = math.hypot(m[i, j], m[i, k]) if repetition else math.hypot(m[i, i], m[j, i])
    first, third = math.atan2(-m[j, k], m[j, j]), 0.0
    if repetition:
        second = math.atan2(cosine, m[i, i])
        if cosine > _EPS:
            first, third = math.atan2(m[i, j], m[i, k]), math.atan2(m[j, i], -m[k, i])
    else:
        second = math.atan2(-m[k, i], cosine)
        if cosine > _EPS:
            first, third = math.atan2(m[k, j], m[k, k]), math.atan2(m[j, i], m[i, i])
    if parity:
        first, second, third = -first, -second, -third
    return (third, second, first) if frame else (first, second, third)


def euler_from_quaternion(quaternion: ArrayLike, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Return the three angles of a quaternion."""
    return euler_from_matrix(quaternion_matrix(quaternion), axes)


def quaternion_from_euler(
    ai: float, aj: float, ak: float, axes: Any = "sxyz"
) -> tuple[float, float, float, float]:
    """Return the quaternion of a rotation by three angles."""
    i, j, k, parity, repetition, frame = _axes(axes)
    first, third = (ak, ai) if frame else (ai, ak)
    turn = 0.0, 0.0, 0.0, 1.0
    for axis, angle in ((i, first), (j, aj), (i if repetition else k, third)):
        turn = _poses.multiply(_poses.about(_UNIT[axis], float(angle)), turn)
    return turn


# --- quaternions ----------------------------------------------------------------------------------


def quaternion_about_axis(angle: float, axis: ArrayLike) -> tuple[float, float, float, float]:
    """Return the quaternion of a rotation about an axis of any length."""
    x, y, z = unit_vector(numpy.asarray(axis)[:3]).tolist()
    return _poses.about((x, y, z), float(angle))


def quaternion_matrix(quaternion: ArrayLike) -> Matrix:
    """Return the matrix of a quaternion of any length; the identity for length 0."""
    x, y, z, w = numpy.asarray(quaternion, float)
    return _affine(_quaternions.to_matrix((x, y, z, w)), TRANSLATION_IDENTITY)


def quaternion_from_matrix(matrix: ArrayLike) -> tuple[float, float, float, float]:
    """Return the quaternion with w >= 0 of the rotation of a matrix (4, 4)."""
    m = _factors(numpy.array(matrix, float))[0]
    # The largest part is computed first, the others from it: Shepperd's method.
    squares = [1.0 + m[0, 0] - m[1, 1] - m[2, 2], 1.0 - m[0, 0] + m[1, 1] - m[2, 2]]
    squares += [1.0 - m[0, 0] - m[1, 1] + m[2, 2], 1.0 + m[0, 0] + m[1, 1] + m[2, 2]]
    products = numpy.array(
        [
            [squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
        ]
    )
    x, y, z, w = unit_vector(products[int(numpy.argmax(squares))]).tolist()
    return (-x, -y, -z, -w) if w < 0.0 else (x, y, z, w)


def quaternion_multiply(
    quaternion1: ArrayLike, quaternion0: ArrayLike
) -> tuple[float, float, float, float]:
    """Return the product of two quaternions: the rotation ``quaternion0``, then the other."""
    first, second = (tuple(numpy.asarray(q).tolist()) for q in (quaternion1, quaternion0))
    return _poses.multiply(first, second)


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


_UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _axes(axes: Any) -> tuple[int, int, int, int, int, int]:
    """Return the three axes in the order of fixed ones, parity, repetition and frame."""
    code = _AXES2TUPLE[axes.lower()] if isinstance(axes, str) else tuple(axes)
    first, parity, repetition, frame = _AXES2TUPLE[_TUPLE2AXES[code]]
    return first, _NEXT_AXIS[first + parity], _NEXT_AXIS[first - parity + 1], *code[1:]


def _affine(basis: ArrayLike, translation: ArrayLike) -> Matrix:
    affine = numpy.identity(4)
    affine[:3, :3], affine[:3, 3] = basis, numpy.asarray(translation)[:3]
    return affine


def _about(basis: Matrix, point: ArrayLike | None) -> Matrix:
    """Return a matrix that leaves a point where it is; the origin by default."""
    fixed = numpy.zeros(3) if point is None else numpy.array(point, float)[:3]
    return _affine(basis, fixed - basis @ fixed)


def _eigenvectors(matrix: Matrix, value: float) -> list[Matrix]:
    """Return the real eigenvectors of a value.

    Raises:
        ValueError: there are none.
    """
    values, vectors = numpy.linalg.eig(matrix)
    axes_found = [
        numpy.real(vectors[:, index])
        for index in numpy.flatnonzero(abs(numpy.real(values) - value) < _NEAR)
    ]
    if not axes_found:
        raise ValueError(f"no eigenvector corresponding to eigenvalue {value:g}")
    return axes_found


def _fixed_point(affine: Matrix) -> Matrix:
    """Return the point nearest to the origin that a matrix leaves where it is."""
    point: Matrix = numpy.linalg.lstsq(
        ROTATION_IDENTITY - affine[:3, :3], affine[:3, 3], rcond=1e-9
    )[0]
    return point


def _factors(affine: Matrix) -> tuple[Matrix, Matrix]:
    """Return the rotation of a matrix, and what is scaled and sheared before, an upper triangle."""
    turn, remainder = numpy.linalg.qr(affine[:3, :3])
    signs = numpy.sign(numpy.diag(remainder))
    signs[0] *= numpy.linalg.det(turn * signs)  # a mirrored matrix scales x by a negative factor
    return turn * signs, remainder * signs[:, None]
