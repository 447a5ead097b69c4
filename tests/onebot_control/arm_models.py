"""Small arms and grippers as URDF, and the mechanics that the simulation is compared with."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet_data

from onebot_control import Simulation
from onebot_description.description import Description, load_description, parse_description

GRAVITY = 9.81  # m/s^2
RATE = 200.0  # Hz, of control cycles: one in each physics step
MRM = "package://mrm_description/urdf/mrm.xacro"
PANDA = "franka_panda/panda.urdf"
HAND_DOWN = {"panda_joint2": -0.4, "panda_joint4": -2.2, "panda_joint6": 1.8}  # rad

Values = Mapping[str, float]  # by joint


# URDF -------------------------------------------------------------------------------------------


def link(
    name: str, mass: float = 0.0, center: str = "0 0 0", moment: float = 1e-3, shape: str = ""
) -> str:
    """A link, with the same moment of inertia about all axes; without <inertial> if mass is 0."""
    values = " ".join(f'{axis}="{moment}"' for axis in ("ixx", "iyy", "izz"))
    inertial = (
        f'<inertial><origin xyz="{center}"/><mass value="{mass}"/>'
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
    rpy: str = "0 0 0",
    more: str = "",
) -> str:
    """A joint; ``more`` are further elements, such as <mimic>."""
    limit = "" if kind in ("fixed", "continuous") else f"<limit {limits}/>"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}{more}</joint>'
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
    length: float  # m, from the joint to the center of mass
    moment: float  # kg m^2, about the center of mass

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


def robotiq(effort: float) -> Description:
    """Robotiq's 2F-85 by its maker's figures, on a vertical rail, with so many Nm."""
    file = Path(__file__).parents[1] / "robots" / "arms" / "gen3_2f85.urdf"
    text = file.read_text()
    start, end = text.index('<link name="robotiq_85_base_link">'), text.index("<ros2_control")
    rail = (
        '<joint name="lift" type="prismatic"><parent link="world"/>'
        '<child link="robotiq_85_base_link"/><origin xyz="0 0 0.165" rpy="3.14159265358979 0 0"/>'
        '<axis xyz="0 0 -1"/><limit lower="0" upper="1" effort="1000" velocity="1"/></joint>'
    )
    return arm(rail, text[start:end].replace('effort="50"', f'effort="{effort}"'))


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


# Motion -----------------------------------------------------------------------------------------


def simulate(
    description: Description | Path,
    starts: Mapping[str, float] | None = None,
    world: Description | str = "",
    rate: float = RATE,
) -> Simulation:
    """The robot, its joints at ``starts``."""
    given = {f"initial_positions.{name}": value for name, value in (starts or {}).items()}
    return Simulation(description, world=world, parameters={"update_rate": rate, **given})


def quintic(share: float) -> float:
    """How much of a motion is done after a share of its time, at rest at both ends."""
    return 10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5


# Mechanics --------------------------------------------------------------------------------------


def newton_euler(
    simulation: Simulation, at: Values, speeds: Values, accelerations: Values
) -> dict[str, float]:
    """The effort of each joint by the recursive Newton-Euler algorithm, Nm or N.

    Bullet has it apart from its simulation. The effort has to overcome damping and friction, and
    moves what mimics the joint, whose effort is 0.
    """
    parts = simulation._core.fleet.robots[0].body.parts
    names = sorted(parts.joints, key=parts.joints.__getitem__)
    rows = [[of.get(name, 0.0) for name in names] for of in (at, speeds, accelerations)]
    found = parts.bullet.calculateInverseDynamics(parts.body, *rows)
    efforts = dict(zip(names, found, strict=True))
    moving = simulation.robot.description.moving_joints
    for each in moving:
        speed = speeds.get(each.name, 0.0)
        efforts[each.name] += each.damping * speed + each.friction * float(np.sign(speed))
    for each in moving:
        if each.mimic is not None:
            efforts[each.mimic.joint] += each.mimic.multiplier * efforts.pop(each.name)
            efforts[each.name] = 0.0
    return efforts
