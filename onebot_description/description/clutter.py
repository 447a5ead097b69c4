"""Generates cluttered worlds for navigation, each from a seed.

A grid is filled at random and smoothed by a cellular automaton: a cell is filled if most of its
neighbors are, and cleared if hardly any is. A grid that a robot could not cross is drawn again
(Perille, Truong, Xiao and Stone, "Benchmarking Metric Ground Navigation", SSRR 2020).

``python -m onebot_description.description.clutter seed=7`` prints how difficult a world is.

Example:
    >>> world = clutter(ClutterParameters(seed=7))
    >>> world.goal
    (8.5, 0.0)
"""

import math
import sys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import yaml
from scipy.ndimage import convolve
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError, Problem, parameter, read

NAME = "clutter"
_CELL = 0.15  # m; a filled cell is a cylinder of this diameter
_HEIGHT = 0.6  # m
_ROOM = 2.0  # m of free space before and behind the field
_STEP = 0.05  # m; resolution of the path search
_SMOOTHED = 3  # times
_FILLED, _CLEARED = 5, 1  # at least so many filled neighbors fill a cell; at most so many clear it
_TRIES = 30
_WALL = 0.1  # m


@dataclass(frozen=True)
class ClutterParameters:
    """Parameters of a cluttered world."""

    seed: int = parameter(0, "which world", at_least=0, at_most=2**63 - 1)
    density: float = parameter(0.25, "initial share of filled cells", at_least=0.0, at_most=0.4)
    size: float = parameter(4.5, "edge of the field, m", at_least=1.5, at_most=30.0)
    radius: float = parameter(0.25, "robot radius that fits through, m", at_least=0.05, at_most=1.0)


class Clutter(NamedTuple):
    """A cluttered world; a robot begins at its origin, heading along x."""

    urdf: str
    goal: tuple[float, float]  # beyond the field, m
    length: float  # length of the shortest path to the goal, m
    clearance: float  # mean distance of that path's points to the nearest obstacle, m
    cylinders: Floats  # (N, 2), their centers, m

    @property
    def difficulty(self) -> str:
        """How difficult it is, in words."""
        x, y = self.goal
        return (
            f"{len(self.cylinders)} cylinders; the goal is at {x:g}, {y:g}; the shortest path is "
            f"{self.length:.2f} m long, on average {self.clearance:.2f} m from obstacles"
        )


def parameters_of(name: str) -> ClutterParameters:
    """Return the parameters in a name such as ``clutter:seed=7,density=0.25``, or ``clutter:7``.

    Raises:
        ConfigError: one is wrong; the text says what would be right.
    """
    values = {}
    for part in filter(None, name.partition(":")[2].split(",")):
        key, equals, value = part.partition("=")
        try:
            values[key if equals else "seed"] = yaml.safe_load(value if equals else key)
        except yaml.YAMLError:
            raise ConfigError([Problem(key, f'"{value}" is no number')]) from None
    return read(ClutterParameters, values)


def clutter(parameters: ClutterParameters) -> Clutter:
    """Return the world.

    Raises:
        OneBotError: it is so dense that no robot of this radius can cross it.
    """
    cells = round(parameters.size / _CELL)
    for attempt in range(_TRIES):
        generator = np.random.default_rng([parameters.seed, attempt])
        filled = generator.random((cells, cells)) < parameters.density
        for _ in range(_SMOOTHED):
            around = convolve(filled.astype(int), np.ones((3, 3), int), mode="constant") - filled
            filled = (around >= _FILLED) | (filled & (around > _CLEARED))
        rows, columns = np.nonzero(filled)
        half = cells * _CELL / 2.0
        x, y = _ROOM + (columns + 0.5) * _CELL, (rows + 0.5) * _CELL - half
        cylinders = np.stack((x, y), axis=1)
        end = cells * _CELL + 2.0 * _ROOM
        path = _shortest_path(cylinders, end, half, parameters.radius)
        if path is not None:
            urdf = _urdf(parameters.seed, cylinders, end, half)
            return Clutter(urdf, (end, 0.0), *path, cylinders)
    raise OneBotError(
        f"{NAME}: no robot of radius {parameters.radius:g} m can cross such worlds; "
        "write a smaller density or radius"
    )


def _shortest_path(
    cylinders: Floats, end: float, half: float, radius: float
) -> tuple[float, float] | None:
    """Return length and mean clearance, m, of the shortest path from 0, 0 to the goal, if any."""
    x, y = np.arange(0.0, end + _STEP / 2.0, _STEP), np.arange(-half, half + _STEP / 2.0, _STEP)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    away, _ = KDTree(cylinders).query(points)
    free = np.minimum(half - np.abs(points[:, 1]), away - _CELL / 2.0)
    points, free = points[free >= radius], free[free >= radius]
    if not len(points):
        return None
    tree = KDTree(points)
    neighbors = tree.sparse_distance_matrix(tree, 1.5 * _STEP, output_type="coo_matrix")
    _, (start, goal) = tree.query([(0.0, 0.0), (end, 0.0)])
    lengths, previous = dijkstra(neighbors, indices=start, return_predecessors=True)
    if math.isinf(lengths[goal]):
        return None
    cells = [goal]
    while cells[-1] != start:
        cells.append(previous[cells[-1]])
    return float(lengths[goal]), float(free[cells].mean())


def _urdf(seed: int, cylinders: Floats, end: float, half: float) -> str:
    shapes = [
        (f"{x:.4g} {y:.4g}", f'<cylinder radius="{_CELL / 2.0}" length="{_HEIGHT}"/>')
        for x, y in cylinders.tolist()
    ]
    length, middle, side = end + _ROOM + 2.0 * _WALL, end / 2.0, half + _WALL / 2.0
    for sign in (-1.0, 1.0):
        along = f'<box size="{length:.4g} {_WALL} {_HEIGHT}"/>'
        across = f'<box size="{_WALL} {2.0 * half:.4g} {_HEIGHT}"/>'
        at = middle + sign * (length - _WALL) / 2.0
        shapes += [(f"{middle:.4g} {sign * side:.4g}", along), (f"{at:.4g} 0", across)]
    parts = [
        f'<{kind}><origin xyz="{at} {_HEIGHT / 2.0}"/><geometry>{shape}</geometry></{kind}>'
        for kind in ("visual", "collision")
        for at, shape in shapes
    ]
    return (
        f'<robot name="{NAME}_{seed}"><link name="world"/><link name="obstacles">{"".join(parts)}'
        '</link><joint name="world_to_obstacles" type="fixed"><parent link="world"/>'
        '<child link="obstacles"/></joint></robot>'
    )


if __name__ == "__main__":
    try:
        print(clutter(parameters_of(f"{NAME}:{','.join(sys.argv[1:])}")).difficulty)
    except OneBotError as error:
        sys.exit(str(error))
