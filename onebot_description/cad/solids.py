"""Functions for the solids that parts are made of (m, z up), and for their mass."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import trimesh
from manifold3d import CrossSection, FillRule, JoinType, Manifold, OpType

from onebot_description.geometry.poses import Triple
from onebot_description.model.rigid_bodies import Body

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Part:
    """One link of the robot, in the frame of that link."""

    name: str  # meshes/<name>.dae
    seen: dict[str, Manifold]  # keys: materials
    inertial: Body


def weigh(solids: Iterable[tuple[str, Manifold]], densities: SimpleNamespace) -> Body:
    """Return the total mass, center and inertia of solids, each with its material's density."""
    body = Body("")
    for material, solid in solids:
        mesh = skin(solid)
        mesh.density = getattr(densities, material)
        body.add_mass(float(mesh.mass), mesh.center_mass, mesh.moment_inertia)
    return body


def skin(solid: Manifold) -> trimesh.Trimesh:
    """Return a solid's triangles."""
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)


def box(low: Triple, high: Triple) -> Manifold:
    """Return the box from one corner to the opposite one."""
    return Manifold.cube(np.subtract(high, low)).translate(low)


def lathe(radius: float, height: float, shares: Points, segments: int = 40) -> Manifold:
    """Turn a closed profile about z; its points are shares of ``radius`` and ``height``."""
    points = np.array(shares) * (radius, height)
    return Manifold.revolve(CrossSection([points], FillRule.EvenOdd), segments)


def ring(inner: float, outer: float, half: float, shares: Points, segments: int = 40) -> Manifold:
    """Turn a profile that is symmetric about z = 0.

    Its upper points are ``shares`` of the way from ``inner`` to ``outer`` radius, and of ``half``
    its width.
    """
    upper = [(inner + share * (outer - inner), half * z) for share, z in shares]
    return lathe(1.0, 1.0, upper + [(radius, -z) for radius, z in reversed(upper)], segments)


def rod_y(radius: float, length: float, segments: int = 48) -> Manifold:
    """Return the cylinder about the y axis whose middle is the origin."""
    return Manifold.cylinder(length, radius, -1.0, segments, True).rotate((90.0, 0.0, 0.0))


def round_rectangle(width: float, height: float, radius: float) -> CrossSection:
    """Return a rectangle about the origin with round corners."""
    inner = CrossSection.square((width - 2 * radius, height - 2 * radius), True)
    return inner.offset(radius, JoinType.Round, circular_segments=20)


def prism_x(section: CrossSection, low: float, high: float) -> Manifold:
    """Extrude a section (y to the left, z up) from x = low to x = high."""
    return Manifold.extrude(section, high - low).rotate((90.0, 0.0, 90.0)).translate((low, 0, 0))


def union(solids: Iterable[Manifold]) -> Manifold:
    """Return the solids as one."""
    return Manifold.batch_boolean(list(solids), OpType.Add)


def around(solid: Manifold, count: int, start: float = 0.0) -> Manifold:
    """Repeat a solid about z, beginning at ``start``, a share of one step."""
    step = 360.0 / count
    return union(solid.rotate((0.0, 0.0, (start + index) * step)) for index in range(count))
