"""A description as the simulation moves it: which joints have motors, and how heavy wheels are.

Motors of wheels without a limit get the torque at which the wheels slip. Joints that a controller
commands by position have motors, too; what mimics such a joint follows it by a gear. Other joints
of arms, grippers and heads are held still, but those that turn without end, if ``<ros2_control>``
has them without a command interface: they swing freely. What mimics a wheel is carried as it stands
at the start: its position follows the wheel's, but has no part in the physics. For friction and
contacts see ``contacts``.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from onebot_control.drive.wheels.geometry import Wheels
from onebot_control.drive.wheels.tyres import Tyre
from onebot_control.physics.bodies import Body, Floats, SkidAxle, link_poses, matrix, origin_of
from onebot_control.physics.contacts import with_contacts
from onebot_control.physics.engine import logger
from onebot_description.description.description import Description, Inertial, Joint, Link
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.model import quaternions

_GRAVITY = 9.81  # m/s^2
# Least moment of inertia of a wheel, in masses of the robot at its rim: with less, the solver's
# iterations do not reach the wheel's speed.
_LIGHTEST = 0.005
_LEAST_TURNING = 0.2  # share of a skidding wheel's mobility due to its own turning
# Of what a motor moves, at least, as if by its own rotor: a finger of 1 g lets a box of 50 g fall,
# since the solver's iterations do not reach the force of its motor.
_LEAST_MASS, _LEAST_MOMENT = 0.02, 1e-3  # kg, kg m^2 about the joint's axis
_UNLIMITED = 1e5  # Nm or N, of a motor without a limit


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


class Gear(NamedTuple):
    """A joint that a gear moves with a commanded one: multiplier * position + offset."""

    name: str
    leader: str  # the commanded joint
    multiplier: float
    offset: float  # rad or m


class Drivable(NamedTuple):
    """A description to simulate."""

    description: Description
    held: Mapping[str, float]  # joints that it has no longer, to the position they are held at
    followers: Sequence[Follower]  # likewise, of joints that mimic what moves; leaders first
    gears: Sequence[Gear] = ()
    starts: Mapping[str, float] = MappingProxyType({})  # of what else moves but wheels, rad or m


def drivable(
    description: Description,
    wheels: Wheels | None,
    commanded: Collection[str] = (),
    positions: Mapping[str, float] = MappingProxyType({}),
) -> Drivable:
    """Return a robot as the simulation moves it.

    Args:
        description: the robot.
        wheels: that drive it; None: its base stands still.
        commanded: joints that follow positions.
        positions: of joints at the start, rad or m; they override those of ``<ros2_control>``.

    Raises:
        OneBotError: a joint named does not move, or follows another one.
    """
    tyres = {name: wheels.tyres.of(name) for name in wheels.names} if wheels else {}
    casters = casters_of(wheels, commanded) if wheels else ()
    roles = _Roles(description, {*tyres, *casters}, commanded, positions)
    _report_unlimited(description, {*roles.starts} - {*roles.gears})
    weight = _GRAVITY * wheels.robot.mass if wheels else 0.0
    joints = []
    for joint in description.joints:
        if joint.name in roles.fixed:
            joint = _fixed(joint, roles.fixed[joint.name])
        elif joint.name in tyres:
            joint = _motor(joint, weight, tyres[joint.name])
            if len(tyres) > 2:
                joint = SkidAxle(**vars(joint))
        elif joint.name in roles.starts:
            joint = _positioned(joint, is_gear=joint.name in roles.gears)
        joints.append(joint)
    rigid = replace(description, joints=tuple(joints))
    links: Sequence[Link] = rigid.links
    if wheels:
        contacts = with_contacts(rigid, tyres, casters, {*roles.starts, *roles.passive})
        links = [_massive(wheels, link) for link in contacts]
    links = _with_rotors(replace(rigid, links=tuple(links)), roles.starts)
    gears, starts = list(roles.gears.values()), {**roles.starts, **roles.passive}
    return Drivable(replace(rigid, links=tuple(links)), roles.held, roles.followers, gears, starts)


def commandable(description: Description, wheels: Wheels | None) -> list[str]:
    """Return the joints that a controller commands which names none.

    Those with a position command interface in ``<ros2_control>``, or if there are none all that
    move, but no wheels, no casters, nothing that carries them, and none that mimics another joint.
    """
    interfaces = description.interfaces
    taken = _rolling(wheels) if wheels else set()
    joints = [
        joint.name
        for joint in description.moving_joints
        if joint.mimic is None and joint.name not in taken
    ]
    named = [j for j in joints if j in interfaces and "position" in interfaces[j].commands]
    return named or [joint for joint in joints if joint not in interfaces]


def _rolling(wheels: Wheels) -> set[str]:
    """The joints of wheels and casters, and those that carry them."""
    rolling = {*wheels.names, *casters_of(wheels)}
    chains = [chain for chain in _chains(wheels) if chain[0].name in rolling]
    return {joint.name for chain in chains for joint in chain}


def _chains(wheels: Wheels) -> list[list[Joint]]:
    """Each joint that moves, followed by those that move it, up to the base."""
    moving = {joint.child: joint for joint in wheels.description.moving_joints}
    chains = [[joint] for joint in moving.values()]
    for chain in chains:
        while above := moving.get(wheels.rigid[chain[-1].parent][0]):
            chain.append(above)
    return chains


class _Roles:
    """What becomes of each joint that moves.

    Attributes:
        held: joints that nothing moves, to positions.
        followers: joints that mimic wheels and casters; leaders first.
        fixed: both of these, to their positions at the start.
        gears: joints that mimic commanded ones, by name.
        starts: commanded joints and gears, to their positions at the start.
        passive: joints that swing freely, to their positions at the start.
    """

    def __init__(
        self,
        description: Description,
        rolling: Collection[str],
        commanded: Collection[str],
        positions: Mapping[str, float],
    ) -> None:
        self._joints = {joint.name: joint for joint in description.moving_joints}
        self._check(description, {*commanded, *positions}, commanded)
        interfaces = description.interfaces
        of_file = {name: it.start for name, it in interfaces.items() if it.start is not None}
        self._given = {**of_file, **positions}
        self.passive = {
            name: self._given.get(name, 0.0)
            for name, joint in self._joints.items()
            if joint.kind == "continuous"
            and joint.mimic is None
            and name in interfaces
            and not (interfaces[name].commands or name in rolling or name in commanded)
        }
        self._rolling, self._commanded = {*rolling, *self.passive}, commanded
        self._positions: dict[str, float] = {}
        self.fixed: dict[str, float] = {}
        self.followers: list[Follower] = []
        self.gears: dict[str, Gear] = {}
        self.starts: dict[str, float] = {}
        for joint in self._joints.values():
            self._place(joint)
        names = {follower.name for follower in self.followers}
        self.held = {n: self.fixed[n] for n in self._joints if n in self.fixed and n not in names}

    def _check(
        self, description: Description, names: Collection[str], commanded: Collection[str]
    ) -> None:
        for name in names:
            where = f'{description.source}: joint "{name}"'
            if name not in self._joints:
                raise OneBotError(f"{where} does not move{did_you_mean(name, self._joints)}")
            if name in commanded and (mimic := self._joints[name].mimic):
                text = f'follows "{mimic.joint}" by <mimic>; command that one'
                raise OneBotError(f"{where} {text}")

    def _place(self, joint: Joint) -> float:
        """Decide about a joint; return its position at the start."""
        name, mimic = joint.name, joint.mimic
        if name in self._positions:
            return self._positions[name]
        if name in self._rolling:
            position = self.passive.get(name, 0.0)
        elif name in self._commanded:
            position = self.starts[name] = _within(joint, self._given.get(name, 0.0))
        elif mimic is None:
            position = self.fixed[name] = _within(joint, self._given.get(name, 0.0))
        else:
            leader = self._place(self._joints[mimic.joint])
            position = self._follow(joint, mimic.joint, mimic.multiplier, mimic.offset, leader)
        self._positions[name] = position
        return position

    def _follow(
        self, joint: Joint, leader: str, multiplier: float, offset: float, at: float
    ) -> float:
        """Decide about a joint that mimics one which starts ``at`` a position."""
        name = joint.name
        if leader in self.starts and multiplier:
            self.starts[name] = multiplier * at + offset
            if gear := self.gears.get(leader):
                offset += multiplier * gear.offset
                leader, multiplier = gear.leader, multiplier * gear.multiplier
            self.gears[name] = Gear(name, leader, multiplier, offset)
            return self.starts[name]
        follower = Follower(name, leader, multiplier, offset, *joint.range)
        if leader in (*self._rolling, *(each.name for each in self.followers)):
            self.followers.append(follower)
        self.fixed[name] = follower.at(at)
        return self.fixed[name]


def _within(joint: Joint, position: float) -> float:
    """The position nearest to this one within the joint's limits."""
    lower, upper = joint.range
    return min(max(position, lower), upper)


def _report_unlimited(description: Description, motors: Collection[str]) -> None:
    """Warn of joints that motors move, and whose ``<limit>`` has no effort or no velocity."""
    for limit, unlimited in (("effort", "force"), ("velocity", "speed")):
        names = [
            joint.name
            for joint in description.joints
            if joint.name in motors and not getattr(joint, limit)
        ]
        if names:
            logger.warning(
                "%s: joint %s: no %s above 0 in <limit>, so the motor's %s has no limit",
                description.source,
                listing(names),
                limit,
                unlimited,
            )


def _positioned(joint: Joint, *, is_gear: bool) -> Joint:
    """A joint with a motor that follows positions, or with a gear, which has its leader's limits.

    Its friction is the motor's; see ``Robot``.
    """
    joint = replace(
        joint, effort=joint.effort or _UNLIMITED, velocity=joint.velocity or None, mimic=None
    )
    if is_gear and joint.kind != "continuous":
        return replace(joint, lower=1.0, upper=-1.0)  # without limits, as PyBullet has it
    return joint


def _with_rotors(rigid: Description, moved: Collection[str]) -> Sequence[Link]:
    """Return the links, with the least inertia behind each of the ``moved`` joints.

    Links that have none at all get no more, and are reported.
    """
    if not moved:
        return rigid.links
    bodies, poses = dict[str, Body](), link_poses(rigid)
    for link in rigid.links:
        first, pose = poses[link.name]
        bodies.setdefault(first, Body(first)).add(link, pose)
    joints = {joint.child: joint for joint in rigid.joints if joint.name in moved}
    if weightless := [link for link in joints if bodies[link].mass <= 0.0]:
        logger.warning(
            "%s: link %s: no <inertial>, simulated with %g kg; efforts are wrong until they have "
            "mass and inertia",
            rigid.source,
            listing(weightless),
            _LEAST_MASS,
        )
    return [
        _with_rotor(link, joints[link.name], bodies[link.name]) if link.name in joints else link
        for link in rigid.links
    ]


def _with_rotor(link: Link, joint: Joint, body: Body) -> Link:
    """A link with what its whole ``body`` lacks of the least mass and moment of inertia."""
    axis = np.array(joint.axis)
    arm = body.center - (body.center @ axis) * axis
    moment = float(axis @ body.inertia @ axis + body.mass * (arm @ arm))
    mass = 0.0
    if joint.kind == "prismatic" or body.mass <= 0.0:
        mass = max(0.0, _LEAST_MASS - body.mass)
    missing = 0.0 if joint.kind == "prismatic" and body.mass > 0.0 else _LEAST_MOMENT - moment
    if mass == 0.0 and missing <= 0.0:
        return link
    own = Body(link.name)
    own.add(link, np.eye(4))
    own.add_mass(mass, body.center, _thin_ring(axis, max(0.0, missing)))
    return replace(link, inertial=own.inertial)


def _thin_ring(axis: Floats, moment: float) -> Floats:
    """The inertia (3, 3) of a ring with this moment about its axis: half of it across."""
    return moment / 2.0 * (np.outer(axis, axis) + np.eye(3))


def casters_of(wheels: Wheels, commanded: Collection[str] = ()) -> Collection[str]:
    """Return the joints of swivelling and rolling casters.

    They turn without end, as do all joints between them and the base, and all that they carry;
    those that are ``commanded`` are none.
    """
    chains, bound = _chains(wheels), {*commanded}
    for chain in chains:
        if any(joint.kind != "continuous" or joint.mimic is not None for joint in chain):
            bound.update(joint.name for joint in chain)
    return {chain[0].name for chain in chains} - bound - {*wheels.names}


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
    tensor += _thin_ring(along, missing)
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
    body.inertia = _thin_ring(np.array(joint.axis), _moment(wheels, name, tyre, body.mass))
    return body.inertial


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
