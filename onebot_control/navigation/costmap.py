"""Where a robot may drive, and at what price: distances from obstacles, and costs of cells."""

import math

import numpy as np
from scipy.ndimage import distance_transform_edt

from onebot_control.navigation.grid import DOUBTFUL, GridMap, Window
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.arrays import Floats, Singles

_REACH = 1.0  # m; maximum distance that is computed
_NEAR = 8.0  # extra price of a cell right beside an obstacle
_DECAY = 0.08  # m; distance in which it falls to 1/e
_UNKNOWN = 0.5  # extra price of an unknown cell
_FREED = -0.9  # log-odds below which a cell is no longer an obstacle
_OFF_PATH = 30.0  # extra price 1 m off a preferred path
_VISITED = 0.25  # extra price for each second that the robot was near

# The costs of nav2_costmap_2d.
_INSCRIBED, _LETHAL, _NO_INFORMATION = 253, 254, 255
_SCALING = 3.0  # cost_scaling_factor, 1/m

# Center of a cell, and of its quarters, relative to its center: row and column, cells.
_POINTS = ((0.0, 0.0), (-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25))


class Costmap:
    """Distances from obstacles, and the price of driving over cells, updated in parts.

    Attributes:
        distances: (rows, columns), from the center of a cell to the nearest obstacle, m; at most
            1 m.
        fine: (2 rows, 2 columns), the same from the centers of the quarters of cells.
        prices: (rows, columns), price of driving 1 m there; infinite where the robot cannot be.
    """

    def __init__(self, grid: GridMap, radius: float) -> None:
        """Use a map, and the radius within which the robot certainly touches obstacles, m."""
        self._grid, self._radius = grid, radius
        self._occupied = np.zeros((0, 0), np.bool_)
        self.distances = self.fine = np.zeros((0, 0), np.float32)
        self.prices = np.zeros((0, 0), np.float32)
        self.version = -1

    def update(self, window: Window) -> Window | None:
        """Apply changes in a part of the map.

        Returns:
            The part of the prices that has changed; None if none has.
        """
        grid = self._grid
        if self.version != grid.version:
            self._resize()
            return self._measure(grid.whole)
        log_odds, was_occupied = grid.log_odds[window.cells], self._occupied[window.cells]
        # Cells at edges of walls, which are hit and missed alternately, stay occupied.
        is_kept = was_occupied & (log_odds > _FREED) & (log_odds != DOUBTFUL)
        occupied = is_kept | (log_odds > DOUBTFUL)
        changed = occupied != was_occupied
        if not changed.any():
            return None
        self._occupied[window.cells] = occupied
        rows, columns = (np.flatnonzero(changed.any(axis=axis)).tolist() for axis in (1, 0))
        part = Window(rows[0], columns[0], rows[-1] + 1, columns[-1] + 1)
        return self._measure(part.moved(window.top, window.left))

    def _resize(self) -> None:
        grid = self._grid
        self._occupied = grid.log_odds > DOUBTFUL
        self.distances = np.full(grid.shape, _REACH, np.float32)
        self.fine = np.full((2 * grid.shape[0], 2 * grid.shape[1]), _REACH, np.float32)
        self.prices = np.ones(grid.shape, np.float32)
        self.version = grid.version

    def _measure(self, part: Window) -> Window:
        """Recompute distances and prices around a part whose obstacles have changed."""
        resolution = self._grid.resolution
        reach = math.ceil(_REACH / resolution)
        inner = part.grown(reach, self._occupied.shape)
        outer = part.grown(2 * reach, self._occupied.shape)
        kept = (slice(None), *inner.moved(-outer.top, -outer.left).cells)
        nearest = self._nearest(outer)[kept]
        center, *quarters = np.minimum(nearest * resolution, _REACH)
        self.distances[inner.cells] = center
        fine = self.fine[inner.quarters.cells]
        fine[::2, ::2], fine[::2, 1::2], fine[1::2, ::2], fine[1::2, 1::2] = quarters
        self.price(inner)
        return inner

    def _nearest(self, part: Window) -> Singles:
        """Return the distances to the nearest obstacle, (5, rows, columns), cells.

        They are those of the center of each cell, then of the centers of its quarters.
        """
        occupied = self._occupied[part.cells]
        squares = np.full((len(_POINTS), *occupied.shape), np.inf, np.float32)
        if not occupied.any():
            return squares
        cells = distance_transform_edt(~occupied, return_distances=False, return_indices=True)
        # The mean end of rays in an occupied cell is more exact than its center. The nearest one
        # may be in another cell than the nearest center: those of the neighbors are tried, too.
        number, x, y = self._grid.ends[part.cells][tuple(cells)].transpose(2, 0, 1)
        number = np.maximum(number, 1.0) * np.float32(self._grid.resolution)
        ends = np.stack((cells[0] + y / number, cells[1] + x / number)).astype(np.float32)
        ends = np.pad(ends, ((0, 0), (1, 1), (1, 1)), "edge")
        height, width = occupied.shape
        here = np.indices(occupied.shape, np.float32)
        for up, right in ((1, 1), (0, 1), (2, 1), (1, 0), (1, 2)):
            away = ends[:, up : up + height, right : right + width] - here
            for square, (row, column) in zip(squares, _POINTS, strict=True):
                rows, columns = away[0] - np.float32(row), away[1] - np.float32(column)
                np.minimum(square, rows * rows + columns * columns, out=square)
        return np.sqrt(squares)

    def price(self, part: Window) -> None:
        """Recompute the prices of a part."""
        distances = self.distances[part.cells]
        beyond = distances - np.float32(self._radius)
        prices = np.float32(1.0) + np.float32(_NEAR) * np.exp(beyond * np.float32(-1.0 / _DECAY))
        prices += np.float32(_UNKNOWN) * (self._grid.log_odds[part.cells] == 0.0)
        prices += self._grid.further[part.cells]
        prices[beyond < 0.0] = np.inf
        self.prices[part.cells] = prices

    def visit(self, part: Window, seconds: float) -> None:
        """Record that the robot was in a part, so that it prefers other paths."""
        self._grid.further[part.cells] += np.float32(_VISITED * seconds)
        self.price(part)

    def prefer(self, points: Floats | None) -> None:
        """Forget visits, and increase prices with the distance from a path, (N, 2)."""
        self._grid.further[:] = 0.0
        if points is not None:
            grid, away = self._grid, np.ones(self._grid.shape, np.bool_)
            for start, end in zip(points[:-1], points[1:], strict=True):
                count = math.ceil(float(np.hypot(*(end - start))) / (0.5 * grid.resolution)) + 1
                cells = grid.cells(np.linspace(start, end, count))
                away[tuple(cells[grid.inside(cells)].T)] = False
            distances = distance_transform_edt(away) * grid.resolution
            self._grid.further[:] = _OFF_PATH * np.minimum(distances, 1.0)
        self.price(Window(0, 0, *self.prices.shape))

    def costs(self) -> OccupancyGrid:
        """Return the costs as in Nav2's costmaps: 253 inscribed, 254 lethal, 255 unknown."""
        beyond = self.distances - self._radius
        costs = np.where(self.distances < _REACH, 252.0 * np.exp(-_SCALING * beyond), 0.0)
        costs[beyond <= 0.0] = _INSCRIBED
        costs[self._occupied] = _LETHAL
        costs[(self._grid.log_odds == 0.0) & (beyond > 0.0)] = _NO_INFORMATION
        return OccupancyGrid(costs.astype(np.uint8), self._grid.resolution, self._grid.origin)
