"""Simulates wheels with rollers on their rims: mecanum and omni wheels.

At the ground, such a wheel grips along its roller's axle, and the roller turns freely across it.
Let r be the wheel's radius, and a the angle of the roller's axle to forward. In the direction of
the grip, the contact moves like that of a plain wheel of radius r cos(a) with the same angular
velocity about a level axle across the grip. This plain wheel is simulated. As the forces at the
contact are the same, so are all forces and torques on the robot and the wheel's motor.

The wheel slides freely on its axle, like the turning roller. Before each step, it is moved back to
its place on the axle, and keeps its velocity. So friction, which is limited by the load, only acts
along the grip.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from onebot_control.drive.wheels.rolling_shapes import Tyre
from onebot_control.physics.physics_urdf import SkidAxle
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description, Geometry, Joint, Link, Sphere
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Origin, total
from onebot_description.model import RobotModel
from onebot_description.model.rigid_bodies import Body, merged_bodies, rigid_frames

# Mass of a simulated wheel, as a fraction of the robot's. A sliding wheel does not resist a push
# across the grip: with four wheels, the robot seems 5 % lighter. With less, the solver is slower.
_MASS = 0.025
_UP = np.array([0.0, 0.0, 1.0])
_RING = np.diag([0.5, 0.5, 1.0])  # inertia (3, 3) of a thin ring about z, by its moment about z


@dataclass(frozen=True)
class RollerAxle(SkidAxle):
    """The joint of the plain wheel that replaces a wheel with rollers; z is its axis."""


def has_rollers(description: Description) -> bool:
    """Return whether a simulated robot has wheels with rollers."""
    return any(isinstance(joint, RollerAxle) for joint in description.joints)


def with_rollers(
    description: Description, rollers: Mapping[str, tuple[Tyre, float]]
) -> Description:
    """Return a robot whose wheels with rollers are replaced by simulated wheels.

    A positive velocity of such a wheel drives it forward: seen from above, to the right of its
    joint's axis.

    Args:
        description: the robot.
        rollers: by the names of joints, the shapes of these wheels, and the directions of the axles
            of the rollers at the ground, rad to the left of forward: 0 for an omni wheel; for
            mecanum wheels pi/4 at the front right and rear left, -pi/4 at the others.
    """
    places = RobotModel.from_description(description).link_matrices({})
    bodies, frames = merged_bodies(description), rigid_frames(description)
    mass = _MASS * total(body.mass for body in bodies.values())
    links = {link.name: link for link in description.links}
    joints = []
    for joint in description.joints:
        if joint.name in rollers:
            (tyre, angle), body = rollers[joint.name], bodies[joint.child]
            axle, turn = _axle(joint, tyre, angle, places[joint.parent])
            moment = float(np.array(joint.axis) @ body.inertia @ np.array(joint.axis))
            moment = max(moment, mass * tyre.radius**2)
            hub_inertia = body.inertia - moment * turn @ _RING @ turn.T
            links[joint.parent] = _loaded(links[joint.parent], joint, body, mass, hub_inertia)
            for name, (first, _) in frames.items():
                if first == joint.child:
                    links[name] = replace(links[name], collisions=(), inertial=None)
            ball = Sphere(tyre.radius * math.cos(angle))
            links[joint.child] = _ball(links[joint.child], ball, mass, moment)
            joint = axle
        joints.append(joint)
    return replace(description, joints=tuple(joints), links=tuple(links.values()))


def _axle(joint: Joint, tyre: Tyre, angle: float, carrier: Floats) -> tuple[RollerAxle, Floats]:
    """Return the simulated joint of a wheel, and its rotation (3, 3) in the original joint's frame.

    Args:
        joint: the wheel's original joint.
        tyre: the shape of the wheel.
        angle: direction of the roller's axle, rad to the left of forward.
        carrier: pose (4, 4) of the joint's parent in the root link's frame.
    """
    written = carrier @ matrices.of_origin(joint.origin)
    axis = np.array(joint.axis)
    forward = np.cross(written[:3, :3] @ axis, _UP)
    forward /= np.linalg.norm(forward)
    along = math.cos(angle) * forward + math.sin(angle) * np.cross(_UP, forward)
    place = np.eye(4)
    place[:3, :3] = np.column_stack([along, -_UP, np.cross(_UP, along)])
    place[:3, 3] = matrices.transformed((tyre.offset * axis)[None], written)[0]
    place[:3, 3] -= tyre.radius * (1.0 - math.cos(angle)) * _UP
    origin = matrices.to_origin(np.linalg.inv(carrier) @ place)
    changes = {"kind": "continuous", "origin": origin, "axis": (0.0, 0.0, 1.0)}
    return RollerAxle(**{**vars(joint), **changes}), written[:3, :3].T @ place[:3, :3]


def _loaded(carrier: Link, joint: Joint, wheel: Body, mass: float, rest: Floats) -> Link:
    """Return the link that carries a wheel, with the remaining mass of the original wheel.

    Args:
        carrier: the link.
        joint: the wheel's original joint.
        wheel: the original wheel.
        mass: mass of the simulated wheel, kg, which is subtracted.
        rest: inertia (3, 3) of the wheel minus that of the simulated wheel, kg m^2.
    """
    written, body = matrices.of_origin(joint.origin), Body(carrier.name)
    body.add(carrier, np.eye(4))
    center = matrices.transformed(wheel.center[None], written)[0]
    body.add_mass(wheel.mass - mass, center, written[:3, :3] @ rest @ written[:3, :3].T)
    return replace(carrier, inertial=body.inertial)


def _ball(link: Link, ball: Sphere, mass: float, moment: float) -> Link:
    """Return the link of a simulated wheel, a ``ball`` that touches the ground at one point."""
    body = Body(link.name)
    body.add_mass(mass, np.zeros(3), moment * _RING)
    return replace(link, collisions=(Geometry(ball, Origin()),), inertial=body.inertial)
