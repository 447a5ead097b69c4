"""Normals: round where a surface is round, sharp where it has an edge."""

import numpy as np
from numpy.typing import NDArray


def corner_normals(
    points: NDArray[np.float64], faces: NDArray[np.int64], edge: float
) -> NDArray[np.float64]:
    """Return a normal for each corner of each face.

    A corner's normal is the mean, weighted by angle, of the normals of those faces around the point
    that differ from the corner's own by less than ``edge``.

    Args:
        points: (P, 3), each position once.
        faces: (F, 3), indices into points.
        edge: radians.

    Returns:
        (F, 3, 3), of unit length.
    """
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    angles = _angles(corners)
    around: list[list[tuple[int, int]]] = [[] for _ in points]
    for face, corner in np.ndindex(faces.shape):
        around[faces[face, corner]].append((face, corner))
    result = np.empty((len(faces), 3, 3))
    limit = np.cos(edge)
    for places in around:
        if not places:
            continue
        at_face, at_corner = np.array(places).T
        local = normals[at_face]
        near = local @ local.T > limit
        mean = near.astype(float) @ (local * angles[at_face, at_corner][:, None])
        result[at_face, at_corner] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    return result


def _angles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle of each face at each of its corners: (F, 3), radians."""
    onward = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    cosine = np.einsum("fci,fci->fc", onward, back)
    cosine /= np.linalg.norm(onward, axis=2) * np.linalg.norm(back, axis=2)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
