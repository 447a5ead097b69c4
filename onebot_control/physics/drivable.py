"""A description as the simulation drives it: which joints have motors, and how heavy wheels are.

Motors without a limit get the torque at which the wheels slip. Arms, grippers and heads are held
still: nobody controls them here. What mimics a wheel is carried as it stands at the start: its
position follows the wheel's, but has no part in the physics. For friction and contacts see
``contacts``.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from onebot_control.drive.wheels.geometry import Wheels
from onebot_control.drive.wheels.tyres import Tyre
from onebot_control.physics.bodies import Body, SkidAxle, matrix, origin_of
from onebot_control.physics.contacts import with_contacts
from onebot_description.description.description import (
    Description,
    Inertial,
    Joint,
    Link,
    Mimic,
    Origin,
)
from onebot_description.model import quaternions

_GRAVITY = 9.81  # m/s^2
# Least moment of inertia of a wheel, in masses of the robot at its rim: with less, the solver's
# iterations do not reach the wheel's speed.
_LIGHTEST = 0.005
_LEAST_TURNING = 0.2  # share of a skidding wheel's mobility due to its own turning


class Follower(NamedTuple):
    """A joint that mimics one that moves."""

    name: str
    leader: str  # a wheel's or caster's joint, or a follower before this one
    multiplier: float
    offset: float  # rad or m
    lower: float  # least position, rad or m
    upper: float

    def at(self, position: float) -> float:
        """Return its position while its leader is at ``position``."""
        return min(max(self.multiplier * position + self.offset, self.lower), self.upper)


class Drivable(NamedTuple):
    """A description to simulate."""

    description: Description
    held: Mapping[str, float]  # joints that it has no longer, to the position they are held at
    followers: Sequence[Follower]  # likewise, of joints that mimic what moves; leaders first


def drivable(wheels: Wheels) -> Drivable:
    """Return a robot as the simulation drives it by these wheels."""
    description, tyres = wheels.description, {name: wheels.tyres.of(name) for name in wheels.names}
    casters = _casters(wheels)
    held, followers = _still(description, {*tyres, *casters})
    starts = held | {follower.name: at for follower, at in followers.items()}
    weight = _GRAVITY * wheels.robot.mass
    joints = []
    for joint in description.joints:
        if joint.name in starts:
            joint = _fixed(joint, starts[joint.name])
        elif joint.name in tyres:
            joint = _motor(joint, weight, tyres[joint.name])
            if len(tyres) > 2:
                joint = SkidAxle(**vars(joint))
        joints.append(joint)
    rigid = replace(description, joints=tuple(joints))
    links = [_massive(wheels, link) for link in with_contacts(rigid, tyres, casters)]
    return Drivable(replace(rigid, links=tuple(links)), held, list(followers))


def _still(
    description: Description, moving: Collection[str]
) -> tuple[dict[str, float], dict[Follower, float]]:
    """Return the joints that nothing moves, and those that mimic ``moving`` ones, to positions.

    Those of followers are at the start, when all that moves is at 0. A joint that mimics none is
    held where it is nearest to 0 within its limits.
    """
    held, followers = dict[str, float](), dict[Follower, float]()
    starts = dict.fromkeys(moving, 0.0)
    joints = {joint.name: joint for joint in description.moving_joints}

    def start(joint: Joint) -> float:
        if joint.name in starts:
            return starts[joint.name]
        mimic = joint.mimic or Mimic("", 0.0)
        lower = -math.inf if joint.lower is None else joint.lower
        upper = math.inf if joint.upper is None else joint.upper
        factors = mimic.multiplier, mimic.offset
        follower = Follower(joint.name, mimic.joint, *factors, lower, upper)
        position = follower.at(start(joints[mimic.joint]) if mimic.joint else 0.0)
        if mimic.joint in (*moving, *(each.name for each in followers)):
            followers[follower] = position
        else:
            held[joint.name] = position
        starts[joint.name] = position
        return position

    for joint in joints.values():
        start(joint)
    return {name: held[name] for name in joints if name in held}, followers


def _casters(wheels: Wheels) -> Collection[str]:
    """The joints of swivelling and rolling casters.

    They turn without end, as do all joints between them and the base, and all that they carry.
    """
    moving = {joint.child: joint for joint in wheels.description.moving_joints}
    bound: set[str] = set()
    for joint in moving.values():
        chain = [joint]
        while above := moving.get(wheels.rigid[chain[-1].parent][0]):
            chain.append(above)
        if any(link.kind != "continuous" or link.mimic is not None for link in chain):
            bound.update(link.name for link in chain)
    return {joint.name for joint in moving.values()} - bound - {*wheels.names}


def _fixed(joint: Joint, position: float) -> Joint:
    """A joint that is held at a position."""
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
    # A robot without any mass is refused for that when it is loaded.
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


def _massive(wheels: Wheels, link: Link) -> Link:
    """A link, with the mass of a driven wheel on the wheel's own link, and with its inertia."""
    first, _ = wheels.rigid[link.name]
    driven = {wheels.axles[name].joint.child: name for name in wheels.names}
    tyre = wheels.tyres.of(driven[first]) if first in driven else None
    if tyre is None:
        return link
    if len(driven) > 2:
        ring = _ring(wheels, driven[first], tyre) if link.name == first else None
        return replace(link, inertial=ring)
    if link.name != first or link.inertial is None:
        return link
    least = _LIGHTEST * wheels.robot.mass * tyre.radius**2
    return replace(
        link, inertial=_no_lighter(link.inertial, wheels.axles[driven[first]].joint, least)
    )


def _no_lighter(inertial: Inertial, joint: Joint, least: float) -> Inertial:
    """The inertia of a wheel, about its axle not below ``least``."""
    along = matrix(inertial.origin)[:3, :3].T @ np.array(joint.axis)
    rows, columns = np.triu_indices(3)
    tensor = np.zeros((3, 3))
    tensor[rows, columns] = tensor[columns, rows] = inertial.inertia
    missing = max(0.0, least - float(along @ tensor @ along))
    # Half of it across: a thin ring.
    tensor += missing / 2.0 * (np.outer(along, along) + np.eye(3))
    return replace(inertial, inertia=tuple(tensor[rows, columns].tolist()))


def _ring(wheels: Wheels, name: str, tyre: Tyre) -> Inertial | None:
    """The mass of a wheel, all of it on the wheel's own link; None if it has none."""
    joint, body = wheels.axles[name].joint, Body(name)
    for link in wheels.description.links:
        first, pose = wheels.rigid[link.name]
        if first == joint.child:
            body.add(link, pose)
    if body.mass <= 0.0:
        return None
    axis = np.array(joint.axis)
    tensor = _moment(wheels, name, tyre, body.mass) / 2.0 * (np.outer(axis, axis) + np.eye(3))
    x, y, z = body.center.tolist()
    return Inertial(Origin((x, y, z)), body.mass, tuple(tensor[np.triu_indices(3)].tolist()))


def _moment(wheels: Wheels, name: str, tyre: Tyre, mass: float) -> float:
    """The moment of inertia of a wheel about its axle with which it skids rightly.

    An impulse at its contact moves that as much along the robot, where the wheel turns, as across,
    where it slides on its axle; see ``SkidAxle``.
    """
    robot_body = wheels.robot
    places = {
        wheel: wheels.axles[wheel].middle(wheels.tyres.of(wheel)) - robot_body.center
        for wheel in wheels.names
    }
    _, y, z = places[name]
    roll, pitch, yaw = np.diag(robot_body.inertia)
    # Across, the wheels do not turn with the robot.
    yaw = max(yaw - mass * sum(place[0] ** 2 for place in places.values()), _LEAST_TURNING * yaw)
    sideways = 1.0 / mass + tyre.radius**2 / roll
    base = 1.0 / robot_body.mass + y**2 / yaw + z**2 / pitch
    return float(tyre.radius**2 / max(sideways - base, _LEAST_TURNING * sideways))
