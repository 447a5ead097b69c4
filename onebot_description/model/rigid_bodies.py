"""The rigid bodies of a robot: links that fixed joints connect, with their total mass and shapes.

Masses are added up as written; a link without ``<inertial>`` has none.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.elements.urdf import MAX_FRICTION, Description, Inertial, Link, Shape
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Origin

_ROUNDING = 0.01  # relative tolerance of moments of inertia, which are written with few digits


def rigid_frames(description: Description) -> dict[str, tuple[str, Floats]]:
    """Return for each link the first link of its rigid body, and its pose (4, 4) in that frame."""
    above = {joint.child: joint for joint in description.joints if joint.kind == "fixed"}
    frames = {}
    for link in description.link_names:
        first, pose = link, np.eye(4)
        while first in above:
            joint = above[first]
            pose = matrices.of_origin(joint.origin) @ pose
            first = joint.parent
        frames[link] = first, pose
    return frames


@dataclass
class Body:
    """One rigid body, in the frame of its first link, which is not fixed to a parent."""

    link: str  # name of that link
    mass: float = 0.0  # kg
    center: Floats = field(default_factory=lambda: np.zeros(3))  # center of mass, m
    inertia: Floats = field(default_factory=lambda: np.zeros((3, 3)))  # about it, kg m^2
    # Each shape, with its pose (4, 4) in the body, and its link.
    collisions: list[tuple[Shape, Floats, Link]] = field(default_factory=list)
    friction: float | None = None  # lateral coefficient, the minimum of its links
    # Mass of the links without gravity, kg, and the sum of their centers times mass, kg m.
    weightless: tuple[float, Floats] = field(default_factory=lambda: (0.0, np.zeros(3)))

    def add(self, link: Link, pose: Floats) -> None:
        """Add the mass and the shapes of ``link``, whose frame is at ``pose`` (4, 4)."""
        for collision in link.collisions:
            place = pose @ matrices.of_origin(collision.origin)
            self.collisions.append((collision.shape, place, link))
        friction = link.friction
        if friction is None and link.mu is not None:
            friction = min(link.mu, MAX_FRICTION)
        if friction is not None:
            self.friction = min(friction, friction if self.friction is None else self.friction)
        if link.inertial is not None:
            where = pose @ matrices.of_origin(link.inertial.origin)
            xx, xy, xz, yy, yz, zz = link.inertial.inertia
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            turn = where[:3, :3]
            self.add_mass(link.inertial.mass, where[:3, 3], turn @ moments @ turn.T)
            if not link.gravity:
                mass, moment = self.weightless
                mass += link.inertial.mass
                self.weightless = mass, moment + link.inertial.mass * where[:3, 3]

    @property
    def inertial(self) -> Inertial:
        """Mass, center and inertia as an Inertial, in the axes of the body."""
        x, y, z = self.center.tolist()
        return Inertial(
            Origin((x, y, z)), self.mass, tuple(self.inertia[np.triu_indices(3)].tolist())
        )

    def principal(self) -> tuple[Floats, Floats]:
        """Return the principal moments (3,), kg m^2, and axes (3, 3)."""
        largest = np.abs(self.inertia).max()
        diagonal = np.diag(np.diag(self.inertia))
        if np.abs(self.inertia - diagonal).max() <= 1e-12 * largest:
            return np.diag(diagonal).copy(), np.eye(3)
        moments, axes = np.linalg.eigh(self.inertia)
        # A rotation needs right-handed axes.
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        return moments, axes

    def add_mass(self, mass: float, center: Floats, inertia: Floats) -> None:
        """Add a mass (kg) with its center (3,), m, and inertia (3, 3) about it, kg m^2.

        Inertias are combined by the parallel axis theorem.
        """
        total = self.mass + mass
        if total > 0:
            apart = center - self.center
            reduced = self.mass * mass / total
            self.inertia += reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
            self.center = self.center + apart * (mass / total)
        self.inertia += inertia
        self.mass = total


def inertia_fault(moments: Floats) -> str:
    """Return what is wrong with principal moments (3,), kg m^2, and what the simulation does.

    Returns "" for moments of a solid: above 0, and none larger than the sum of the others.
    """
    largest = float(moments.max())
    sum_of_others = float(moments.sum() - largest)
    numbers = ", ".join(f"{moment:.3g}" for moment in sorted(moments))
    text = f"has the principal moments of inertia {numbers} kg m^2"
    if moments.min() <= 0.0:
        return f"{text}; all must be above 0, or it cannot be simulated"
    if largest > sum_of_others * (1.0 + _ROUNDING):
        return f"{text}; the largest is simulated as {sum_of_others:.3g}, the sum of the others"
    return ""


def inertia_warnings(description: Description) -> Iterator[str]:
    """Yield a warning for each moving body whose inertia the simulation changes or rejects."""
    moved = {joint.child: joint for joint in description.moving_joints}
    for name, body in merged_bodies(description).items():
        if moved and body.mass > 0.0:
            moments, _ = body.principal()
            # The rotor of a motor adds to what a joint turns.
            turns = name not in moved or moved[name].kind != "prismatic"
            if (fault := inertia_fault(moments)) and not (turns and moments.min() == 0.0):
                yield f'{description.source}: link "{name}" {fault}'


def merged_bodies(description: Description) -> dict[str, Body]:
    """Return the rigid bodies by the name of their first link."""
    bodies: dict[str, Body] = {}
    frames = rigid_frames(description)
    for link in description.links:
        first, pose = frames[link.name]
        bodies.setdefault(first, Body(first)).add(link, pose)
    return bodies
