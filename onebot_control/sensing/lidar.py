"""Measures with lidars: their rays, ranges and points."""

from collections.abc import Sequence, Set
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.clouds import cloud_of, finite, point_layout
from onebot_control.sensing.instrument import Instrument, SensedWorld
from onebot_control.sensing.noise import add_noise
from onebot_control.sensing.rays import Hits, Rays
from onebot_description.arrays import Floats, Singles
from onebot_description.description.sensors.lidar import Fan, Lidar
from onebot_description.description.sensors.noise import Noise

_MARGIN = 1e-4  # m; a range that rounding raises above the maximum is still measured


def angles(fan: Fan) -> Floats:
    """Return the angles (N,) of a fan's rays, rad."""
    if fan.samples == 1:
        return np.array([fan.lower])
    return np.linspace(fan.lower, fan.upper, fan.samples)


def lidar_rays(lidar: Lidar) -> Rays:
    """Return the rays of a lidar, row by row from the lowest, each from its minimum angle on."""
    up, across = np.meshgrid(angles(lidar.vertical), angles(lidar.horizontal), indexing="ij")
    flat = np.cos(up)
    directions = np.stack([flat * np.cos(across), flat * np.sin(across), np.sin(up)], axis=-1)
    return Rays(directions.reshape(-1, 3))


def reach(lidar: Lidar) -> float:
    """Return the length of a lidar's rays, m."""
    return lidar.range_max + _MARGIN


def ranges(
    lidar: Lidar,
    hits: Hits,
    offset: float = 0.0,
    generator: "np.random.Generator | None" = None,
) -> Singles:
    """Return the measured ranges (N,), m (REP-117).

    Ranges beyond the maximum are infinite, ranges below the minimum are minus infinity.

    Args:
        lidar: the sensor.
        hits: hits of its rays.
        offset: offset of all ranges, m; see ``noise.bias``.
        generator: generator of the noise; None for no noise.
    """
    measured = hits.distances
    if generator is not None:
        # Noise does not move ranges into or out of the sensor's range.
        measured = add_noise(measured, lidar.noise, offset, generator)
        measured = np.clip(measured, np.float32(lidar.range_min), np.float32(lidar.range_max))
    return hits.within(lidar.range_min, lidar.range_max, measured)


POINT = point_layout(("intensity", "<f4", 16), ("ring", "<u2", 20))
"""Layout of a point in a lidar's cloud."""


def cloud(
    lidar: Lidar, rays: Rays, all_ranges: Singles, pose: tuple[Floats, Floats]
) -> NDArray[np.void]:
    """Return the point cloud of a lidar, (rows, columns) of POINT.

    Args:
        lidar: the sensor; if its clouds are not organized, only finite points are returned (1, N).
        rays: N rays, in the lidar's frame.
        all_ranges: (N,), m; ranges that are not finite give infinite points.
        pose: rotation (3, 3) and position (3,) of the lidar in the frame of the points.
    """
    points = cloud_of(POINT, lidar.rays, rays, all_ranges, pose)
    points["ring"] = np.arange(len(points))[:, None]
    return points if lidar.is_organized else finite(points)


class LidarInstrument(Instrument[Lidar]):
    """Measures with a lidar: a scan, the nearest range, or a cloud."""

    waiting = 4

    @cached_property
    def _rays(self) -> Rays:
        return lidar_rays(self.model)

    @property
    def noises(self) -> Sequence[Noise]:
        return [self.model.noise]

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        lidar, pose, generator = self.model, self.pose(world.placed), self.generator(world.frame)
        hits = self.hits(world, pose, self._rays, lidar.range_min, reach(lidar))
        measured = ranges(lidar, hits, self.offsets[0], generator)
        outputs = dict[str, Any]()
        if "scan" in wanted:
            rows = lidar.vertical.samples
            outputs["scan"] = measured.reshape(rows, -1)[rows // 2]  # middle row; of two, the upper
        if "range" in wanted:
            outputs["range"] = measured.min()
        for output in wanted & {"points", "point_cloud"}:
            seen_from = self.seen_from(world, pose, np.eye(3))
            outputs[output] = cloud(lidar, self._rays, measured, seen_from)
        return outputs
