"""A description as the simulation drives it: wheels roll, casters glide, the rest is rigid.

URDF does not say what a simulation needs. Motors without a limit get the torque at which the wheels
slip. A wide or faceted wheel touches the ground at changing places, so that driven wheels roll on a
thin cylinder instead. Wheels that skid get the inertia of a geared motor: PyBullet's friction
counters the sliding of a contact in each direction as far as the bodies resist there, and a light
wheel would resist sideways only. What else touches the ground glides, unless its <lateral_friction>
is given. Arms, grippers and heads are held still: nobody controls them here.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from onebot_control.simulation.bodies import link_poses, matrix, origin_of
from onebot_control.wheel_shapes import Tyre, Tyres
from onebot_description.description.description import (
    Cylinder,
    Description,
    Geometry,
    Joint,
    Link,
    Origin,
    Sphere,
)
from onebot_description.model import quaternions

_THIN = 0.006  # m; a wheel no wider touches the ground in one place
_WIDTH = 0.004  # m, of the cylinder that replaces a wider one
_GLIDING = 0.01  # coefficient of friction
_GRAVITY = 9.81  # m/s^2
# Inertia of a wheel that skids, in masses of the robot at its rim: with less it turns too little.
_GEARED = 2.0


class Drivable(NamedTuple):
    """A description to simulate."""

    description: Description
    held: Mapping[str, float]  # joints that it has no longer, to the position they are held at


def drivable(description: Description, wheels: Sequence[str]) -> Drivable:
    """Return a robot as the simulation drives it by these joints."""
    tyres = {name: Tyres(description).of(name) for name in wheels}
    weight = _GRAVITY * _mass(description)
    free = _free(description, wheels)
    held = {
        joint.name: min(max(0.0, joint.lower or 0.0), _upper(joint))
        for joint in description.moving_joints
        if joint.name not in (*wheels, *free)
    }
    joints = []
    for joint in description.joints:
        if joint.name in held:
            joints.append(_fixed(joint, held[joint.name]))
        elif joint.name in tyres:
            joints.append(_motor(joint, weight, tyres[joint.name]))
        else:
            joints.append(joint)
    rigid = replace(description, joints=tuple(joints))
    links = tuple(_links(rigid, tyres, free))
    return Drivable(replace(rigid, links=links), held)


def _mass(description: Description) -> float:
    return sum(link.inertial.mass for link in description.links if link.inertial is not None)


def _upper(joint: Joint) -> float:
    return math.inf if joint.upper is None else joint.upper


def _free(description: Description, wheels: Sequence[str]) -> dict[str, Joint]:
    """Return the joints of swivelling and rolling casters.

    They turn without end, as do all joints between them and the base, and all that they carry.
    """
    moving = {joint.child: joint for joint in description.moving_joints}
    poses = link_poses(description)
    above = {joint.name: moving.get(poses[joint.parent][0]) for joint in moving.values()}
    chains = [list(_chain(joint, above)) for joint in moving.values()]
    bound = {joint.name for chain in chains if any(map(_is_bound, chain)) for joint in chain}
    return {j.name: j for j in moving.values() if j.name not in bound and j.name not in wheels}


def _chain(joint: Joint | None, above: Mapping[str, Joint | None]) -> Iterator[Joint]:
    while joint is not None:
        yield joint
        joint = above[joint.name]


def _is_bound(joint: Joint) -> bool:
    return joint.kind != "continuous" or joint.mimic is not None


def _fixed(joint: Joint, position: float) -> Joint:
    """Return a joint that is held at a position."""
    moved = np.eye(4)
    axis = np.array(joint.axis)
    if joint.kind == "prismatic":
        moved[:3, 3] = axis * position
    else:
        half = position / 2.0
        moved[:3, :3] = quaternions.to_matrix(np.array([*axis * math.sin(half), math.cos(half)]))
    origin = origin_of(matrix(joint.origin) @ moved) if position else joint.origin
    return replace(joint, kind="fixed", origin=origin, mimic=None)


def _motor(joint: Joint, weight: float, tyre: Tyre | None) -> Joint:
    radius = tyre.radius if tyre else 1.0
    return replace(
        joint,
        kind="continuous",
        effort=joint.effort or weight * radius,
        velocity=joint.velocity or None,
        mimic=None,
    )


def _links(
    description: Description, tyres: Mapping[str, Tyre | None], free: Iterable[str]
) -> Iterator[Link]:
    """Return the links, with what the ground touches changed."""
    joints = {joint.child: joint for joint in description.joints}
    bodies = {link: first for link, (first, _) in link_poses(description).items()}
    mass, skids = _mass(description), len(tyres) > 2
    for link in description.links:
        first = joints.get(bodies[link.name])
        if first is not None and first.name in tyres:
            tyre = tyres[first.name]
            if tyre and skids:
                link = _inert(link, first, _GEARED * mass * tyre.radius**2)
            if tyre and not _is_thin(description, bodies, first.child):
                rolls = [_thin(first, tyre)] if link.name == first.child else []
                link = replace(link, collisions=tuple(rolls))
            yield link
        elif link.friction is None and not _swivels(first, free, bodies, joints):
            yield replace(link, friction=_GLIDING)
        else:
            yield link


def _inert(link: Link, joint: Joint, moment: float) -> Link:
    """Return a wheel with a further ``moment`` of inertia about its axle, as of a geared motor."""
    if link.name != joint.child or link.inertial is None:
        return link
    along = matrix(link.inertial.origin)[:3, :3].T @ np.array(joint.axis)
    # Half of it across: a thin disc.
    added = moment / 2.0 * (np.outer(along, along) + np.eye(3))
    rows, columns = np.triu_indices(3)
    inertia = np.array(link.inertial.inertia) + added[rows, columns]
    moments = tuple(inertia.tolist())
    return replace(link, inertial=replace(link.inertial, inertia=moments))


def _is_thin(description: Description, bodies: Mapping[str, str], body: str) -> bool:
    shapes = [
        each.shape
        for link in description.links
        if bodies[link.name] == body
        for each in link.collisions
    ]
    return bool(shapes) and all(
        isinstance(shape, Sphere) or (isinstance(shape, Cylinder) and shape.length <= _THIN)
        for shape in shapes
    )


def _thin(joint: Joint, tyre: Tyre) -> Geometry:
    """Return a thin wheel on the axle of ``joint``."""
    x, y, z = joint.axis
    # A cylinder lies along z.
    rpy = (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))
    middle = tuple(tyre.offset * value for value in joint.axis)
    return Geometry(Cylinder(tyre.radius, _WIDTH), Origin(middle, rpy))  # type: ignore[arg-type]


def _swivels(
    joint: Joint | None,
    free: Iterable[str],
    bodies: Mapping[str, str],
    joints: Mapping[str, Joint],
) -> bool:
    """Whether a body follows the ground: a free joint on another one, as a caster's wheel."""
    if joint is None or joint.name not in free:
        return False
    carrier = joints.get(bodies[joint.parent])
    return carrier is not None and carrier.name in free
