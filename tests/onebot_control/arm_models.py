"""Small arms and grippers as URDF, and the mechanics that the simulation is compared with."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet_data
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from onebot_description.description import Description, load_description, parse_description
from onebot_description.description.description import Joint
from onebot_description.geometry.poses import Origin

GRAVITY = 9.81  # m/s^2
MRM = "package://mrm_description/urdf/mrm.xacro"
PANDA = "franka_panda/panda.urdf"
HAND_DOWN = {"panda_joint2": -0.4, "panda_joint4": -2.2, "panda_joint6": 1.8}  # rad

Floats = NDArray[np.float64]
Values = Mapping[str, float]  # by joint


# URDF -------------------------------------------------------------------------------------------


def link(
    name: str, mass: float = 0.0, centre: str = "0 0 0", moment: float = 1e-3, shape: str = ""
) -> str:
    """A link, with the same moment of inertia about all axes; without <inertial> if mass is 0."""
    values = " ".join(f'{axis}="{moment}"' for axis in ("ixx", "iyy", "izz"))
    inertial = (
        f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia {values} ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    return f'<link name="{name}">{inertial if mass else ""}{shape}</link>'


def box(size: str, xyz: str = "0 0 0") -> str:
    """A collision shape."""
    return f'<collision><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry></collision>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    axis: str = "0 1 0",
    xyz: str = "0 0 0",
    *,
    limits: str = 'lower="-2" upper="2" effort="100" velocity="2"',
    more: str = "",
) -> str:
    """A joint; ``more`` are further elements, such as <mimic>."""
    limit = "" if kind in ("fixed", "continuous") else f"<limit {limits}/>"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def mimic(leader: str, multiplier: float = 1.0, offset: float = 0.0) -> str:
    """What makes a joint follow another one."""
    return f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/>'


def interfaces(name: str, command: str = "", start: float | None = None) -> str:
    """A <ros2_control> block about one joint."""
    has_command = f'<command_interface name="{command}"/>' if command else ""
    value = "" if start is None else f'<param name="initial_value">{start}</param>'
    return (
        f'<ros2_control name="{name}" type="system"><joint name="{name}">{has_command}'
        f'<state_interface name="position">{value}</state_interface></joint></ros2_control>'
    )


def arm(*parts: str) -> Description:
    """A robot of ``parts`` on the link ``world``."""
    return parse_description(f'<robot name="arm"><link name="world"/>{"".join(parts)}</robot>')


def rod(
    limits: str = 'lower="-2" upper="2" effort="100" velocity="2"', more: str = ""
) -> Description:
    """A rod of ``ROD`` that lies along x at 0 and turns down, 3 m above the ground."""
    body = link("rod", ROD.mass, f"{ROD.length} 0 0", ROD.moment)
    return arm(body, joint("elbow", "world", "rod", xyz="0 0 3", limits=limits, more=more))


class Rod(NamedTuple):
    """What ``rod`` is made of."""

    mass: float  # kg
    length: float  # m, from the joint to the centre of mass
    moment: float  # kg m^2, about the centre of mass

    @property
    def load(self) -> float:
        """The moment of its weight while it lies level: m g l, Nm."""
        return self.mass * GRAVITY * self.length

    @property
    def inertia(self) -> float:
        """Its moment of inertia about the joint: J, kg m^2."""
        return self.moment + self.mass * self.length**2


ROD = Rod(2.0, 0.5, 0.05)


def box_world(edge: float = 0.05, xyz: str = "0 0 0.025") -> Description:
    """A world with a cube of 50 g and friction 1 that can be lifted."""
    moment = 0.05 * edge**2 / 6
    cube = link("box", 0.05, moment=moment, shape=box(f"{edge} {edge} {edge}"))
    return arm(cube, joint("free", "world", "box", "floating", xyz=xyz))


def two_fingers(mass: float) -> Description:
    """A gripper on a vertical rail, whose fingers of so many kg close along y with 20 N."""
    limits = 'lower="0" upper="0.05" effort="20" velocity="0.2"'
    parts = [
        link("palm", 0.5),
        joint(
            "lift",
            "world",
            "palm",
            "prismatic",
            "0 0 1",
            "0 0 0.085",
            limits='lower="0" upper="1" effort="100" velocity="1"',
        ),
    ]
    for side, sign in (("left", 1), ("right", -1)):
        shape = box("0.02 0.01 0.04", f"0 {0.005 * sign} -0.04")
        follows = mimic("left") if side == "right" else ""
        axis = f"0 {sign} 0"
        parts += [
            link(f"{side}_finger", mass, moment=mass * 1e-4, shape=shape),
            joint(side, "palm", f"{side}_finger", "prismatic", axis, limits=limits, more=follows),
        ]
    return arm(*parts)


LINKAGE = {  # multipliers of the joints that mimic "left_knuckle"
    "right_knuckle": -1.0,
    "left_inner": 1.0,
    "right_inner": -1.0,
    "left_tip": -1.0,
    "right_tip": 1.0,
}


def linkage(effort: float) -> Description:
    """A gripper as Robotiq's 2F-85, on a vertical rail: six joints turn as one, with ``effort``."""
    parts = [
        link("palm", 0.5),
        '<joint name="lift" type="prismatic"><parent link="world"/><child link="palm"/>'
        '<origin xyz="0 0 0.155" rpy="3.14159265358979 0 0"/><axis xyz="0 0 -1"/>'
        '<limit lower="0" upper="1" effort="100" velocity="1"/></joint>',
    ]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        pad = box("0.008 0.022 0.04", f"{-0.02 * sign} 0 0.02")
        for name, parent, child, xyz, shape in (
            (f"{side}_knuckle", "palm", f"{side}_finger", f"{0.0306 * sign} 0 0.0549", ""),
            (f"{side}_inner", "palm", f"{side}_bar", f"{0.0127 * sign} 0 0.0614", ""),
            (f"{side}_tip", f"{side}_finger", f"{side}_pad", f"{0.0373 * sign} 0 0.043", pad),
        ):
            follows = mimic("left_knuckle", LINKAGE[name]) if name in LINKAGE else ""
            limits = f'lower="-0.8" upper="0.8" effort="{effort}" velocity="2"'
            parts += [
                link(child, 0.02, moment=3e-6, shape=shape),
                joint(name, parent, child, axis="0 -1 0", xyz=xyz, limits=limits, more=follows),
            ]
    return arm(*parts)


@cache
def public_arm(file: str, *, bare: bool = True) -> Description:
    """An arm of pybullet_data, or MRM; ``bare``: without shapes, which take seconds to read."""
    path = file if ":" in file else f"{pybullet_data.getDataPath()}/{file}"
    description = load_description(path)
    if not bare:
        return description
    links = [replace(each, visuals=(), collisions=()) for each in description.links]
    return replace(description, links=tuple(links))


def panda(effort: float) -> Description:
    """The Panda with its hand, whose motor for both fingers has so many N."""
    file = Path(pybullet_data.getDataPath()) / PANDA
    text = file.read_text().replace('effort="20"', f'effort="{effort}"')
    return parse_description(text, str(file))


# Mechanics --------------------------------------------------------------------------------------


class Motion(NamedTuple):
    """A frame's pose and motion in the world."""

    turn: Floats  # (3, 3)
    place: Floats  # m
    spin: Floats  # angular velocity, rad/s
    spin_up: Floats  # its derivative, rad/s^2
    acceleration: Floats  # of the origin, less gravity's, m/s^2

    def carried(self, arm: Floats) -> Floats:
        """The acceleration of a point that is ``arm`` away, and moves along."""
        return (
            self.acceleration
            + np.cross(self.spin_up, arm)
            + np.cross(self.spin, np.cross(self.spin, arm))
        )


def motions(
    description: Description, at: Values, speeds: Values, accelerations: Values
) -> dict[str, Motion]:
    """The motion of each link's frame; parents come before children."""
    zero = np.zeros(3)
    found = {
        description.root_link: Motion(np.eye(3), zero, zero, zero, np.array([0.0, 0.0, GRAVITY]))
    }
    for each in _downwards(description):
        motion = _fixed(found[each.parent], each.origin)
        values = (of.get(each.name, 0.0) for of in (at, speeds, accelerations))
        found[each.child] = motion if each.kind == "fixed" else _moved(motion, each, *values)
    return found


def _downwards(description: Description) -> Iterable[Joint]:
    """Yield the joints, each after the one that carries it."""
    known, left = {description.root_link}, list(description.joints)
    while left:
        each = next(each for each in left if each.parent in known)
        left.remove(each)
        known.add(each.child)
        yield each


def _fixed(parent: Motion, origin: Origin) -> Motion:
    """The motion of a frame that is fixed to another one."""
    arm = parent.turn @ np.array(origin.xyz)
    turn = parent.turn @ Rotation.from_euler("xyz", origin.rpy).as_matrix()
    return parent._replace(turn=turn, place=parent.place + arm, acceleration=parent.carried(arm))


def _moved(frame: Motion, moving: Joint, at: float, speed: float, acceleration: float) -> Motion:
    """The motion of a frame that a joint moves."""
    axis = frame.turn @ np.array(moving.axis)
    if moving.kind == "prismatic":
        coriolis = 2.0 * np.cross(frame.spin, axis * speed)
        return frame._replace(
            place=frame.place + axis * at,
            acceleration=frame.carried(axis * at) + coriolis + axis * acceleration,
        )
    return frame._replace(
        turn=frame.turn @ Rotation.from_rotvec(np.array(moving.axis) * at).as_matrix(),
        spin=frame.spin + axis * speed,
        spin_up=frame.spin_up + axis * acceleration + np.cross(frame.spin, axis * speed),
    )


def newton_euler(
    description: Description, at: Values, speeds: Values, accelerations: Values
) -> dict[str, float]:
    """The effort of each joint by the recursive Newton-Euler algorithm, Nm or N.

    It has to overcome damping and friction, and moves what mimics it, whose effort is 0.
    """
    found = motions(description, at, speeds, accelerations)
    # Forces, and their moments about the origin of the world, that links need from below.
    forces = {name: np.zeros(3) for name in found}
    moments = {name: np.zeros(3) for name in found}
    for each in description.links:
        if each.inertial is not None:
            motion = _fixed(found[each.name], each.inertial.origin)
            xx, xy, xz, yy, yz, zz = each.inertial.inertia
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            inertia = motion.turn @ tensor @ motion.turn.T
            forces[each.name] = each.inertial.mass * motion.acceleration
            moments[each.name] = (
                inertia @ motion.spin_up
                + np.cross(motion.spin, inertia @ motion.spin)
                + np.cross(motion.place, forces[each.name])
            )
    efforts: dict[str, float] = {}
    for each in reversed([*_downwards(description)]):
        motion, force, moment = found[each.child], forces[each.child], moments[each.child]
        along = force if each.kind == "prismatic" else moment - np.cross(motion.place, force)
        speed = speeds.get(each.name, 0.0)
        efforts[each.name] = float(motion.turn @ np.array(each.axis) @ along)
        efforts[each.name] += each.damping * speed + each.friction * float(np.sign(speed))
        forces[each.parent] = forces[each.parent] + force
        moments[each.parent] = moments[each.parent] + moment
    for each in description.joints:
        if each.mimic is not None:
            efforts[each.mimic.joint] += each.mimic.multiplier * efforts.pop(each.name)
            efforts[each.name] = 0.0
    return efforts
