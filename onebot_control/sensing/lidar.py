"""Ranges: the rays of a lidar, and what it measures with them."""

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.noise import add_noise
from onebot_control.sensing.rays import Rays
from onebot_description.description.description import Fan, Lidar

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Nearer than the greatest range by a rounding error is still in range.
_MARGIN = 1e-4  # m


def angles(fan: Fan) -> Floats:
    """Return the angles (N,) of a fan's rays, rad."""
    if fan.samples == 1:
        return np.array([fan.least])
    return np.linspace(fan.least, fan.greatest, fan.samples)


def lidar_rays(lidar: Lidar) -> Rays:
    """Return the rays, row by row, each from its least angle on."""
    up, across = np.meshgrid(angles(lidar.vertical), angles(lidar.horizontal), indexing="ij")
    flat = np.cos(up)
    directions = np.stack([flat * np.cos(across), flat * np.sin(across), np.sin(up)], axis=-1)
    return Rays(directions.reshape(-1, 3))


def reach(lidar: Lidar) -> float:
    """Return how far rays are cast, m."""
    return lidar.greatest + _MARGIN


def ranges(
    lidar: Lidar,
    distances: Singles,
    hit: NDArray[np.bool_],
    offset: float = 0.0,
    generator: "np.random.Generator | None" = None,
) -> Singles:
    """Return the ranges (N,), m: infinite beyond the greatest, minus infinity below the least.

    ``distances`` (N,), m, are those of what the rays ``hit`` (N,), if anything; without a
    ``generator`` there is no noise. The ``offset`` of all ranges, m, is drawn once.
    """
    measured = distances
    if generator is not None:
        # What is out of range stays so, and what is in range.
        measured = add_noise(distances, lidar.noise, offset, generator)
        measured = np.clip(measured, np.float32(lidar.least), np.float32(lidar.greatest))
    far = ~hit | (distances > np.float32(lidar.greatest))
    result = np.where(far, np.float32(np.inf), measured)
    result[distances < np.float32(lidar.least)] = -np.inf
    return result


def fill_points(
    points: NDArray[np.void],
    rays: Rays,
    distances: Singles,
    pose: tuple[Floats, Floats],
    nowhere: float = np.inf,
) -> None:
    """Write x, y and z of ``points`` (R, C) that rays reach after ``distances``, if finite.

    ``pose`` is the sensor's rotation (3, 3) and position (3,) in the frame of the points. Those of
    other distances have ``nowhere``.
    """
    turned, missing = rays.turned(pose[0]), ~np.isfinite(distances).ravel()
    reached = np.where(missing, np.float32(0.0), distances.ravel())
    for axis, name in enumerate("xyz"):
        along = turned[:, axis] * reached + np.float32(pose[1][axis])
        points[name] = np.where(missing, np.float32(nowhere), along).reshape(points.shape)


POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2"],
        "offsets": [0, 4, 8, 16, 20],
        "itemsize": 32,
    }
)
"""A point of a cloud, as gz sim lays it out."""


def cloud(
    lidar: Lidar, rays: Rays, all_ranges: Singles, pose: tuple[Floats, Floats]
) -> NDArray[np.void]:
    """Return the points (rows, columns) of ranges (N,), infinite where nothing was in range.

    ``pose`` is the lidar's rotation (3, 3) and position (3,) in the frame of the points.
    """
    points = np.zeros((lidar.vertical.samples, lidar.horizontal.samples), POINT)
    fill_points(points, rays, all_ranges, pose)
    points["ring"] = np.arange(len(points))[:, None]
    return points if lidar.is_organized else met(points)


def met(points: NDArray[np.void]) -> NDArray[np.void]:
    """Return in one row (1, N) those points at which a ray has met something in range."""
    found: NDArray[np.void] = points[np.isfinite(points["x"])]
    return found.reshape(1, -1)


def middle_row(lidar: Lidar, all_ranges: Singles) -> Singles:
    """Return the ranges of the row that a plane scan has; the upper one of two in the middle."""
    rows = lidar.vertical.samples
    row: Singles = all_ranges.reshape(rows, -1)[rows // 2]
    return row
