"""The price of the way from each cell to the goal, by Dijkstra's wave over the map's prices."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from onebot_control.navigation.grid import Window
from onebot_description.arrays import Floats, Singles

_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_LENGTHS = np.array([1.0] * 4 + [math.sqrt(2.0)] * 4)


class CostToGo:
    """A field over a map: the price of the cheapest way from each cell to the goal.

    The wave goes out from the goal until it has passed the robot. When prices change, what was
    reached before the change stays, and the wave goes on from there.

    Attributes:
        values: (rows, columns), price from the middle of a cell, m on free ground; infinite where
            the wave has not been.
    """

    def __init__(self, prices: Singles, resolution: float, goals: NDArray[np.intp]) -> None:
        """Begin a wave.

        Args:
            prices: (rows, columns), of 1 m in each cell; infinite: no way there.
            resolution: edge of a cell, m.
            goals: rows and columns (N, 2) of the cells of the goal.
        """
        rows, columns = prices.shape
        self._width, self._shape = columns + 2, (rows, columns)
        self._resolution = resolution
        self._offsets = np.array([a * self._width + b for a, b in _STEPS])
        self._half = np.full((rows + 2, self._width), np.inf)
        self._half[1:-1, 1:-1] = prices.astype(float) * (resolution / 2.0)
        self._values = np.full(self._half.size, np.inf)
        self._order = np.zeros(self._half.size, np.int64)
        self._goals = (goals[:, 0] + 1) * self._width + goals[:, 1] + 1
        self._values[self._goals] = 0.0
        self._front = self._goals
        self._level = 0.0

    @property
    def values(self) -> Floats:
        """The field, (rows, columns)."""
        rows, columns = self._shape
        field: Floats = self._values.reshape(rows + 2, self._width)[1:-1, 1:-1]
        return field

    @property
    def level(self) -> float:
        """The price up to which the field is known."""
        return self._level

    def spread(self, level: float = math.inf) -> Iterator[int]:
        """Let the wave go on until all cells up to a price are known.

        Yields:
            The number of cells of each front.
        """
        half, values, order = self._half.reshape(-1), self._values, self._order
        front = self._front
        while front.size and self._level < level:
            reached = values[front]
            near = reached < self._level + self._resolution
            if not near.any():
                self._level = float(reached.min())
                continue
            now, front = front[near], front[~near]
            around = now[:, None] + self._offsets
            costs = half[now][:, None] + half[around]
            costs *= _LENGTHS
            costs += reached[near][:, None]
            better = costs < values[around]
            around, costs = around[better], costs[better]
            np.minimum.at(values, around, costs)
            front = np.concatenate((front, around))
            numbers = np.arange(front.size)
            order[front] = numbers
            front = front[order[front] == numbers]
            self._front = front
            yield now.size
        if not front.size:
            self._level = math.inf

    def change(self, prices: Singles, part: Window) -> bool:
        """Take over changed prices of a part, and go back to before the first change.

        Returns:
            Whether what was known has changed.
        """
        inner = self._half[part.top + 1 : part.bottom + 1, part.left + 1 : part.right + 1]
        new = prices[part.cells].astype(float) * (self._resolution / 2.0)
        changed = new != inner
        # Small changes of price need not be known at once.
        with np.errstate(invalid="ignore"):
            large = np.isinf(new) != np.isinf(inner)
            large |= np.abs(new - inner) > 0.2 * np.minimum(new, inner)
        changed &= large
        if not changed.any():
            return False
        rows, columns = np.nonzero(changed)
        inner[changed] = new[changed]
        cells = (rows + part.top + 1) * self._width + columns + part.left + 1
        around = (cells[:, None] + np.append(self._offsets, 0)).reshape(-1)
        first = float(self._values[around].min())
        if first >= self._level:
            return False
        is_known = self._values < max(first, 1e-12)
        is_known[self._goals] = True
        self._values[~is_known] = np.inf
        index = np.flatnonzero(is_known)
        edge = ~is_known[index[:, None] + self._offsets].all(axis=1)
        self._front = index[edge]
        self._level = max(0.0, first)
        return True

    def way(self, start: tuple[int, int], most: int = 100_000) -> NDArray[np.intp]:
        """Return rows and columns (N, 2) of the cells from a start to the goal; N = 0: no way."""
        at = (start[0] + 1) * self._width + start[1] + 1
        cells = [at]
        values = self._values
        if not math.isfinite(values[at]):
            return np.zeros((0, 2), np.intp)
        while values[at] > 0.0 and len(cells) < most:
            around = at + self._offsets
            at = int(around[values[around].argmin()])
            if values[at] >= values[cells[-1]]:
                break
            cells.append(at)
        rows, columns = np.divmod(np.array(cells), self._width)
        return np.stack((rows - 1, columns - 1), axis=1)
