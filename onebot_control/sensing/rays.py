"""Casts rays at fixed and moving surfaces and at level ground, and finds the nearest hits.

Embree is called directly, as trimesh's wrapper takes several times as long. Nothing is rebuilt when
bodies move, because rays are transformed into the frame of each body. Without Embree, PyBullet
casts the rays.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib.util import find_spec
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_control.sensing.solids import Integers, Solid
from onebot_description.arrays import Floats, Singles

HAS_EMBREE = find_spec("embreex") is not None  # some processors have no wheel
NOTHING, GROUND = -2, -1  # instead of the index of a surface
# (minimum number of rays, rays per bundle). Smaller bundles select fewer rays, but take longer to
# test.
_BUNDLES = ((50_000, 64), (200, 8), (0, 1))
_RAYS_A_CALL = 16_000  # PyBullet's limit


class Cones(NamedTuple):
    """Cones around bundles of rays from one point."""

    axes: Floats  # (C, 3), unit vectors
    cosines: Floats  # (C,), of the half angles
    sines: Floats  # (C,), of the half angles
    wide: NDArray[np.bool_]  # (C,), whether the half angle is above 90 degrees

    @classmethod
    def around(cls, units: Floats, size: int) -> "Cones":
        """Return the cones around each ``size`` consecutive directions (N, 3)."""
        starts = np.arange(0, len(units), size)
        axes = np.add.reduceat(units, starts)
        axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
        cosines = (units * np.repeat(axes, size, axis=0)[: len(units)]).sum(axis=1)
        halves = np.arccos(np.clip(np.minimum.reduceat(cosines, starts), -1.0, 1.0)) + 1e-6
        return cls(axes, np.cos(halves), np.sin(halves), halves > np.pi / 2)

    def touched(self, centers: Floats, radii: Floats) -> NDArray[np.bool_]:
        """Return which cones touch which spheres, (B, C), of centers (B, 3) and radii (B,)."""
        apart = np.sqrt((centers * centers).sum(axis=1))
        outside = np.maximum(apart, 1e-9)
        sines = np.minimum(1.0, radii / outside)
        cosines = np.sqrt(1.0 - sines * sines)
        # They touch if the center is within the angle a + b of the axis, with the half angles a of
        # the sphere and b of the cone; cos(a + b) is compared.
        limits = (outside * cosines)[:, None] * self.cosines
        limits -= (outside * sines)[:, None] * self.sines
        overlaps: NDArray[np.bool_] = centers @ self.axes.T >= limits
        overlaps |= self.wide
        overlaps |= (apart <= radii)[:, None]
        return overlaps

    def leaving(self, starts: Floats, turns: Floats, boxes: Floats) -> NDArray[np.bool_]:
        """Return which cones cannot hit which boxes, (B, C), because they point away from them.

        Args:
            starts: (B, 3), the cones' apex in the boxes' frames.
            turns: (B, 3, 3), rotations from the cones' frame to the boxes' frames.
            boxes: (B, 2, 3), minimum and maximum corners.
        """
        axes = self.axes @ turns.transpose(0, 2, 1)
        sides = np.subtract(starts > boxes[:, 1], starts < boxes[:, 0], dtype=float)
        away: NDArray[np.bool_] = sides[:, None] * axes > self.sines[:, None]
        return away.any(axis=2) & ~self.wide


class Rays:
    """The rays of a sensor, from one point, in the sensor's frame.

    Neighboring rays are bundled, so that only rays that may hit a surface are cast at it.

    Attributes:
        singles: the directions (N, 3); distances along a ray are in units of its length.
        inverse_lengths: (N,), one over their lengths.
        bundles: cones around neighboring rays.
    """

    def __init__(self, directions: Floats) -> None:
        """Bundle rays with directions (N, 3), row by row."""
        self.singles = directions.astype(np.float32)
        self._count = count = len(directions)
        self._size = next(size for minimum, size in _BUNDLES if count >= minimum)
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        self._longest = float(lengths.max())
        self.inverse_lengths = (1.0 / lengths[:, 0]).astype(np.float32)
        self._all = Cones.around(directions / lengths, count)
        self.bundles = Cones.around(directions / lengths, self._size)

    def turned(self, rotation: Floats) -> Singles:
        """Return the directions (N, 3), rotated by ``rotation`` (3, 3)."""
        directions: Singles = self.singles @ rotation.T.astype(np.float32)
        return directions

    def near(self, centers: Floats, radii: Floats, reach: float) -> NDArray[np.bool_]:
        """Return which bundles may hit which spheres within ``reach``, (B, bundles).

        Args:
            centers: (B, 3), in the rays' frame.
            radii: (B,), m.
            reach: maximum distance, in lengths of the directions.
        """
        is_near = self.nearest(centers, radii) <= reach
        if not self._all.wide[0]:
            is_near &= self._all.touched(centers, radii)[:, 0]
        overlaps = np.zeros((len(centers), len(self.bundles.axes)), bool)
        overlaps[is_near] = self.bundles.touched(centers[is_near], radii[is_near])
        return overlaps

    def nearest(self, centers: Floats, radii: Floats) -> Singles:
        """Return the minimum distances (B,) at which rays can hit spheres; see ``near``."""
        distances: Floats = np.sqrt((centers * centers).sum(axis=1)) - radii
        return (distances / self._longest).astype(np.float32)

    def pairs(self, bundles: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the rays (P,) of the selected bundles (B, bundles), and the row in B of each."""
        targets, starts = bundles.nonzero()
        rows = (starts[:, None] * self._size + np.arange(self._size)).ravel()
        targets = targets.repeat(self._size)
        if self._count % self._size:
            is_target = rows < self._count
            rows, targets = rows[is_target], targets[is_target]
        return rows, targets


class Hits(NamedTuple):
    """The first hits of N rays."""

    distances: Singles  # (N,), in lengths of the directions; the reach where nothing is hit
    surfaces: NDArray[np.int16]  # (N,), index of the surface, or NOTHING or GROUND
    faces: Integers  # (N,), index of the face in that surface
    second: Singles  # (N,), barycentric coordinate of the face's second corner
    third: Singles  # (N,), barycentric coordinate of the face's third corner
    directions: Singles  # (N, 3), in the world

    def within(self, minimum: float, maximum: float, measured: Singles) -> Singles:
        """Return the ``measured`` distances (N,) of hits in range (REP-117).

        Distances beyond the maximum are infinite, distances below the minimum are minus infinity.
        """
        far = (self.surfaces == NOTHING) | (self.distances > np.float32(maximum))
        result = np.where(far, np.float32(np.inf), measured)
        result[self.distances < np.float32(minimum)] = -np.inf
        return result


class Targets(NamedTuple):
    """Moving surfaces at their poses in the world."""

    surfaces: Sequence["Surface"]
    alike: Mapping["Surface", NDArray[np.intp]]  # the rows that share a surface
    rotations: Floats  # (B, 3, 3)
    positions: Floats  # (B, 3)
    centers: Floats  # (B, 3), of spheres around them
    radii: Floats  # (B,)
    boxes: Floats  # (B, 2, 3), minimum and maximum corner around them, in their frames


def cast(
    rays: Rays,
    rotation: Floats,
    position: Floats,
    still: "Surface",
    targets: Targets,
    reach: float,
    skipped: Sequence[int] = (),
) -> Hits:
    """Return the first hits of a sensor's rays.

    Args:
        rays: rays of the sensor.
        rotation: (3, 3), of the sensor in the world.
        position: (3,), of the sensor in the world, m.
        still: all fixed surfaces, in the world's frame; their index is 0.
        targets: all movable surfaces; their indices start at 1.
        reach: maximum distance, in lengths of the directions.
        skipped: indices of targets that cannot be hit; NOTHING is ignored.
    """
    directions = rays.turned(rotation)
    limit, surfaces = _ground(directions[:, 2], position[2], reach)
    # All rays share one origin, with a stride of 0 instead of copies.
    origins = np.ndarray(directions.shape, np.float32, position.astype(np.float32), 0, (0, 4))
    still_faces = still.cast(origins, directions, limit)
    surfaces[still_faces.faces >= 0] = 0
    hits = Hits(limit, surfaces, *still_faces, directions)
    if not targets.surfaces:
        return hits
    centers = (targets.centers - position) @ rotation
    near_rays = rays.near(centers, targets.radii, reach)
    for index in skipped:
        if index != NOTHING:
            near_rays[index - 1] = False
    if not near_rays.any():
        return hits
    nearest = rays.nearest(centers, targets.radii)
    back = targets.rotations.transpose(0, 2, 1)
    starts = np.einsum("bij,bj->bi", back, position - targets.positions)
    turns = back @ rotation
    around = np.flatnonzero(nearest < 0.0)  # spheres that contain the sensor
    near_rays[around] &= ~rays.bundles.leaving(starts[around], turns[around], targets.boxes[around])
    is_near = np.any(near_rays, axis=1)
    starts, turns = starts.astype(np.float32), turns.astype(np.float32)
    # Cast once for all targets with the same surface: in a fleet, there may be hundreds.
    for surface, group in targets.alike.items():
        kind = group[is_near[group]]
        if not len(kind):
            continue
        rows, members = rays.pairs(near_rays[kind])
        indices = kind[members]
        ahead = limit[rows] > nearest[indices]  # skip rays that hit something nearer
        rows, indices = rows[ahead], indices[ahead]
        if not len(rows):
            continue
        directions_there = rays.singles[rows]
        if len(kind) == 1:
            directions_there = directions_there @ turns[kind[0]].T
        else:
            directions_there = np.einsum("pij,pj->pi", turns[indices], directions_there)
        distances = limit[rows]
        target_faces = surface.cast(starts[indices], directions_there, distances)
        hit = np.flatnonzero(target_faces.faces >= 0)
        hit = hit[np.argsort(-distances[hit], kind="stable")]  # a ray's nearest hit is stored last
        rows = rows[hit]
        limit[rows], surfaces[rows] = distances[hit], indices[hit] + 1
        for values, new in zip((hits.faces, hits.second, hits.third), target_faces, strict=True):
            values[rows] = new[hit]
    return hits


def _ground(upwards: Singles, height: float, reach: float) -> tuple[Singles, NDArray[np.int16]]:
    """Return distances (N,) to the ground, up to the reach, and GROUND or NOTHING (N,).

    Args:
        upwards: (N,), z of the directions.
        height: height of the rays' origin, m.
        reach: maximum distance, in lengths of the directions.
    """
    if height <= 0.0:
        full = np.full(len(upwards), reach, np.float32)
        return full, np.full(len(upwards), NOTHING, np.int16)
    # Compare inverse distances, which are also finite for level rays.
    inverse = upwards * np.float32(-1.0 / height)
    hit = inverse > np.float32(1.0 / reach)
    np.maximum(inverse, np.float32(1.0 / reach), out=inverse)
    return np.reciprocal(inverse), np.subtract(hit, 2, dtype=np.int16)


class _Found(NamedTuple):
    faces: Integers  # (N,); -1 for no hit
    second: Singles  # (N,), as in Hits
    third: Singles


class _Caster(Protocol):
    """The part of EmbreeScene that is used."""

    def run(
        self, origins: Singles, directions: Singles, dists: Singles, output: bool
    ) -> dict[str, Any]:
        """Return "primID" (-1: a miss), "u" and "v"; shorten ``dists`` to the hits."""


class Surface:
    """A solid, prepared for casting rays at it."""

    def __init__(self, solid: Solid) -> None:
        self.solid = solid

    @cached_property
    def _caster(self) -> _Caster | None:
        """Embree's or PyBullet's scene of the solid, built when the first ray may hit it."""
        if not len(self.solid.faces):
            return None
        return _embree(self.solid) if HAS_EMBREE else _BulletRays(self.solid)

    @cached_property
    def normals(self) -> Singles:
        """Unit normals (F, 3) of the faces."""
        a, b, c = self.solid.corners[self.solid.faces].transpose(1, 0, 2)
        across: Singles = np.cross(b - a, c - a)
        lengths = np.linalg.norm(across, axis=1, keepdims=True)
        unit: Singles = across / np.where(lengths > 0.0, lengths, np.float32(1.0))
        return unit

    def cast(self, origins: Singles, directions: Singles, distances: Singles) -> _Found:
        """Return the faces that rays hit.

        Args:
            origins: (N, 3), in the solid's frame.
            directions: (N, 3), in the solid's frame.
            distances: (N,), maximum distances, in lengths of the directions; replaced by the hits'.
        """
        if self._caster is None:
            none = np.zeros(len(directions), np.float32)
            return _Found(np.full(len(directions), -1, np.int32), none, none.copy())
        hits = self._caster.run(origins, directions, dists=distances, output=True)
        return _Found(hits["primID"], hits["u"], hits["v"])


def _embree(solid: Solid) -> _Caster:
    # Imported late, because most robots have no sensors.
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, solid.corners, solid.faces)
    caster: _Caster = scene
    return caster


class _BulletRays:
    """Casts rays with PyBullet, which takes 20 times as long and does not report the hit face."""

    def __init__(self, solid: Solid) -> None:
        from onebot_control.physics.engine import Bullet, engine

        self._bullet = Bullet()
        shape = self._bullet.createCollisionShape(
            engine.GEOM_MESH,
            vertices=solid.corners.tolist(),
            indices=solid.faces.ravel().tolist(),
            flags=engine.GEOM_FORCE_CONCAVE_TRIMESH,
        )
        self._bullet.createMultiBody(0, shape)

    def run(
        self, origins: Singles, directions: Singles, dists: Singles, output: bool
    ) -> dict[str, Any]:
        ends = origins + directions * dists[:, None]
        fractions: list[float] = []
        for start in range(0, len(ends), _RAYS_A_CALL):
            part = slice(start, start + _RAYS_A_CALL)
            results = self._bullet.rayTestBatch(origins[part].tolist(), ends[part].tolist())
            fractions += [result[2] if result[0] >= 0 else math.inf for result in results]
        hit = np.isfinite(fractions)
        dists[hit] *= np.array(fractions, np.float32)[hit]
        nowhere = np.zeros(len(ends), np.float32)
        return {"primID": np.where(hit, 0, -1).astype(np.int32), "u": nowhere, "v": nowhere}
