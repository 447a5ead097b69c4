"""The map that a robot builds from its scans: a log-odds occupancy grid, with points of walls.

Rays clear the cells that they cross, and their ends fill cells (Thrun, Burgard and Fox,
"Probabilistic Robotics", chapter 9). Each cell also stores the mean of the ends in it, which
locates walls with subcell accuracy for scan matching.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from onebot_control.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from onebot_description.arrays import Floats, Singles
from onebot_description.geometry.matrices import to_planar
from onebot_description.geometry.poses import PlanarPose

Mask = NDArray[np.bool_]

DOUBTFUL = np.float32(0.1)
"""Log-odds of an obstacle that may be gone; the next ray there decides."""

_HIT, _MISS = 0.9, -0.4  # log-odds added to a cell with the end of a ray, and to a crossed cell
_MIN_LOG_ODDS, _MAX_LOG_ODDS = -2.0, 3.5  # bounds with which a cell can change within a second
_SURELY_FREE = -1.9  # log-odds below which an obstacle that comes later must have moved there
_FLICKER = 6  # maximum number of adjacent cells at edges of obstacles that alternate
_BESIDE = 3  # cells beside what moved that may belong to it
_FULL = 30.0  # number of ends in a cell after which its mean is fixed
_CHUNK = 64  # cells by which a map grows
_MARGIN = 1.5  # cells at the end of a ray that it does not clear
_MAX_CELLS = 16_000_000
_LEVEL = math.cos(0.1)  # cosine of a lidar plane's maximum inclination


def is_level(mount: Floats) -> bool:
    """Return whether a lidar at a pose (4, 4) in the robot's frame scans a level plane."""
    return bool(abs(mount[2, 2]) > _LEVEL)


class LevelScan(NamedTuple):
    """A scan in the frame of its lidar, whose pose in the robot's frame is ``mount``."""

    ranges: Singles  # (N,), m; infinite: nothing in range; NaN or minus infinity: unknown
    first_angle: float  # angle of the first ray, rad; positive to the left
    step: float  # angle between rays, rad
    reach: float  # maximum range, m
    mount: PlanarPose = PlanarPose()
    time: float | None = None  # s; None: that of the odometry

    @classmethod
    def mounted(
        cls, ranges: Singles, first_angle: float, step: float, reach: float, mount: Floats
    ) -> "LevelScan":
        """Return the scan of a lidar that turns in either direction, upright or upside down.

        Args:
            ranges: (N,), m.
            first_angle: angle of the first ray, rad, about the lidar's z axis.
            step: angle between rays, rad; negative: clockwise about that axis.
            reach: maximum range, m.
            mount: (4, 4), pose of the lidar in the robot's frame.
        """
        if mount[2, 2] < 0.0:  # upside down: its angles are positive to the right
            first_angle, step = -first_angle, -step
        if step < 0.0:
            first_angle += step * (len(ranges) - 1)
            ranges, step = ranges[::-1], -step
        return cls(ranges, first_angle, step, reach, to_planar(mount))

    @property
    def points(self) -> Floats:
        """The end points of the rays that hit something, (N, 2), in the robot's frame, m."""
        hit = np.flatnonzero(np.isfinite(self.ranges))
        ranges, angles = self.ranges[hit].astype(float), self.first_angle + self.step * hit
        ends = np.stack((ranges * np.cos(angles), ranges * np.sin(angles)), axis=1)
        return placed(ends, self.mount)


def placed(points: Floats, pose: PlanarPose) -> Floats:
    """Transform points (N, 2) from a frame at ``pose`` to its parent frame."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    moved: Floats = points @ np.array([[cos, sin], [-sin, cos]]) + (pose.x, pose.y)
    return moved


class Window(NamedTuple):
    """A rectangular part of a map, in cells."""

    top: int  # first row
    left: int  # first column
    bottom: int  # row after the last
    right: int  # column after the last

    @classmethod
    def around(cls, cell: Sequence[int], cells: int, shape: tuple[int, ...]) -> "Window":
        """Return the part up to ``cells`` from one cell, clipped to a map of that shape."""
        row, column = cell
        return cls(row, column, row + 1, column + 1).grown(cells, shape)

    @property
    def cells(self) -> tuple[slice, slice]:
        """The part as an index of arrays."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def quarters(self) -> "Window":
        """The same part in quarters of cells, which have half their edge."""
        return Window(*(2 * edge for edge in self))

    def grown(self, cells: int, shape: tuple[int, ...]) -> "Window":
        """Return the part enlarged on each side, clipped to a map of that shape."""
        return Window(
            max(0, self.top - cells),
            max(0, self.left - cells),
            min(shape[0], self.bottom + cells),
            min(shape[1], self.right + cells),
        )

    def moved(self, rows: int, columns: int) -> "Window":
        """Return a part of the same size."""
        top, left, bottom, right = self
        return Window(top + rows, left + columns, bottom + rows, right + columns)

    def union(self, other: "Window | None") -> "Window":
        """Return the smallest part that contains this one and another."""
        if other is None:
            return self
        low, high = map(min, self[:2], other[:2]), map(max, self[2:], other[2:])
        return Window(*low, *high)


class GridMap:
    """An occupancy grid into which scans are entered; it grows with them.

    Attributes:
        resolution: edge of a cell, m.
        origin: x and y of the lower left corner of the first cell, m.
        log_odds: (rows, columns); above 0 occupied, below 0 free, 0 unknown.
        ends: (rows, columns, 3): number of ends in a cell, and the sums of their x and y relative
            to the cell's center, m.
        freed: (rows, columns), whether a cell was once known to be free.
        further: (rows, columns), price of driving over cells apart from obstacles.
        version: changes when the map grows.
    """

    def __init__(self, resolution: float = 0.05, reach: float = 10.0) -> None:
        """Start with an empty map.

        Args:
            resolution: edge of a cell, m.
            reach: maximum range of the entered scans, m.
        """
        self.resolution, self.reach = resolution, reach
        self.origin = (0.0, 0.0)
        self.log_odds = np.zeros((0, 0), np.float32)
        self.ends = np.zeros((0, 0, 3), np.float32)
        self.freed = np.zeros((0, 0), np.bool_)
        self.further = np.zeros((0, 0), np.float32)
        self.version = 0

    @classmethod
    def of(cls, grid: OccupancyGrid, reach: float = 10.0) -> "GridMap":
        """Return a map that starts with a given grid."""
        copy = cls(grid.resolution, reach)
        copy.origin = grid.origin
        known, occupied = grid.data != UNKNOWN, grid.data > 50
        log_odds = known * np.where(occupied, _MAX_LOG_ODDS, _MIN_LOG_ODDS)
        copy.log_odds = log_odds.astype(np.float32)
        copy.ends = np.zeros((*grid.data.shape, 3), np.float32)
        copy.ends[occupied, 0] = 1.0
        copy.freed = copy.log_odds < 0.0
        copy.further = np.zeros_like(copy.log_odds)
        return copy

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.log_odds.shape
        return rows, columns

    @property
    def whole(self) -> Window:
        """The whole map as a part."""
        return Window(0, 0, *self.shape)

    def cells(self, points: Floats) -> NDArray[np.intp]:
        """Return row and column (N, 2) of points (N, 2), which may be outside of the map."""
        return np.floor((points[:, ::-1] - self.origin[::-1]) / self.resolution).astype(np.intp)

    def around(self, pose: PlanarPose, radius: float) -> Window:
        """Return the square part of the map up to ``radius``, m, from a pose."""
        [cell] = self.cells(np.array([pose[:2]])).tolist()
        return Window.around(cell, math.ceil(radius / self.resolution), self.shape)

    def middle(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Floats:
        """Return the centers (N, 2) of cells, m."""
        middles = np.stack((columns, rows), axis=1) + 0.5
        return np.asarray(middles * self.resolution + self.origin, float)

    def inside(self, cells: NDArray[np.intp]) -> Mask:
        """Return which cells (N, 2) are in the map."""
        return np.asarray(((cells >= 0) & (cells < self.shape)).all(axis=1))

    def cover(self, low: Floats, high: Floats) -> bool:
        """Grow the map to the rectangle between two corners, (2,), m; return whether it has grown.

        Raises:
            ValueError: the map would be too large.
        """
        if not self.log_odds.size:
            chunk = _CHUNK * self.resolution
            x, y = (np.floor(low / chunk) * chunk).tolist()
            self.origin = x, y
        # Whole chunks of rows and columns before the first cell, and behind the last one.
        first, last = self.cells(np.array([low, high]))
        before = np.maximum(-(first // _CHUNK), 0) * _CHUNK
        behind = np.maximum(-((self.shape - last - 1) // _CHUNK), 0) * _CHUNK
        rows, columns = (self.shape + before + behind).tolist()
        if (rows, columns) == self.shape:
            return False
        if rows * columns > _MAX_CELLS:
            raise ValueError(f"a map of {columns} x {rows} cells is too large")
        pads = list(zip(before, behind, strict=True))
        self.log_odds, self.further = np.pad(self.log_odds, pads), np.pad(self.further, pads)
        self.freed = np.pad(self.freed, pads)
        self.ends = np.pad(self.ends, [*pads, (0, 0)])
        x, y = (self.origin - before[::-1] * self.resolution).tolist()
        self.origin = x, y
        self.version += 1
        return True

    def enter(self, scan: LevelScan, points: Floats, pose: PlanarPose) -> Window:
        """Enter a scan, and return the part of the map that it may have changed.

        Args:
            scan: the scan.
            points: its end points in the robot's frame without the robot itself, (N, 2), m.
            pose: the robot's pose in the map.
        """
        sensor = pose.compose(scan.mount)
        ends = placed(points, pose)
        reach = min(self.reach, scan.reach)
        ends = ends[np.hypot(*(ends - sensor[:2]).T) <= reach]
        if not np.isposinf(scan.ranges).any():  # it clears up to the maximum measured range
            measured = scan.ranges[np.isfinite(scan.ranges)]
            reach = float(min(self.reach, measured.max(initial=0.0)))
        corners = np.concatenate((ends, np.array(sensor[:2]) + [[-reach], [reach]]))
        edge = 2.0 * self.resolution
        self.cover(corners.min(axis=0) - edge, corners.max(axis=0) + edge)
        cells = self.cells(ends)
        index = tuple(cells.T)
        log_odds, means = self.log_odds[index], self.ends[index]
        window = self._clear(scan, sensor, reach)
        self.log_odds[index], self.ends[index] = log_odds, means  # ends of rays are not cleared
        self._fill(cells, ends)
        return window

    def _clear(self, scan: LevelScan, sensor: PlanarPose, reach: float) -> Window:
        """Clear the cells in front of the ends of both adjacent rays."""
        half, window = math.ceil(reach / self.resolution), self.around(sensor, reach)
        row, column = self.cells(np.array([sensor[:2]]))[0].tolist()
        bearings, distances = _polar(half)
        at = window.moved(half - row, half - column).cells
        measured = np.nan_to_num(scan.ranges, nan=0.0, posinf=reach, neginf=0.0)
        lengths = np.minimum(measured, reach) / self.resolution - _MARGIN
        turn = round(math.tau / scan.step) == len(lengths)  # whether the rays cover a full turn
        behind = np.append(lengths[1:], lengths[0] if turn else 0.0)
        limit = np.append(np.minimum(lengths, behind), 0.0).astype(np.float32)
        offset = (sensor.yaw + scan.first_angle) % math.tau
        rays = bearings[at] - np.float32(offset)
        rays[rays < 0.0] += np.float32(math.tau)
        index = (rays * np.float32(1.0 / scan.step)).astype(np.int32)
        np.minimum(index, len(limit) - 1, out=index)
        free = distances[at] < limit[index]
        part = self.log_odds[window.cells]
        part[free] = np.maximum(part[free] + np.float32(_MISS), np.float32(_MIN_LOG_ODDS))
        cleared = free & (part < 0.0)
        self.ends[window.cells][cleared] = 0.0
        self.freed[window.cells] |= part < np.float32(_SURELY_FREE)
        return window

    def _fill(self, cells: NDArray[np.intp], ends: Floats) -> None:
        index = tuple(cells.T)
        part = np.maximum(self.log_odds[index], np.float32(0.0))
        self.log_odds[index] = np.minimum(part + np.float32(_HIT), np.float32(_MAX_LOG_ODDS))
        # Well-known walls are fixed, so that the map does not drift.
        cells, ends = (part[self.ends[index][:, 0] < _FULL] for part in (cells, ends))
        index = tuple(cells.T)
        offsets = ends - self.middle(*index)
        counted = np.concatenate((np.ones((len(ends), 1)), offsets), axis=1).astype(np.float32)
        np.add.at(self.ends, index, counted)

    def doubt(self, window: Window, cells: Mask | bool = True) -> None:
        """Doubt the obstacles in a part, or in some of its cells, until a ray ends there again.

        They stay in the map, so that scans can be matched to them.
        """
        part = self.log_odds[window.cells]
        part[(part > 0.0) & cells] = DOUBTFUL

    def moved(self) -> Mask:
        """Return the cells of what has moved, (rows, columns): once free, or beside such cells."""
        occupied = self.log_odds > DOUBTFUL
        moved = _large(self.freed & occupied)
        beside: Mask = binary_dilation(moved, iterations=_BESIDE) & occupied
        return beside

    def walls(self, near: PlanarPose | None = None, radius: float = 0.0) -> Floats:
        """Return points of walls, (N, 2), m: the mean end in each occupied cell that has not moved.

        Args:
            near: center of a square to restrict them to; None: no restriction.
            radius: half the edge of the square, m.
        """
        window = self.whole if near is None else self.around(near, radius)
        ends = self.ends[window.cells]
        occupied = self.log_odds[window.cells] > 0.0
        occupied &= ~_large(self.freed[window.cells] & occupied)
        rows, columns = np.nonzero(occupied & (ends[..., 0] > 0.0))
        chosen = ends[rows, columns].astype(float)
        means = chosen[:, 1:] / chosen[:, :1]
        return np.asarray(self.middle(rows + window.top, columns + window.left) + means)

    def occupancy(self) -> OccupancyGrid:
        """Return the current map."""
        data = np.select([self.log_odds > 0.0, self.log_odds < 0.0], [OCCUPIED, FREE], UNKNOWN)
        return OccupancyGrid(data.astype(np.int8), self.resolution, self.origin)


def _large(cells: Mask) -> Mask:
    """Return the cells without small groups, which only flicker."""
    labels, _ = label(cells, np.ones((3, 3)))
    large = np.bincount(labels.ravel(), minlength=1) > _FLICKER
    large[0] = False  # the cells without a label
    return np.asarray(large[labels])


@cache
def _polar(half: int) -> tuple[Singles, Singles]:
    """Return the bearing, rad from 0 to 2 pi, and distance, in cells, of the cells around one."""
    away = np.arange(-half, half + 1, dtype=np.float32)
    x, y = np.meshgrid(away, away)
    return np.arctan2(y, x) % np.float32(math.tau), np.hypot(x, y)
