"""Solids that manifold3d lacks (m, z up), and parts: their shapes by material and their mass."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import CrossSection, FillRule, Manifold, Mesh64
from numpy.typing import NDArray

from onebot_description.geometry.poses import Triple
from onebot_description.model.rigid_bodies import Body

Points = Sequence[tuple[float, float]]


def loft(sections: NDArray[np.float64]) -> Manifold:
    """Return the solid whose skin joins closed sections.

    Args:
        sections: (S, P, 3). Seen along the way from the first section to the last, the points run
            clockwise. The first and the last section shall be flat; they are closed by fans.
    """
    count, size, _ = sections.shape
    ends = [sections[0].mean(axis=0), sections[-1].mean(axis=0)]
    points = np.concatenate([sections.reshape(-1, 3), ends])
    ring = np.arange(size)
    successor = (ring + 1) % size
    faces = []
    for step in range(count - 1):
        low, high = step * size, (step + 1) * size
        faces.append(np.column_stack([low + ring, high + ring, low + successor]))
        faces.append(np.column_stack([low + successor, high + ring, high + successor]))
    first, last = count * size, count * size + 1
    top = (count - 1) * size
    faces.append(np.column_stack([np.full(size, first), ring, successor]))
    faces.append(np.column_stack([np.full(size, last), top + successor, top + ring]))
    return _solid(points, np.concatenate(faces))


def _solid(points: NDArray[np.float64], faces: NDArray[np.int64]) -> Manifold:
    unique, index = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    proper = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    skin = Mesh64(np.ascontiguousarray(unique), np.ascontiguousarray(faces[proper], np.uint64))
    solid = Manifold(skin)
    if solid.is_empty():
        raise ValueError(f"the loft is no solid: {solid.status()}")
    return solid if solid.volume() > 0 else _solid(unique, faces[:, ::-1])


def lathe(profile: Points, segments: int) -> Manifold:
    """Turn a closed profile of (radius, height) about z."""
    return Manifold.revolve(outline(profile), segments)


def outline(points: Points) -> CrossSection:
    """Return the area inside a closed line, whichever way round it is given."""
    return CrossSection([np.array(points, float)], FillRule.EvenOdd)


def lathe_y(profile: Points, segments: int) -> Manifold:
    """Turn a closed profile of (radius, y) about the y axis."""
    return lathe(profile, segments).rotate((-90.0, 0.0, 0.0))


def box(low: Triple, high: Triple) -> Manifold:
    """Return the box from one corner to the opposite one."""
    size = np.subtract(high, low)
    return Manifold.cube((float(size[0]), float(size[1]), float(size[2]))).translate(low)


def rounded_rectangle(width: float, height: float, radius: float, steps: int = 6) -> CrossSection:
    """Return a rectangle about the origin with round corners."""
    inner = CrossSection.square((width - 2 * radius, height - 2 * radius), center=True)
    corner = CrossSection.circle(radius, 4 * steps)
    shift_x, shift_y = width / 2 - radius, height / 2 - radius
    corners = [corner.translate((x, y)) for x in (-shift_x, shift_x) for y in (-shift_y, shift_y)]
    return CrossSection.batch_hull([inner, *corners])


def prism_x(
    section: CrossSection, low: float, high: float, center: tuple[float, float]
) -> Manifold:
    """Extrude a section (y to the left, z up, about ``center``) from x = low to x = high."""
    solid = Manifold.extrude(section, high - low).rotate((90.0, 0.0, 90.0))
    return solid.translate((low, center[0], center[1]))


def prism_z(
    section: CrossSection, low: float, high: float, center: tuple[float, float]
) -> Manifold:
    """Extrude a section (x, y about ``center``) from z = low to z = high."""
    return Manifold.extrude(section, high - low).translate((center[0], center[1], low))


def cylinder_y(radius: float, low: float, high: float, segments: int = 48) -> Manifold:
    """Return the cylinder about the y axis from y = low to y = high."""
    solid = Manifold.cylinder(high - low, radius, circular_segments=segments)
    return solid.rotate((-90.0, 0.0, 0.0)).translate((0.0, low, 0.0))


def tube(path: NDArray[np.float64], across: Triple, width: float, height: float) -> Manifold:
    """Sweep an ellipse along a path.

    Args:
        path: (S, 3).
        across: unit vector at right angles to the whole path; the ellipse's ``width`` lies there.
        width: full width, metres.
        height: full height, metres, at right angles to both.
    """
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.asarray(across)
    up = np.cross(tangents, side)
    angle = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    sections = (
        path[:, None]
        + np.cos(angle)[None, :, None] * side * width / 2
        + np.sin(angle)[None, :, None] * up[:, None] * height / 2
    )
    return loft(sections)


@dataclass(frozen=True)
class MassProperties:
    """Mass, centre of mass and inertia of a part, in the part's frame."""

    mass: float  # kg
    center: NDArray[np.float64]  # (3,), m
    inertia: NDArray[np.float64]  # (3, 3) about the centre, along the frame's axes, kg m2


@dataclass(frozen=True)
class Part:
    """One link of the robot, in the frame of that link."""

    name: str  # meshes/<name>.dae
    seen: tuple[tuple[str, Manifold], ...]  # material and solid, in drawing order
    inertial: MassProperties  # all solids with a mass
    # Returns which of (N, 3) points are inside the part and never visible.
    hidden: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None


def to_mesh(solid: Manifold) -> trimesh.Trimesh:
    """Return a solid's skin."""
    mesh = solid.to_mesh64()
    points = np.array(mesh.vert_properties, float)[:, :3]
    return trimesh.Trimesh(points, np.array(mesh.tri_verts, np.int64), process=False)


def weigh(solid: Manifold, density: float) -> MassProperties:
    """Return the mass properties of a homogeneous solid; density in kg/m3."""
    mesh = to_mesh(solid)
    mesh.density = density
    properties = mesh.mass_properties
    center = np.asarray(properties.center_mass, float)
    return MassProperties(float(properties.mass), center, np.asarray(properties.inertia, float))


def weigh_box(mass: float, center: NDArray[np.float64], size: Triple) -> MassProperties:
    """Return the mass properties of a homogeneous box along the axes."""
    squares = np.square(size)
    return MassProperties(mass, center, np.diag(mass * (squares.sum() - squares) / 12))


def total(bodies: Sequence[MassProperties]) -> MassProperties:
    """Return the mass properties of bodies fixed to each other."""
    assembly = Body("")
    for body in bodies:
        assembly.add_mass(body.mass, body.center, body.inertia)
    return MassProperties(assembly.mass, assembly.center, assembly.inertia)


def weigh_all(
    solids: Sequence[tuple[str, Manifold]], densities: dict[str, float]
) -> MassProperties:
    """Return the mass properties of solids, each of its material's density."""
    return total([weigh(solid, densities[material]) for material, solid in solids])
