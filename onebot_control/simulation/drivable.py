"""A description as the simulation drives it: wheels roll, casters glide, the rest is rigid.

URDF does not say what a simulation needs. Motors without a limit get the torque at which the wheels
slip. A wide or faceted wheel touches the ground at changing places, so that driven wheels roll on a
thin cylinder instead. Wheels that skid give way sideways as much as they do where they roll; see
``SkidAxle``. What else touches the ground glides, unless its <lateral_friction> is given. Arms,
grippers and heads are held still: nobody controls them here.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.simulation.bodies import Body, SkidAxle, link_poses, matrix, origin_of
from onebot_control.simulation.engine import logger
from onebot_control.simulation.shapes import bottom, is_round
from onebot_control.wheels.geometry import Wheels
from onebot_control.wheels.shapes import Tyre
from onebot_description.description.description import (
    Cylinder,
    Description,
    Geometry,
    Inertial,
    Joint,
    Link,
    Origin,
    Sphere,
)
from onebot_description.model import quaternions

Floats = NDArray[np.float64]

_THIN = 0.006  # m; a wheel no wider touches the ground in one place
_WIDTH = 0.004  # m, of the cylinder that replaces a wider one
_GLIDING = 0.01  # coefficient of friction
# m. Rigid casters before and behind the wheels would carry the robot alone. What is lower than the
# wheels, if by less than the first, is lifted until the wheels stand lower by the second.
_LEVEL, _LIFT = 0.005, 0.0002
# The same, m, of the base's meshes and boxes where round shapes support it: of a mesh PyBullet has
# the convex hull, which fills what is between the wheels.
_DEEP, _CLEAR = 0.02, 0.002
_GRAVITY = 9.81  # m/s^2
# Least moment of inertia of a wheel, in masses of the robot at its rim: with less, the solver's
# iterations do not reach the wheel's speed.
_LIGHTEST = 0.005
_LEAST = 0.2  # of the mobility of a wheel that skids, due to its own turning


class Drivable(NamedTuple):
    """A description to simulate."""

    description: Description
    held: Mapping[str, float]  # joints that it has no longer, to the position they are held at


def drivable(wheels: Wheels) -> Drivable:
    """Return a robot as the simulation drives it by these wheels."""
    description, tyres = wheels.description, {name: wheels.tyres.of(name) for name in wheels.names}
    weight = _GRAVITY * wheels.robot.mass
    free = _free(description, tyres)
    held = {
        joint.name: min(max(0.0, joint.lower or 0.0), _upper(joint))
        for joint in description.moving_joints
        if joint.name not in (*tyres, *free)
    }
    joints = []
    for joint in description.joints:
        if joint.name in held:
            joints.append(_fixed(joint, held[joint.name]))
        elif joint.name in tyres:
            motor = _motor(joint, weight, tyres[joint.name])
            joints.append(SkidAxle(**vars(motor)) if len(tyres) > 2 else motor)
        else:
            joints.append(joint)
    rigid = replace(description, joints=tuple(joints))
    links = tuple(_turning(wheels, _links(rigid, tyres, free)))
    return Drivable(replace(rigid, links=links), held)


def _upper(joint: Joint) -> float:
    return math.inf if joint.upper is None else joint.upper


def _free(description: Description, wheels: Iterable[str]) -> dict[str, Joint]:
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
    # Of a robot without any mass nothing is known, and it is refused for that when it is loaded.
    slipping = weight * radius or math.inf
    return replace(
        joint,
        kind="continuous",
        effort=joint.effort or slipping,
        velocity=joint.velocity or None,
        damping=0.0,
        friction=0.0,
        mimic=None,
    )


def _links(
    description: Description, tyres: Mapping[str, Tyre | None], free: Iterable[str]
) -> Iterator[Link]:
    """Return the links, with what the ground touches changed."""
    joints = {joint.child: joint for joint in description.joints}
    bodies = {link: first for link, (first, _) in link_poses(description).items()}
    # Of one caster the load is determined by the mass.
    several = sum(_swivels(joint, free, bodies, joints) for joint in joints.values()) > 1
    ground, poses = _ground(description, tyres), link_poses(description)
    base = [link for link in description.links if joints.get(bodies[link.name]) is None]
    gaps = {link.name: _gaps(link, poses[link.name][1], ground) for link in base}
    supported = any(
        is_round(each.shape) and abs(gap) < _LEVEL
        for link in base
        for each, gap in zip(link.collisions, gaps[link.name], strict=True)
    )
    depth, lift = (_DEEP, _CLEAR) if supported else (_LEVEL, _LIFT)
    for link in description.links:
        first = joints.get(bodies[link.name])
        if first is not None and first.name in tyres:
            tyre = tyres[first.name]
            if tyre and not _is_thin(description, bodies, first.child):
                rolls = [_thin(first, tyre)] if link.name == first.child else []
                link = replace(link, collisions=tuple(rolls))
            yield link
        elif link.friction is None and not _swivels(first, free, bodies, joints):
            if first is None:
                link = _lifted(link, poses[link.name][1], gaps[link.name], depth, lift)
            yield replace(link, friction=_GLIDING)
        else:
            yield _smaller(link) if several else link


def _ground(description: Description, tyres: Mapping[str, Tyre | None]) -> float:
    """Return the height on which the driven wheels roll, in the frame of the root link, m."""
    poses, heights = link_poses(description), [-math.inf]
    for joint in description.joints:
        if tyre := tyres.get(joint.name):
            place = poses[joint.parent][1] @ matrix(joint.origin)
            middle = place @ np.array([*(tyre.offset * value for value in joint.axis), 1.0])
            heights.append(float(middle[2]) - tyre.radius)
    return max(heights)


def _gaps(link: Link, pose: Floats, ground: float) -> list[float]:
    """Return the heights above the ground of the shapes of a link at ``pose``, m."""
    return [bottom(each.shape, pose @ matrix(each.origin)) - ground for each in link.collisions]


def _lifted(link: Link, pose: Floats, gaps: list[float], depth: float, lift: float) -> Link:
    """Return a link of the base, at ``pose`` there, with what is as low as the wheels lifted.

    Args:
        link: of the base.
        pose: of the link.
        gaps: heights of its shapes.
        depth: below the ground, to which what is not round is lifted.
        lift: above the ground, to which it is lifted.
    """
    collisions, raised = [], 0.0
    for geometry, gap in zip(link.collisions, gaps, strict=True):
        least, height = (-_LEVEL, _LIFT) if is_round(geometry.shape) else (-depth, lift)
        if least < gap < height:
            raised = max(raised, height - gap)
            place = pose @ matrix(geometry.origin)
            place[2, 3] += height - gap
            origin = origin_of(np.linalg.inv(pose) @ place)
            geometry = replace(geometry, origin=origin)
        collisions.append(geometry)
    if raised > _LEVEL:
        logger.warning(
            '%s: a collision shape of link "%s" reaches below the wheels; the simulation lifts it '
            "by %.0f mm, so that the wheels carry the robot",
            link.where,
            link.name,
            1e3 * raised,
        )
    return replace(link, collisions=tuple(collisions))


def _smaller(link: Link) -> Link:
    """Return the wheel of a caster with smaller round shapes; lifted, it would roll unevenly."""
    collisions = tuple(
        replace(each, shape=replace(each.shape, radius=each.shape.radius - _LIFT))
        if isinstance(each.shape, Sphere | Cylinder) and each.shape.radius > 2.0 * _LIFT
        else each
        for each in link.collisions
    )
    return replace(link, collisions=collisions)


def _turning(wheels: Wheels, links: Iterable[Link]) -> Iterator[Link]:
    """Return the links, with the mass of each wheel on its own one, and with its inertia."""
    turned = {wheels.axles[name].joint.child: name for name in wheels.names}
    poses = link_poses(wheels.description)
    for link in links:
        first, _ = poses[link.name]
        name = turned.get(first, "")
        if not (name and (tyre := wheels.tyres.of(name))):
            yield link
        elif len(turned) > 2:
            ring = _ring(wheels, name, tyre) if link.name == first else None
            yield replace(link, inertial=ring)
        elif link.name == first:
            least = _LIGHTEST * wheels.robot.mass * tyre.radius**2
            yield _no_lighter(link, wheels.axles[name].joint, least)
        else:
            yield link


def _no_lighter(link: Link, joint: Joint, least: float) -> Link:
    """Return a wheel whose moment of inertia about its axle is not below ``least``."""
    if link.inertial is None:
        return link
    along = matrix(link.inertial.origin)[:3, :3].T @ np.array(joint.axis)
    rows, columns = np.triu_indices(3)
    tensor = np.zeros((3, 3))
    tensor[rows, columns] = tensor[columns, rows] = link.inertial.inertia
    missing = max(0.0, least - float(along @ tensor @ along))
    # Half of it across: a thin ring.
    tensor += missing / 2.0 * (np.outer(along, along) + np.eye(3))
    return replace(
        link, inertial=replace(link.inertial, inertia=tuple(tensor[rows, columns].tolist()))
    )


def _ring(wheels: Wheels, name: str, tyre: Tyre) -> Inertial | None:
    """Return the mass of a wheel, all of it on the wheel's own link; None if it has none."""
    joint, body = wheels.axles[name].joint, Body(name)
    poses = link_poses(wheels.description)
    for link in wheels.description.links:
        if poses[link.name][0] == joint.child:
            body.add(link, poses[link.name][1])
    if body.mass <= 0.0:
        return None
    axis = np.array(joint.axis)
    tensor = _moment(wheels, name, tyre, body.mass) / 2.0 * (np.outer(axis, axis) + np.eye(3))
    x, y, z = body.center.tolist()
    return Inertial(Origin((x, y, z)), body.mass, tuple(tensor[np.triu_indices(3)].tolist()))


def _moment(wheels: Wheels, name: str, tyre: Tyre, mass: float) -> float:
    """Return the moment of inertia of a wheel about its axle with which it skids rightly.

    An impulse at its contact moves that as much along the robot, where the wheel turns, as across,
    where it slides on its axle; see ``SkidAxle``.
    """
    whole = wheels.robot
    places = {
        each: wheels.axles[each].middle(wheels.tyres.of(each)) - whole.center
        for each in wheels.names
    }
    _, y, z = places[name]
    roll, pitch, yaw = np.diag(whole.inertia)
    # Across, the wheels do not turn with the robot.
    yaw = max(yaw - mass * sum(place[0] ** 2 for place in places.values()), _LEAST * yaw)
    sideways = 1.0 / mass + tyre.radius**2 / roll
    base = 1.0 / whole.mass + y**2 / yaw + z**2 / pitch
    return float(tyre.radius**2 / max(sideways - base, _LEAST * sideways))


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
