"""A map as in nav_msgs/OccupancyGrid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNKNOWN, FREE, OCCUPIED = -1, 0, 100  # the values of nav_msgs/OccupancyGrid


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """The occupied cells of a part of the world, as in nav_msgs/OccupancyGrid.

    Attributes:
        data: (rows, columns), int8: 0 free, 100 occupied, -1 unknown. Rows go along y, columns
            along x, and ``data[0, 0]`` is the cell at the origin, so ``data.ravel()`` is the data
            of the message.
        resolution: edge of a cell, m.
        origin: x and y of the lower left corner of ``data[0, 0]`` in the map, m.
    """

    data: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]
