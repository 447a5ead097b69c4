"""A part: what is seen of it, by material, and what it weighs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Inertial:
    """Mass properties.

    Attributes:
        mass: kg.
        center: centre of mass in the part's frame, metres.
        inertia: (3, 3) about the centre of mass, along the frame's axes, kg m2.
    """

    mass: float
    center: NDArray[np.float64]
    inertia: NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """One link of the robot, in the frame of that link.

    Attributes:
        name: as in meshes/<name>.dae.
        seen: material and solid, in the order in which they are drawn.
        inertial: of the solids that weigh something.
        hidden: says which of (N, 3) points nobody can see, as they lie inside the part.
    """

    name: str
    seen: tuple[tuple[str, Manifold], ...]
    inertial: Inertial
    hidden: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None


def to_mesh(solid: Manifold) -> trimesh.Trimesh:
    """Return a solid's skin."""
    mesh = solid.to_mesh64()
    points = np.array(mesh.vert_properties, float)[:, :3]
    return trimesh.Trimesh(points, np.array(mesh.tri_verts, np.int64), process=False)


def weigh(solid: Manifold, density: float) -> Inertial:
    """Return the mass properties of a homogeneous solid; density in kg/m3."""
    mesh = to_mesh(solid)
    mesh.density = density
    properties = mesh.mass_properties
    center = np.asarray(properties.center_mass, float)
    return Inertial(float(properties.mass), center, np.asarray(properties.inertia, float))


def weigh_box(mass: float, center: NDArray[np.float64], size: Vector) -> Inertial:
    """Return the mass properties of a homogeneous box along the axes."""
    squares = np.square(size)
    return Inertial(mass, center, np.diag(mass * (squares.sum() - squares) / 12))


def total(bodies: Sequence[Inertial]) -> Inertial:
    """Return the mass properties of bodies fixed to each other (parallel axis theorem)."""
    mass = sum(body.mass for body in bodies)
    moments = np.array([body.mass * body.center for body in bodies])
    center = np.asarray(moments.sum(axis=0) / mass, float)
    inertia = np.zeros((3, 3))
    for body in bodies:
        arm = body.center - center
        inertia += body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertial(mass, center, inertia)


def weigh_all(solids: Sequence[tuple[str, Manifold]], densities: dict[str, float]) -> Inertial:
    """Return the mass properties of solids, each of its material's density."""
    return total([weigh(solid, densities[material]) for material, solid in solids])
