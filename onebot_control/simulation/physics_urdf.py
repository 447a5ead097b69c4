"""The URDF that PyBullet is given: bodies instead of links, and nothing that does not matter."""

import copy
import math
from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np

from onebot_control.simulation.bodies import (
    Body,
    Element,
    Floats,
    matrix,
    moving_joints,
    number,
    placements,
    rigid_bodies,
)
from onebot_description.description import Description, JointSpec
from onebot_description.description.meshes import to_text
from onebot_description.errors import OneBotError

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
