"""Creates the occupancy grid of a scene at some height from its collision shapes."""

import math
from collections.abc import Sequence
from contextlib import closing
from functools import cache

import numpy as np

from onebot_control.occupancy_grid import OCCUPIED, OccupancyGrid
from onebot_control.physics.engine import Bullet, engine
from onebot_control.physics.scene import SceneBodies
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Transform

_FLAT = 1e-4  # m, height of the box that probes cells
_INSIDE = 1e-6  # m, minimum overlap of an occupied cell
_EDGE = 1e-6  # the same, in cells
_MARGIN = 0.001  # m by which PyBullet's bounding boxes are larger
_MAX_CELLS = 100_000_000


def occupancy_grid(
    scene: Description | None,
    boxes: Sequence[Transform],
    resolution: float,
    height: float,
    bounds: Sequence[float] | None,
) -> OccupancyGrid:
    """Return the grid of the cells that fixed bodies and boxes of a scene reach into.

    Args:
        scene: the scene; None for bare ground.
        boxes: poses of its movable boxes.
        resolution: edge of a cell, m.
        height: height of the grid, m.
        bounds: minimum x, minimum y, maximum x and maximum y, m; None: around these bodies.

    Raises:
        OneBotError: there is nothing at that height, and there are no bounds; or there would be
            too many cells.
    """
    with closing(Bullet()) as bullet:
        bodies: list[int] = []
        if scene is not None:
            loaded = SceneBodies(scene)
            bullet.set_up()
            loaded.enter(bullet)
            loaded.put(boxes)
            bullet.performCollisionDetection()
            bodies = [index for index, _, _ in loaded.bodies()]
        corners = np.array([bullet.getAABB(body) for body in bodies]).reshape(-1, 2, 3)
        reach = (corners[:, 0, 2] <= height) & (corners[:, 1, 2] >= height)
        if bounds is None:
            if not reach.any():
                raise OneBotError(f"nothing stands at a height of {height:g} m; give bounds=...")
            around = corners[reach, 0, :2].min(axis=0), corners[reach, 1, :2].max(axis=0)
            around = around[0] + _MARGIN, around[1] - _MARGIN
            # Corners of cells are at multiples of the resolution.
            bounds = (*(np.floor(around[0] / resolution + _EDGE) * resolution), *around[1])
        columns, rows = (
            max(1, math.ceil((high - low) / resolution - _EDGE))
            for low, high in zip(bounds[:2], bounds[2:], strict=True)
        )
        if columns * rows > _MAX_CELLS:
            raise OneBotError(f"{columns} x {rows} cells are too many; take a larger resolution")
        data = np.zeros((rows, columns), np.int8)
        x, y = float(bounds[0]), float(bounds[1])

        @cache
        def probe(wide: int, long: int) -> int:
            halves = wide * resolution / 2.0, long * resolution / 2.0, _FLAT / 2.0
            shape: int = bullet.createCollisionShape(engine.GEOM_BOX, halfExtents=halves)
            return shape

        blocks = [(body, 0, 0, columns, rows) for body in np.array(bodies)[reach].tolist()]
        while blocks:
            body, left, low, wide, long = blocks.pop()
            middle = x + resolution * (left + wide / 2.0), y + resolution * (low + long / 2.0)
            points = bullet.getClosestPoints(
                bodyA=body,
                bodyB=-1,
                distance=0.0,
                collisionShapeB=probe(wide, long),
                collisionShapePositionB=(*middle, height),
            )
            if not any(point[8] < -_INSIDE for point in points):
                continue
            if wide == long == 1:
                data[low, left] = OCCUPIED
                continue
            # The body reaches into the block: split the block along its longer side.
            right, top = (wide // 2, 0) if wide >= long else (0, long // 2)
            blocks.append((body, left, low, right or wide, top or long))
            blocks.append((body, left + right, low + top, wide - right, long - top))
    return OccupancyGrid(data, resolution, (x, y))
