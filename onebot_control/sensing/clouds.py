"""Point clouds of the hits of rays, as arrays with the layout of gz sim."""

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.rays import Rays
from onebot_description.arrays import Floats, Singles


def point_layout(*others: tuple[str, str, int]) -> "np.dtype[np.void]":
    """Return the layout of a point: x, y, z, and other fields as (name, format, offset)."""
    fields = [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), *others]
    return np.dtype(
        {
            "names": [name for name, _, _ in fields],
            "formats": [kind for _, kind, _ in fields],
            "offsets": [offset for _, _, offset in fields],
            "itemsize": 32,
        }
    )


def cloud_of(
    layout: "np.dtype[np.void]",
    shape: tuple[int, int],
    rays: Rays,
    distances: Singles,
    pose: tuple[Floats, Floats],
    nowhere: float = np.inf,
) -> NDArray[np.void]:
    """Return a cloud, (R, C) of points whose fields other than x, y and z are zeros.

    Args:
        layout: layout of a point.
        shape: R and C.
        rays: R C rays, in the sensor's frame.
        distances: (R C,) or (R, C), along the rays, in lengths of their directions.
        pose: rotation (3, 3) and position (3,) of the sensor in the frame of the points.
        nowhere: x, y and z of points whose distance is not finite.
    """
    points = np.zeros(shape, layout)
    turned, missing = rays.turned(pose[0]), ~np.isfinite(distances).ravel()
    reached = np.where(missing, np.float32(0.0), distances.ravel())
    for axis, name in enumerate("xyz"):
        along = turned[:, axis] * reached + np.float32(pose[1][axis])
        points[name] = np.where(missing, np.float32(nowhere), along).reshape(shape)
    return points


def finite(points: NDArray[np.void]) -> NDArray[np.void]:
    """Return the points at which a ray hit something in range, as one row (1, N)."""
    hits: NDArray[np.void] = points[np.isfinite(points["x"])]
    return hits.reshape(1, -1)
