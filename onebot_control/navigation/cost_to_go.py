"""The cost of the path from each cell to the goal, by Dijkstra's algorithm on the map's costs."""

import math

import numpy as np
from numpy.typing import NDArray

from onebot_control.navigation.grid import Window
from onebot_description.arrays import Floats, Singles

_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_LENGTHS = np.array([1.0] * 4 + [math.sqrt(2.0)] * 4)
_WIDTH = 4.0  # width of the fronts that are computed together, in cells of free ground

Cells = NDArray[np.intp]


class CostToGo:
    """A field over a map: the price of the cheapest path from each cell to the goal.

    The wave spreads from the goal until it has passed the robot. When prices change, the field is
    reset where paths cross the change, and the wave continues from around that part.

    Attributes:
        values: (rows, columns), price from the center of a cell, m on free ground; infinite where
            the wave has not been.
        level: the price up to which the field is known.
        aside: number of cells within which the robot escapes from an obstacle that is too near.
    """

    aside = 4

    def __init__(self, prices: Singles, resolution: float, goals: Cells) -> None:
        """Start a wave.

        Args:
            prices: (rows, columns), price of 1 m in each cell; infinite if impassable.
            resolution: edge of a cell, m.
            goals: rows and columns (N, 2) of the cells of the goal.
        """
        rows, columns = prices.shape
        self._width, self._resolution = columns + 2, resolution
        self._offsets = np.array([a * self._width + b for a, b in _STEPS])
        half = np.full((rows + 2, self._width), np.inf)
        half[1:-1, 1:-1] = prices.astype(float) * (resolution / 2.0)
        self._inner, self._half = half[1:-1, 1:-1], half.reshape(-1)
        self._values = np.full(self._half.size, np.inf)
        self.values: Floats = self._values.reshape(half.shape)[1:-1, 1:-1]
        self._order = np.zeros(self._half.size, np.intp)
        self._front = self._goals = self._flat(goals[:, 0], goals[:, 1])
        self._values[self._goals] = self.level = 0.0

    def _flat(self, rows: Cells, columns: Cells) -> Cells:
        return np.asarray((rows + 1) * self._width + columns + 1)

    def _once(self, cells: Cells) -> Cells:
        """Return the cells without duplicates."""
        numbers = np.arange(cells.size)
        self._order[cells] = numbers
        return np.asarray(cells[self._order[cells] == numbers])

    def _from(self, cells: Cells) -> tuple[Cells, Floats]:
        """Return the neighbors of cells, (N, 8), and the prices of the paths to them."""
        around = cells[:, None] + self._offsets
        costs = self._half[cells][:, None] + self._half[around]
        costs *= _LENGTHS
        costs += self._values[cells][:, None]
        return around, costs

    def spread(
        self, cell: tuple[int, int] | None = None, beyond: float = 0.0, budget: float = math.inf
    ) -> bool:
        """Advance the wave until it has passed a cell; return whether it has.

        Args:
            cell: row and column; None: until everything is known.
            beyond: price by which the wave should pass the cell.
            budget: number of cells after which it stops, to continue later.
        """
        while cell is None or self.level < self.value(cell) + beyond:
            if not self._front.size:
                self.level = math.inf
                return True
            if budget < 0:
                return False
            budget -= self._advance()
        return True

    def _advance(self) -> int:
        """Advance one front of the wave, and return the number of its cells."""
        front, values = self._front, self._values
        reached = values[front]
        self.level = max(self.level, float(reached.min()))
        near = reached < self.level + _WIDTH * self._resolution
        now, far = front[near], front[~near]
        around, costs = self._from(now)
        better = costs < values[around]
        around, costs = around[better], costs[better]
        np.minimum.at(values, around, costs)
        self._front = self._once(np.concatenate((far, around)))
        return int(now.size)

    def change(self, prices: Singles, part: Window) -> None:
        """Apply changed prices of a part."""
        old = self._inner[part.cells]
        new = prices[part.cells].astype(float) * (self._resolution / 2.0)
        # Small changes of price can be ignored.
        with np.errstate(invalid="ignore"):
            changed = np.isinf(new) != np.isinf(old)
            changed |= np.abs(new - old) > 0.2 * np.minimum(new, old)
        rows, columns = np.nonzero(changed)
        cells = self._flat(rows + part.top, columns + part.left)
        lost = self._over(cells)
        old[changed] = new[changed]
        near = (np.append(lost, cells)[:, None] + self._offsets).reshape(-1)
        self._values[lost] = np.inf
        self._values[self._goals] = 0.0
        front = np.concatenate((self._front, self._goals, near))
        self._front = self._once(front[np.isfinite(self._values[front])])
        self.level = float(min(self.level, self._values[near].min(initial=math.inf)))

    def _over(self, cells: Cells) -> Cells:
        """Return the cells that the wave has reached, and cells whose paths cross them."""
        values, is_lost = self._values, np.zeros(self._values.size, np.bool_)
        found = [cells[np.isfinite(values[cells])]]
        while found[-1].size:
            is_lost[found[-1]] = True
            around, costs = self._from(found[-1])
            over = (values[around] >= costs) & np.isfinite(costs) & ~is_lost[around]
            over &= np.isfinite(values[around])
            found.append(self._once(around[over]))
        return np.concatenate(found)

    def nearest(self, cell: tuple[int, int]) -> tuple[int, int]:
        """Return the cell, or the best cell near it if it is too near to an obstacle."""
        if math.isfinite(self.values[cell]):
            return cell
        window = Window.around(cell, self.aside, self.values.shape)
        part = self.values[window.cells]
        row, column = np.unravel_index(part.argmin(), part.shape)
        return window.top + int(row), window.left + int(column)

    def value(self, cell: tuple[int, int]) -> float:
        """Return the cost to go at a cell, or near it if it is too near to an obstacle."""
        return float(self.values[self.nearest(cell)])

    def path(self, start: tuple[int, int], limit: int = 100_000) -> Cells:
        """Return rows and columns (N, 2) of the cells from a start to the goal; N = 0: no path."""
        at = (start[0] + 1) * self._width + start[1] + 1
        cells = [at]
        values = self._values
        if not math.isfinite(values[at]):
            return np.zeros((0, 2), np.intp)
        while values[at] > 0.0 and len(cells) < limit:
            around = at + self._offsets
            at = int(around[values[around].argmin()])
            if values[at] >= values[cells[-1]]:
                break
            cells.append(at)
        rows, columns = np.divmod(np.array(cells), self._width)
        return np.stack((rows - 1, columns - 1), axis=1)
