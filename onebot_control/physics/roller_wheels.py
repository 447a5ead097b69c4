"""Simulates wheels with rollers on their rims, as mecanum and omni wheels have.

At the ground, such a wheel grips along its roller's axle, and the roller turns freely across it. In
the direction of the grip, its contact moves like that of a plain wheel of radius r cos(a) if the
wheel's radius is r and the roller's axle is a away from forward, which turns as fast about a level
axle across the grip. This wheel is simulated. As the forces at the contact are the same, so are all
forces and torques on the robot and on the wheel's motor.

The wheel slides freely on its axle, as the roller turns. Before each step, it is put back to its
place on the axle, and keeps its velocity. So friction, which is limited by the load, acts along the
grip only.
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

# Mass of a simulated wheel, as a fraction of the robot's. As it slides, it does not resist a push
# across the grip: four wheels make the robot 5 % lighter there. With less, the solver takes longer.
_MASS = 0.025
_UP = np.array([0.0, 0.0, 1.0])
_RING = np.diag([0.5, 0.5, 1.0])  # inertia (3, 3) of a thin ring about z, by its moment about z


@dataclass(frozen=True)
class RollerAxle(SkidAxle):
    """The joint of the plain wheel that is simulated for one with rollers; z is its axis."""


def has_rollers(description: Description) -> bool:
    """Return whether a robot to simulate has wheels with rollers."""
    return any(isinstance(joint, RollerAxle) for joint in description.joints)


def with_rollers(
    description: Description, rollers: Mapping[str, tuple[Tyre, float]]
) -> Description:
    """Return a robot whose wheels with rollers are those to simulate.

    The positive velocity of such a wheel drives it forward, to the right of its joint's axis seen
    from above.

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
    """Return the simulated joint of a wheel, and its rotation (3, 3) in the written joint's frame.

    Args:
        joint: the wheel's joint, as written.
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
    """Return the link that carries a wheel, with the wheel's mass where it is written.

    Args:
        carrier: the link.
        joint: the wheel's joint, as written.
        wheel: the wheel, as written.
        mass: of the simulated wheel, kg, which is left out.
        rest: inertia (3, 3) of the wheel, but for that of the simulated one, kg m^2.
    """
    written, body = matrices.of_origin(joint.origin), Body(carrier.name)
    body.add(carrier, np.eye(4))
    center = matrices.transformed(wheel.center[None], written)[0]
    body.add_mass(wheel.mass - mass, center, written[:3, :3] @ rest @ written[:3, :3].T)
    return replace(carrier, inertial=body.inertial)


def _ball(link: Link, ball: Sphere, mass: float, moment: float) -> Link:
    """Return the link of a simulated wheel, a ``ball``, which touches the ground in one point."""
    body = Body(link.name)
    body.add_mass(mass, np.zeros(3), moment * _RING)
    return replace(link, collisions=(Geometry(ball, Origin()),), inertial=body.inertial)
