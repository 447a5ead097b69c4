"""Rigid bodies of a robot: links that fixed joints hold together, taken as one.

PyBullet gives a link without ``<inertial>`` a kilogram, computes every fixed joint as if it could
move, and merges them, if told to, with that kilogram. Here the masses are added up as written.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import Description, JointSpec
from onebot_description.description.meshes import to_text
from onebot_description.errors import OneBotError
from onebot_description.model import quaternions
from onebot_description.model.robot_model import MOVING_KINDS

Floats = NDArray[np.float64]
Element = ElementTree.Element

_MOMENTS = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))


@dataclass
class Body:
    """One rigid body, in the frame of its first link.

    Attributes:
        link: name of that link, which is nobody's child by a fixed joint.
        mass: kg.
        center: (3,), centre of mass, m.
        inertia: (3, 3), about the centre of mass, kg m^2.
        collisions: ``<collision>`` elements, each with its pose (4, 4) in the body.
        friction: lateral friction the URDF gives (the least, of several links), or None.
        dynamics: ``<dynamics>`` of the joint that moves it, or None.
    """

    link: str
    mass: float = 0.0
    center: Floats = field(default_factory=lambda: np.zeros(3))
    inertia: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    collisions: list[tuple[Element, Floats]] = field(default_factory=list)
    friction: float | None = None
    dynamics: Element | None = None

    def add(self, link: Element, pose: Floats) -> None:
        """Add the mass and the shapes of ``link``, whose frame lies at ``pose`` (4, 4)."""
        for collision in link.findall("collision"):
            self.collisions.append((collision, pose @ origin(collision)))
        stated = link.find("contact/lateral_friction")
        if stated is not None and stated.get("value"):
            value = number(stated, "value", f'link "{link.get("name")}"')
            self.friction = value if self.friction is None else min(value, self.friction)
        inertial = link.find("inertial")
        if inertial is None:
            return
        where = pose @ origin(inertial)
        mass = float(_attribute(inertial, "mass", "value"))
        moments = [[float(_attribute(inertial, "inertia", m)) for m in row] for row in _MOMENTS]
        turn = where[:3, :3]
        self._add_mass(mass, where[:3, 3], turn @ np.array(moments) @ turn.T)

    def _add_mass(self, mass: float, center: Floats, inertia: Floats) -> None:
        """Sum of two bodies by the parallel axis theorem."""
        total = self.mass + mass
        if total > 0:
            apart = center - self.center
            reduced = self.mass * mass / total
            self.inertia += reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
            self.center = self.center + apart * (mass / total)
        self.inertia += inertia
        self.mass = total


def moving_joints(description: Description) -> list[JointSpec]:
    """Return the joints that move, in the description's order."""
    return [joint for joint in description.joints if joint.kind in MOVING_KINDS]


def rigid_bodies(description: Description, robot: Element) -> dict[str, Body]:
    """Return the bodies by the name of their first link, the root's first.

    Args:
        description: says how the links hang together.
        robot: the ``<robot>`` element of its URDF.

    Raises:
        OneBotError: a joint is of a kind that is not simulated.
    """
    for joint in description.joints:
        if joint.kind in ("floating", "planar"):
            raise OneBotError(
                f'{description.source}: joint "{joint.name}" is {joint.kind}; the simulation moves '
                f"{', '.join(MOVING_KINDS)} joints"
            )
    firsts = [description.root_link, *(joint.child for joint in moving_joints(description))]
    bodies = {link: Body(link) for link in firsts}
    places = placements(description)
    for link in robot.findall("link"):
        first, pose = places[link.get("name", "")]
        bodies[first].add(link, pose)
    elements = {joint.get("name"): joint for joint in robot.findall("joint")}
    for joint in moving_joints(description):
        bodies[joint.child].dynamics = elements[joint.name].find("dynamics")
    return bodies


def placements(description: Description) -> dict[str, tuple[str, Floats]]:
    """Return, for each link, the first link of its body and its pose (4, 4) in that."""
    above = {joint.child: joint for joint in description.joints if joint.kind == "fixed"}
    places = {}
    for link in description.links:
        first, pose = link, np.eye(4)
        while first in above:
            joint = above[first]
            pose = matrix(joint.xyz, joint.rpy) @ pose
            first = joint.parent
        places[link] = first, pose
    return places


def matrix(xyz: Sequence[float], rpy: Sequence[float]) -> Floats:
    """Homogeneous transform (4, 4) of a URDF origin, m and rad."""
    result = np.eye(4)
    if any(rpy):  # Most are not turned.
        result[:3, :3] = quaternions.to_matrix(quaternions.from_rpy(np.array(rpy, float)))
    result[:3, 3] = xyz
    return result


def origin(element: Element) -> Floats:
    """Transform (4, 4) of an element's ``<origin>``, identity without one."""
    found = element.find("origin")
    attributes: Mapping[str, str] = {} if found is None else found.attrib
    xyz, rpy = (
        [float(word) for word in attributes.get(name, "0 0 0").split()] for name in ("xyz", "rpy")
    )
    return matrix(xyz, rpy)


def number(element: Element, attribute: str, owner: str) -> float:
    """Return a number the description's checks do not look at; 0 if there is none.

    Raises:
        OneBotError: it is no finite number, or negative.
    """
    text = element.get(attribute, "0")
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise OneBotError(
            f'{owner}: <{element.tag} {attribute}="{text}"> must be a number that is 0 or more'
        )
    return value


def _attribute(element: Element, child: str, attribute: str) -> str:
    found = element.find(child)
    return "0" if found is None else found.get(attribute, "0")


# The URDF that PyBullet is given: bodies instead of links, and nothing that does not matter.

# As the description's checks have it: moments are written with few digits.
_ROUNDING = 0.01


def physics_urdf(description: Description, bodies: Mapping[str, Body]) -> str:
    """Return URDF text that moves as ``description`` does.

    Links joined by fixed joints are one, visuals and extensions are gone, inertias are written
    along their principal axes. A body's name is its number in ``bodies``, a joint's its number
    among those that move: PyBullet crashes on very long names.

    Raises:
        OneBotError: the robot cannot be simulated; the message says what to mend.
    """
    robot = ElementTree.Element("robot", name="robot")
    numbers = {link: str(number) for number, link in enumerate(bodies)}
    for body in bodies.values():
        robot.append(_link(description, body, numbers[body.link]))
    places = placements(description)
    for row, joint in enumerate(moving_joints(description)):
        parent, pose = places[joint.parent]
        element = _joint(description.source, joint, bodies[joint.child].dynamics, pose)
        element.set("name", str(row))
        ElementTree.SubElement(element, "parent", link=numbers[parent])
        ElementTree.SubElement(element, "child", link=numbers[joint.child])
        robot.append(element)
    return to_text(robot)


def bodies_of(description: Description) -> dict[str, Body]:
    """Return the rigid bodies of ``description``."""
    return rigid_bodies(description, ElementTree.fromstring(description.urdf))


def _link(description: Description, body: Body, name: str) -> Element:
    link = ElementTree.Element("link", name=name)
    moments, turn = _principal(description, body)
    inertial = ElementTree.SubElement(link, "inertial")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, body.center
    inertial.append(_origin(pose))
    ElementTree.SubElement(inertial, "mass", value=repr(body.mass))
    values = {"ixy": "0", "ixz": "0", "iyz": "0"}
    values |= {name: repr(float(m)) for name, m in zip(("ixx", "iyy", "izz"), moments, strict=True)}
    ElementTree.SubElement(inertial, "inertia", values)
    for collision, where in body.collisions:
        part = ElementTree.SubElement(link, "collision")
        part.append(_origin(where))
        part.extend(copy.deepcopy(collision.findall("geometry")))
    return link


def _principal(description: Description, body: Body) -> tuple[Floats, Floats]:
    """Principal moments (3,), kg m^2, and axes (3, 3) of a body that has some."""
    where = f'{description.source}: link "{body.link}"'
    if body.mass <= 0:
        what = (
            "is the root, and stands in mid-air"
            if body.link == description.root_link
            else ("moves, and cannot be moved")
        )
        raise OneBotError(
            f"{where} {what} without a mass; give it (or a link fixed to it) an <inertial> with "
            "mass and inertia"
        )
    largest = np.abs(body.inertia).max()
    diagonal = np.diag(np.diag(body.inertia))
    if np.abs(body.inertia - diagonal).max() <= 1e-12 * largest:
        moments, axes = np.diag(diagonal).copy(), np.eye(3)
    else:
        moments, axes = np.linalg.eigh(body.inertia)
        # The axes of a rotation are right-handed.
        axes[:, 2] *= np.sign(np.linalg.det(axes))
    greatest = int(np.argmax(moments))
    others = float(moments.sum() - moments[greatest])
    if moments.min() <= 0 or moments[greatest] > others * (1 + _ROUNDING):
        shown = ", ".join(f"{moment:.3g}" for moment in sorted(moments))
        raise OneBotError(
            f"{where} has the principal moments of inertia {shown} kg m^2; all must be above 0 and "
            "none greater than the sum of the others, else it cannot be simulated"
        )
    # PyBullet drops the whole inertia where rounding puts one moment above that sum.
    moments[greatest] = min(moments[greatest], others * (1 - 1e-9))
    return moments, axes


def _joint(source: str, joint: JointSpec, dynamics: Element | None, pose: Floats) -> Element:
    """``joint``, nameless, in the body in which its parent link lies at ``pose``."""
    result = ElementTree.Element("joint", type=joint.kind)
    result.append(_origin(pose @ matrix(joint.xyz, joint.rpy)))
    ElementTree.SubElement(result, "axis", xyz=_words(joint.axis))
    limits = {name: getattr(joint, name) for name in ("lower", "upper", "effort", "velocity")}
    if joint.kind == "continuous":
        limits["lower"] = limits["upper"] = None
    ElementTree.SubElement(
        result, "limit", {name: repr(value) for name, value in limits.items() if value is not None}
    )
    if dynamics is not None:
        owner = f'{source}: joint "{joint.name}"'
        names = ("damping", "friction")
        ElementTree.SubElement(
            result, "dynamics", {name: repr(number(dynamics, name, owner)) for name in names}
        )
    return result


def _origin(pose: Floats) -> Element:
    """``<origin>`` of a transform (4, 4)."""
    turn = pose[:3, :3]
    flat = math.hypot(turn[0, 0], turn[1, 0])
    if flat > 1e-9:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:  # Upright, roll and yaw turn about the same axis.
        roll, yaw = 0.0, math.atan2(-turn[0, 1], turn[1, 1])
    rpy = (roll, math.atan2(-turn[2, 0], flat), yaw)
    return ElementTree.Element("origin", xyz=_words(pose[:3, 3]), rpy=_words(rpy))


def _words(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, float))
