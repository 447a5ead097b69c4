"""Matches scans to walls, to find the pose from which a scan was measured.

Each end of a ray is paired with the nearest point of a wall, and Gauss-Newton steps of the pose
minimize the distances. As in Segal, Haehnel and Thrun, "Generalized-ICP" (RSS 2009), distances
have a small weight along a wall and a large one across it, from the points around the nearest one.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from onebot_control.navigation.grid import placed
from onebot_description.arrays import Floats
from onebot_description.geometry.poses import PlanarPose

_NEIGHBORS = 6  # neighbors of a point that determine the direction of a wall
_NEAR = 0.11  # m, maximum distance of the neighbors
_STRAIGHT = 0.1  # ratio of the variances across and along a wall above which it is not straight
_FREE = 1.0  # m, standard deviation of a pair along a straight wall
_SIGMA = 0.02  # m, error of a point of a wall
_GATES = (0.5, 0.35, 0.25, 0.2, 0.15, 0.15, 0.12, 0.12)  # m, maximum distance of pairs, by step
_ROBUST = 3.0  # standard deviations above which a pair has less weight
_PAIRS = 0.5  # fraction of neighboring rays that are independent
_RAYS = 240  # rays that are matched


class Match(NamedTuple):
    """A pose that a scan was matched to."""

    pose: PlanarPose
    covariance: Floats  # (3, 3), of x, y, yaw, m and rad
    share: float  # fraction of the scan's ends that are on walls, 0 to 1


class Walls:
    """Points of walls to which scans are matched."""

    def __init__(self, points: Floats) -> None:
        """Prepare for points of walls, (N, 2), m."""
        self.points = points
        self._tree = KDTree(points) if len(points) else None
        self._weights = self._information() if len(points) else np.zeros((0, 3))

    def _information(self) -> Floats:
        """Return the inverse covariance of each point, (N, 3): xx, xy, yy, 1/m^2."""
        assert self._tree is not None
        count = min(_NEIGHBORS, len(self.points))
        distances, indices = self._tree.query(
            self.points, k=[*range(1, count + 1)], distance_upper_bound=_NEAR
        )
        is_known = np.isfinite(distances)
        around = self.points[np.where(is_known, indices, np.arange(len(self.points))[:, None])]
        offsets = (around - self.points[:, None]) * is_known[..., None]
        number = is_known.sum(axis=1)
        offsets -= (offsets.sum(axis=1) / number[:, None])[:, None] * is_known[..., None]
        xx, xy, yy = (
            (offsets[..., a] * offsets[..., b]).sum(axis=1) / number
            for a, b in ((0, 0), (0, 1), (1, 1))
        )
        # A pair contains no information along a straight wall.
        middle, half = (xx + yy) / 2.0, np.hypot((xx - yy) / 2.0, xy)
        straight = np.clip(1.0 - (middle - half) / (_STRAIGHT * (middle + half) + 1e-12), 0.0, 1.0)
        across = 1.0 / (middle - half + _SIGMA**2)
        along = 1.0 / (middle + half + _SIGMA**2 + straight * _FREE**2)
        # Cosine and sine of twice the wall's direction
        cos, sin = ((xx - yy) / 2.0, xy) / np.maximum(half, 1e-12)
        sums, differences = (along + across) / 2.0, (along - across) / 2.0
        information = sums + differences * cos, differences * sin, sums - differences * cos
        return np.stack(information, axis=1)

    def match(self, points: Floats, start: PlanarPose, prior: Floats) -> Match:
        """Return the pose near ``start`` from which ``points`` were measured.

        Args:
            points: end points of rays in the robot's frame, (N, 2), m.
            start: initial pose.
            prior: covariance (3, 3) of the initial pose, of x, y, yaw, m and rad.
        """
        information = np.linalg.inv(prior)
        if self._tree is None or len(points) < 3:
            return Match(start, prior, 0.0)
        points = points[:: math.ceil(len(points) / _RAYS)]
        pose = np.array(start)
        hessian, share = information, 0.0
        for gate in _GATES:
            ends = placed(points, PlanarPose(*pose))
            distances, indices = self._tree.query(ends, distance_upper_bound=gate)
            paired = np.isfinite(distances)
            share = float(paired.mean())
            difference = ends[paired] - self.points[indices[paired]]
            xx, xy, yy = self._weights[indices[paired]].T
            ex, ey = difference.T
            wx, wy = xx * ex + xy * ey, xy * ex + yy * ey
            weight = _PAIRS / (1.0 + (ex * wx + ey * wy) / _ROBUST**2)
            tx, ty = -(ends[paired, 1] - pose[1]), ends[paired, 0] - pose[0]
            ux, uy = xx * tx + xy * ty, xy * tx + yy * ty
            hessian = information + np.array(
                [
                    [weight @ xx, weight @ xy, weight @ ux],
                    [weight @ xy, weight @ yy, weight @ uy],
                    [weight @ ux, weight @ uy, weight @ (tx * ux + ty * uy)],
                ]
            )
            away = pose - start
            gradient = information @ away + np.array(
                [weight @ wx, weight @ wy, weight @ (tx * wx + ty * wy)]
            )
            step = np.linalg.solve(hessian, gradient)
            pose = pose - step
            if gate <= _GATES[2] and np.abs(step).max() < 1e-4:
                break
        x, y, yaw = pose.tolist()
        return Match(PlanarPose(x, y, yaw), np.linalg.inv(hessian), share)
