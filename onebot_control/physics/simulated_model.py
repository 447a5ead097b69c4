"""Prepares a description for the simulation: the motors of joints, and the inertia of wheels.

- Wheel motors without an effort limit get the torque at which the wheels slip.
- Joints with position commands from a controller also have motors; joints that mimic them follow by
  gears.
- Joints without a command interface in ``<ros2_control>`` swing freely; other joints of arms,
  grippers and heads are held still.
- A joint that mimics a wheel keeps its start position in the physics; only its published position
  follows the wheel.

For friction and contacts see ``friction``.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from onebot_control.drive.wheels.geometry import Wheels
from onebot_control.drive.wheels.rolling_shapes import Tyre
from onebot_control.drive.wheels.steering import STEERING_SPEED
from onebot_control.physics.engine import logger
from onebot_control.physics.friction import Contacts
from onebot_control.physics.physics_urdf import SkidAxle
from onebot_control.physics.roller_wheels import with_rollers
from onebot_control.physics.spawning import RobotSpawn
from onebot_description.arrays import Floats
from onebot_description.elements.meshes import read_mesh
from onebot_description.elements.urdf import (
    Description,
    Inertial,
    Joint,
    JointInterfaces,
    Link,
    Mesh,
    Mimic,
    reduced_mimics,
)
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.geometry import matrices, quaternions
from onebot_description.geometry.poses import about, clamp, total
from onebot_description.model.rigid_bodies import Body, merged_bodies

_GRAVITY = 9.81  # m/s^2
# Minimum moment of inertia of a wheel, as a fraction of the robot's mass at the rim: with less, the
# solver's iterations do not reach the wheel's speed.
_LIGHTEST = 0.005
_MIN_TURNING = 0.2  # minimum fraction of a skidding wheel's mobility due to its own turning
# Minimum inertia behind each motor, like that of a rotor: a finger of 1 g would drop a box of 50 g,
# because the solver's iterations do not reach the force of its motor.
_MIN_MASS, _MIN_MOMENT = 0.02, 1e-3  # kg, kg m^2 about the joint's axis
# Minimum moment of inertia per motor effort behind geared joints: like that of rotors, it grows
# with the gear ratio. With less, linkages that press on something are off by more than 1e-3 rad.
_MIN_GEARED = 1e-4  # kg m^2 / (N m)
_FILLED = 0.5  # share of the convex hull below which a finger's mesh is reported
_UNLIMITED = 1e5  # Nm or N, effort of a motor without a limit


def simulated_model(
    description: Description,
    wheels: Wheels,
    commanded: Collection[str] = (),
    positions: Mapping[str, float] = MappingProxyType({}),
) -> RobotSpawn:
    """Prepare a robot for the simulation.

    Args:
        description: the robot.
        wheels: its driven wheels; if there are none, its base is fixed.
        commanded: names of joints that follow positions, besides those that steer.
        positions: start positions of joints, rad or m; they override those of ``<ros2_control>``.

    Raises:
        OneBotError: a named joint does not move, a commanded one mimics another, or a wheel with
            rollers has no round shape.
    """
    commanded = (*commanded, *wheels.steering)
    tyres = {name: wheels.tyres.tyre(name) for name in (*wheels.names, *wheels.free)}
    casters = casters_of(wheels, commanded)
    roles = _Roles(description, {*tyres, *casters}, commanded, positions)
    weight = _GRAVITY * wheels.robot.mass
    joints = []
    for joint in description.joints:
        if joint.name in roles.fixed:
            joint = _fixed(joint, roles.fixed[joint.name])
        elif joint.name in wheels.names:
            joint = _motor(joint, weight, tyres[joint.name])
            if wheels.skids:
                joint = SkidAxle(**vars(joint))
        elif joint.name in roles.starts:
            interfaces = description.interfaces.get(joint.name)
            if joint.name in wheels.steering:
                joint = _steering(
                    joint, weight * max(tyre.radius for tyre in tyres.values() if tyre)
                )
            joint = _positioned(joint, interfaces, is_gear=joint.name in roles.gears)
        joints.append(joint)
    rigid = replace(description, joints=tuple(joints))
    links: Sequence[Link] = rigid.links
    if wheels.names:
        moved = {*roles.starts, *roles.passive}
        contacts = Contacts(rigid, tyres, casters, moved, steers=bool(wheels.steering))
        links = [_massive(wheels, contacts.changed(link)) for link in links]
    links = _with_rotors(replace(rigid, links=tuple(links)), roles.starts, roles.gears)
    _report_held(description, roles.held, commanded)
    _report_hulls(rigid, {*roles.gears, *(mimic.joint for mimic in roles.gears.values())})
    rigid = replace(rigid, links=tuple(links))
    if wheels.rollers:
        rollers = {name: (wheels.tyre(name), angle) for name, angle in wheels.rollers.items()}
        rigid = with_rollers(rigid, rollers)
    return RobotSpawn(
        rigid,
        driven=wheels.names,
        commanded=commanded,
        steering=wheels.steering,
        gears=roles.gears,
        starts={**roles.starts, **roles.passive},
        fixed_base=not wheels.names,
        links=description.links,
        held=roles.held,
        wheel_mimics=roles.wheel_mimics,
    )


def without_limits(description: Description, joints: Collection[str]) -> Description:
    """Remove the limits of command interfaces of some joints, and report them."""
    listed = description.interfaces
    free = {name: listed[name]._replace(limits={}) for name in joints if name in listed}
    if limited := [name for name in free if listed[name].limits]:
        text = "do not limit it, because enforce_command_limits is false"
        place = f"{description.source}: joint {listing(limited)}"
        logger.warning("%s: min and max of <command_interface> %s", place, text)
    return replace(description, interfaces={**listed, **free}) if limited else description


def commandable(description: Description, wheels: Wheels) -> list[str]:
    """Return the joints that a controller commands if its parameters do not name any.

    These are the joints with a position command interface in ``<ros2_control>``, except wheels; if
    there are none, all moving joints that it does not list, except wheels, casters and joints that
    carry them. Mimic joints are always excluded.
    """
    joints = [joint.name for joint in description.moving_joints if joint.mimic is None]
    positioned = description.positioned - {*wheels.joints}
    named = [joint for joint in joints if joint in positioned]
    excluded_names = {*description.interfaces, *_rolling(wheels)}
    return named or [joint for joint in joints if joint not in excluded_names]


def _rolling(wheels: Wheels) -> set[str]:
    """Return the joints of wheels and casters, and those that carry them."""
    rolling = {*wheels.names, *wheels.free, *casters_of(wheels)}
    chains = [chain for chain in _chains(wheels) if chain[0].name in rolling]
    return {joint.name for chain in chains for joint in chain}


def _chains(wheels: Wheels) -> list[list[Joint]]:
    """Return, for each moving joint, the joint and all moving joints above it, up to the base."""
    moving = {joint.child: joint for joint in wheels.description.moving_joints}
    chains = [[joint] for joint in moving.values()]
    for chain in chains:
        while above := moving.get(wheels.rigid[chain[-1].parent][0]):
            chain.append(above)
    return chains


class _Roles:
    """Decides how each moving joint is simulated.

    Attributes:
        held: positions of joints that do not move, by name.
        wheel_mimics: how joints mimic wheels, casters and joints that swing freely, by name.
        fixed: start positions of both of these, by name.
        gears: gears of the joints that follow commanded joints, by name.
        starts: start positions of commanded joints and gears, by name.
        passive: start positions of joints that swing freely, by name.
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
        self._check_starts(positions, interfaces)
        of_file = {name: it.start for name, it in interfaces.items() if it.start is not None}
        given = {**dict.fromkeys(self._joints, 0.0), **of_file, **positions}
        own = {name: clamp(given[name], *joint.range) for name, joint in self._joints.items()}
        mimics = {name: joint.mimic for name, joint in self._joints.items() if joint.mimic}
        free = self._joints.keys() - {*mimics, *rolling, *commanded}
        self.passive = {
            name: own[name]
            for name, listed in interfaces.items()
            if name in free and not listed.commands
        }
        own |= dict.fromkeys(rolling, 0.0)
        self.fixed: dict[str, float] = {}
        self.held: dict[str, float] = {}
        self.wheel_mimics: dict[str, Mimic] = {}
        self.gears: dict[str, Mimic] = {}
        self.starts: dict[str, float] = {}
        leaders = self._joints.keys() - (mimics.keys() - {*rolling, *commanded})
        for name, mimic in reduced_mimics(self._joints, mimics, leaders).items():
            leader, at = mimic.joint, mimic.at(own[mimic.joint])
            rolls = leader in rolling or leader in self.passive
            if leader in commanded and mimic.multiplier:
                self.starts[name] = at
                if name != leader:
                    self.gears[name] = mimic
            elif not (rolls and name == leader):
                self.fixed[name] = clamp(at, *self._joints[name].range)
                if rolls:
                    self.wheel_mimics[name] = mimic
                else:
                    self.held[name] = self.fixed[name]

    def _check(
        self, description: Description, names: Collection[str], commanded: Collection[str]
    ) -> None:
        for name in names:
            where = f'{description.source}: joint "{name}"'
            if name not in self._joints:
                raise OneBotError(f"{where} does not move{did_you_mean(name, self._joints)}")
            if name in commanded and (mimic := self._joints[name].mimic):
                text = f'follows "{mimic.joint}" by <mimic>; command that joint'
                raise OneBotError(f"{where} {text}")

    def _check_starts(
        self, positions: Mapping[str, float], interfaces: Mapping[str, JointInterfaces]
    ) -> None:
        """Raise OneBotError if a start position is beyond its joint's limits."""
        for name, at in positions.items():
            limits = interfaces[name].limits if name in interfaces else {}
            if fault := self._joints[name].start_fault(at, *limits.get("position", ())):
                raise OneBotError(f"initial_positions.{name}: {fault}")


def _positioned(joint: Joint, interfaces: JointInterfaces | None, *, is_gear: bool) -> Joint:
    """Return a joint with a motor that follows positions, or with a gear.

    A gear has its leader's limits. The motor accounts for the joint's friction; see ``RobotBody``.

    Args:
        joint: the joint.
        interfaces: its ``<ros2_control>`` interfaces, whose velocity and effort limits also apply.
        is_gear: whether it is moved by another joint's motor.
    """
    limits = interfaces.limits if interfaces else {}
    fastest, strongest = (
        min(value or math.inf, *map(abs, limits.get(name, (math.inf, math.inf))))
        for name, value in (("velocity", joint.velocity), ("effort", joint.effort))
    )
    joint = replace(
        joint,
        effort=strongest if strongest < math.inf else _UNLIMITED,
        velocity=fastest if fastest < math.inf else None,
        mimic=None,
    )
    if is_gear and joint.kind != "continuous":
        return replace(joint, lower=1.0, upper=-1.0)  # PyBullet's notation for no limits
    return joint


def _steering(joint: Joint, effort: float) -> Joint:
    """Return a joint that steers, with default motor limits where none are given."""
    fastest = min(joint.velocity or STEERING_SPEED, STEERING_SPEED)
    return replace(joint, effort=joint.effort or effort, velocity=fastest)


def _report_held(
    description: Description, held: Collection[str], commanded: Collection[str]
) -> None:
    """Warn about fixed joints, if others are commanded or they have other interfaces."""
    listed = description.interfaces
    driven = {name for name in listed if listed[name].commands}
    leaders = [
        joint.name
        for joint in description.moving_joints
        if joint.name in held and joint.mimic is None and (commanded or joint.name in driven)
    ]
    if leaders:
        logger.warning(
            "%s: joint %s: held still, because no controller moves it; name it in a controller's "
            "parameter joints, or give it a position command interface in <ros2_control>",
            description.source,
            listing(leaders),
        )


def _report_hulls(rigid: Description, fingers: Collection[str]) -> None:
    """Warn about fingers with hollow or bent meshes: their convex hulls touch the object.

    Args:
        rigid: the robot; joints that are held still are fixed.
        fingers: names of the joints that move the fingers.
    """
    bodies = merged_bodies(rigid) if fingers else {}
    hollow = [
        link.name
        for joint in rigid.joints
        if joint.name in fingers
        for shape, _, link in bodies[joint.child].collisions
        if isinstance(shape, Mesh) and _is_hollow(shape)
    ]
    if hollow:
        logger.warning(
            "%s: link %s: a collision mesh fills less than half of its convex hull, which is used "
            "for contacts; to grip well, fingers need boxes or several convex meshes",
            rigid.source,
            listing(dict.fromkeys(hollow)),
        )


def _is_hollow(mesh: Mesh) -> bool:
    from trimesh import Trimesh  # slow to import, and few grippers have meshes

    try:
        solid = Trimesh(*read_mesh(mesh))
    except OneBotError:  # raised again, with the links, when the robot is loaded
        return False
    return bool(solid.is_volume and solid.volume < _FILLED * solid.convex_hull.volume)


def _with_rotors(
    rigid: Description, moved: Collection[str], gears: Mapping[str, Mimic]
) -> Sequence[Link]:
    """Return the links, with at least the minimum inertia behind each of the ``moved`` joints.

    Links without mass get this minimum, and are reported.
    """
    if not moved:
        return rigid.links
    bodies = merged_bodies(rigid)
    joints = {joint.child: joint for joint in rigid.joints if joint.name in moved}
    if weightless := [link for link in joints if bodies[link].mass <= 0.0]:
        logger.warning(
            "%s: link %s: no <inertial>, simulated with %g kg; efforts are wrong until they have "
            "mass and inertia",
            rigid.source,
            listing(weightless),
            _MIN_MASS,
        )
    efforts = {joint.name: joint.effort or _UNLIMITED for joint in joints.values()}
    leaders = {name: mimic.joint for name, mimic in gears.items()}
    leaders |= {name: name for name in leaders.values()}

    def minimum(joint: str) -> float:
        effort = efforts[leaders[joint]] if joint in leaders else 0.0
        return max(_MIN_MOMENT, _MIN_GEARED * effort if effort < _UNLIMITED else 0.0)

    return [
        _with_rotor(link, joint, bodies[link.name], minimum(joint.name))
        if (joint := joints.get(link.name))
        else link
        for link in rigid.links
    ]


def _with_rotor(link: Link, joint: Joint, body: Body, minimum: float) -> Link:
    """Return a link with mass and inertia added until its ``body`` has the minimum.

    ``minimum`` is the minimum moment of inertia about the axis of a rotating joint, kg m^2.
    """
    axis = np.array(joint.axis)
    arm = body.center - (body.center @ axis) * axis
    moment = float(axis @ body.inertia @ axis + body.mass * (arm @ arm))
    mass = 0.0
    if joint.kind == "prismatic" or body.mass <= 0.0:
        mass = max(0.0, _MIN_MASS - body.mass)
    missing = 0.0 if joint.kind == "prismatic" and body.mass > 0.0 else minimum - moment
    if mass == 0.0 and missing <= 0.0:
        return link
    total = Body(link.name)
    total.add(link, np.eye(4))
    total.add_mass(mass, body.center, _thin_ring(axis, max(0.0, missing)))
    return replace(link, inertial=total.inertial)


def _thin_ring(axis: Floats, moment: float) -> Floats:
    """Return the inertia (3, 3) of a thin ring with this moment about its axis."""
    return moment / 2.0 * (np.outer(axis, axis) + np.eye(3))


def casters_of(wheels: Wheels, commanded: Collection[str] = ()) -> Collection[str]:
    """Return the swivelling and rolling joints of casters.

    They are continuous, as are all joints between them and the base. Driven, mimic and
    ``commanded`` joints and joints with a position command interface are excluded. A robot without
    driven wheels has none.
    """
    if not wheels.names:
        return ()
    chains, bound = _chains(wheels), {*commanded, *wheels.description.positioned}
    for chain in chains:
        if any(joint.kind != "continuous" or joint.mimic is not None for joint in chain):
            bound.update(joint.name for joint in chain)
    return {chain[0].name for chain in chains} - bound - {*wheels.names, *wheels.free}


def _fixed(joint: Joint, position: float) -> Joint:
    """Return a joint fixed at a position."""
    if not position:
        return replace(joint, kind="fixed", mimic=None)
    moved = np.eye(4)
    if joint.kind == "prismatic":
        moved[:3, 3] = np.array(joint.axis) * position
    else:
        moved[:3, :3] = quaternions.to_matrix(about(joint.axis, position))
    origin = matrices.to_origin(matrices.of_origin(joint.origin) @ moved)
    return replace(joint, kind="fixed", origin=origin, mimic=None)


def _motor(joint: Joint, weight: float, tyre: Tyre | None) -> Joint:
    radius = tyre.radius if tyre else 1.0
    # A robot without mass is rejected later, when it is loaded.
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
    """Return a link; a driven wheel gets the inertia that the simulation needs."""
    if wheels.rollers:  # ``with_rollers`` sets its own inertias
        return link
    first, _ = wheels.rigid[link.name]
    driven = {wheels.axles[name].joint.child: name for name in wheels.names}
    tyre = wheels.tyres.tyre(driven[first]) if first in driven else None
    if tyre is None:
        return link
    if wheels.skids:
        ring = _ring(wheels, driven[first], tyre) if link.name == first else None
        return replace(link, inertial=ring)
    if link.name != first or link.inertial is None:
        return link
    minimum = _LIGHTEST * wheels.robot.mass * tyre.radius**2
    return replace(
        link, inertial=_no_lighter(link.inertial, wheels.axles[driven[first]].joint, minimum)
    )


def _no_lighter(inertial: Inertial, joint: Joint, minimum: float) -> Inertial:
    """Return the inertia of a wheel, with at least ``minimum`` kg m^2 about its axle."""
    along = matrices.of_origin(inertial.origin)[:3, :3].T @ np.array(joint.axis)
    rows, columns = np.triu_indices(3)
    tensor = np.zeros((3, 3))
    tensor[rows, columns] = tensor[columns, rows] = inertial.inertia
    missing = max(0.0, minimum - float(along @ tensor @ along))
    tensor += _thin_ring(along, missing)
    return replace(inertial, inertia=tuple(tensor[rows, columns].tolist()))


def _ring(wheels: Wheels, name: str, tyre: Tyre) -> Inertial | None:
    """Return the whole mass of a skidding wheel for the wheel's own link; None without mass."""
    joint = wheels.axles[name].joint
    body = merged_bodies(wheels.description)[joint.child]
    if body.mass <= 0.0:
        return None
    body.inertia = _thin_ring(np.array(joint.axis), _moment(wheels, name, tyre, body.mass))
    return body.inertial


def _moment(wheels: Wheels, name: str, tyre: Tyre, mass: float) -> float:
    """Return a wheel's moment of inertia about its axle for isotropic skidding.

    With it, a push moves the wheel's contact equally in both directions: along the robot, where the
    wheel turns, and across, where it slides on its axle; see ``SkidAxle``.
    """
    robot_body = wheels.robot
    places = {wheel: wheels.middle(wheel) - robot_body.center for wheel in wheels.names}
    _, y, z = places[name]
    roll, pitch, yaw = np.diag(robot_body.inertia)
    # As the wheels slide on their axles, their mass does not resist the robot's turning.
    yaw = max(yaw - mass * total(place[0] ** 2 for place in places.values()), _MIN_TURNING * yaw)
    sideways = 1.0 / mass + tyre.radius**2 / roll
    base = 1.0 / robot_body.mass + y**2 / yaw + z**2 / pitch
    return float(tyre.radius**2 / max(sideways - base, _MIN_TURNING * sideways))
