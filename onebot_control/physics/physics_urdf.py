"""Writes the URDF of a robot's rigid bodies for PyBullet, with one link per body.

PyBullet itself gives a link without ``<inertial>`` a mass of 1 kg, even when it merges links, and
simulates fixed joints like moving ones.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from onebot_control.physics.engine import logger
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import (
    MOVING_KINDS,
    Box,
    Cylinder,
    Description,
    Joint,
    Mesh,
    Shape,
    Sphere,
)
from onebot_description.elements.xml import to_text
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.model.rigid_bodies import (
    Body,
    inertia_fault,
    merged_bodies,
    rigid_frames,
)

HUB = "hub"  # prefix of the names of hubs and of their joints
_HUB = 0.01  # mass of a skidding wheel's hub, as a fraction of the wheel's
# Distance beyond a joint's limit at which PyBullet stops it, rad or m: a stop at the limit itself
# would carry part of the load that a motor holds there.
_STOP = 1e-4


@dataclass(frozen=True)
class SkidAxle(Joint):
    """The joint of a skidding wheel, whose hub can slide along the axle against a motor.

    PyBullet computes friction in two directions separately, each as large as the bodies' resistance
    in it. A wheel has little resistance in its rolling direction. With a fixed hub, it would have
    full resistance sideways, and friction would not oppose the actual sliding; so the hub slides.
    """


def rigid_bodies(description: Description) -> dict[str, Body]:
    """Return the rigid bodies by the name of their first link, starting with the root's.

    Raises:
        OneBotError: the links are not all connected, or joints cannot be simulated, with one line
            for each.
    """
    description.require_tree()
    if problems := [*_joint_problems(description)]:
        raise OneBotError("\n".join(problems))
    bodies = merged_bodies(description)
    firsts = [description.root_link, *(joint.child for joint in description.moving_joints)]
    return {link: bodies[link] for link in firsts}


def _joint_problems(description: Description) -> Iterator[str]:
    """Report joints that cannot be simulated, although they can be published."""
    for joint in description.joints:
        where = f'{joint.where}: joint "{joint.name}"'
        if joint.kind in ("floating", "planar"):
            moved = ", ".join(MOVING_KINDS)
            yield f"{where} is {joint.kind}; the simulation moves {moved} joints"
        if joint.kind in ("revolute", "prismatic") and joint.lower is None:
            yield f"{where} has no limits; the simulation needs lower and upper"


def physics_urdf(
    description: Description,
    bodies: Mapping[str, Body],
    meshes: Mapping[str, str],
    *,
    fixed: bool = False,
    fixed_base: bool = False,
) -> str:
    """Return the URDF of rigid bodies that move like ``description``.

    Links connected by fixed joints are merged, visuals and extensions are removed, and inertias are
    diagonal in their principal axes. Bodies and moving joints are named by their index, because
    PyBullet crashes on very long names.

    Args:
        description: the robot.
        bodies: its rigid bodies.
        meshes: the converted file for each URI of a collision mesh.
        fixed: whether the bodies are fixed, regardless of their masses, and may have concave
            meshes.
        fixed_base: whether the root's body is fixed, regardless of its mass.

    Raises:
        OneBotError: bodies cannot be simulated; one line for each, with the remedy.
    """
    robot = Element("robot", name="robot")
    numbers = {link: str(number) for number, link in enumerate(bodies)}
    problems = []
    for body in bodies.values():
        try:
            still = fixed or (fixed_base and body.link == description.root_link)
            inertial = _mass(0.0, np.zeros(3)) if still else _inertial(description, body)
            link = _link(numbers[body.link], inertial)
            _add_collisions(link, body, meshes, concave=fixed)
            robot.append(link)
        except OneBotError as error:
            problems.append(str(error))
    if problems:
        raise OneBotError("\n".join(problems))
    frames = rigid_frames(description)
    for index, joint in enumerate(description.moving_joints):
        parent, pose = frames[joint.parent]
        place, carrier = pose @ matrices.of_origin(joint.origin), numbers[parent]
        if isinstance(joint, SkidAxle):
            hub = f"{HUB}{index}"
            robot.append(_link(hub, _inertial(description, bodies[joint.child], _HUB)))
            # A lower limit above the upper one means no limits.
            slide = replace(joint, kind="prismatic", lower=1.0, upper=-1.0)
            robot.append(_joint(slide, hub, place, carrier, hub))
            place, carrier = np.eye(4), hub
        robot.append(_joint(joint, str(index), place, carrier, numbers[joint.child]))
    return to_text(robot)


def _link(name: str, inertial: Element) -> Element:
    link = Element("link", name=name)
    link.append(inertial)
    return link


def _add_collisions(link: Element, body: Body, meshes: Mapping[str, str], *, concave: bool) -> None:
    for shape, where, _ in body.collisions:
        part = SubElement(link, "collision")
        if concave and isinstance(shape, Mesh):
            part.set("concave", "yes")
        part.append(_origin(where))
        SubElement(part, "geometry").append(_geometry(shape, meshes))


def _geometry(shape: Shape, meshes: Mapping[str, str]) -> Element:
    if isinstance(shape, Mesh):
        return Element("mesh", filename=meshes[shape.uri], scale=_numbers(shape.scale))
    if isinstance(shape, Box):
        return Element("box", size=_numbers(shape.size))
    if isinstance(shape, Sphere):
        return Element("sphere", radius=repr(shape.radius))
    kind = "cylinder" if isinstance(shape, Cylinder) else "capsule"
    return Element(kind, radius=repr(shape.radius), length=repr(shape.length))


def _numbers(values: Iterable[float]) -> str:
    """Return numbers as the text of an XML attribute."""
    return " ".join(repr(float(value)) for value in values)


def _inertial(description: Description, body: Body, share: float = 1.0) -> Element:
    """Return the ``<inertial>`` of a body, scaled by ``share``."""
    moments, turn = _principal(description, body)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, body.center
    inertial = _mass(share * body.mass, share * moments)
    inertial.append(_origin(pose))
    return inertial


def _mass(mass: float, moments: Floats) -> Element:
    """Return an ``<inertial>`` at the link's frame; PyBullet never moves a mass of 0."""
    inertial = Element("inertial")
    SubElement(inertial, "mass", value=repr(mass))
    values = {"ixy": "0", "ixz": "0", "iyz": "0"}
    values |= {name: repr(float(m)) for name, m in zip(("ixx", "iyy", "izz"), moments, strict=True)}
    SubElement(inertial, "inertia", values)
    return inertial


def _principal(description: Description, body: Body) -> tuple[Floats, Floats]:
    """Return the principal moments (3,), kg m^2, and axes (3, 3) of a body."""
    where = f'{description.source}: link "{body.link}"'
    if body.mass <= 0:
        raise OneBotError(
            f"{where} cannot move without a mass above 0; give it (or a link fixed to it) an "
            "<inertial> with mass and inertia"
        )
    moments, axes = body.principal()
    fault = inertia_fault(moments)
    if moments.min() <= 0:
        raise OneBotError(f"{where} {fault}")
    if fault:
        logger.warning("%s %s", where, fault)
    # PyBullet ignores the whole inertia if rounding raises one moment above the sum of the others.
    largest = int(np.argmax(moments))
    sum_of_others = float(moments.sum() - moments[largest])
    moments[largest] = min(moments[largest], sum_of_others * (1 - 1e-9))
    return moments, axes


def _joint(joint: Joint, name: str, place: Floats, parent: str, child: str) -> Element:
    """Return ``joint`` at ``place`` (4, 4) in the body named ``parent``."""
    result = Element("joint", name=name, type=joint.kind)
    SubElement(result, "parent", link=parent)
    SubElement(result, "child", link=child)
    result.append(_origin(place))
    SubElement(result, "axis", xyz=_numbers(joint.axis))
    limits = {name: getattr(joint, name) for name in ("lower", "upper", "effort", "velocity")}
    if joint.kind == "continuous":
        limits["lower"] = limits["upper"] = None
    elif joint.lower is not None and joint.upper is not None and joint.lower <= joint.upper:
        limits["lower"], limits["upper"] = joint.lower - _STOP, joint.upper + _STOP
    SubElement(
        result, "limit", {name: repr(value) for name, value in limits.items() if value is not None}
    )
    dynamics = {"damping": joint.damping, "friction": joint.friction}
    if any(dynamics.values()):
        SubElement(result, "dynamics", {name: repr(value) for name, value in dynamics.items()})
    return result


def _origin(pose: Floats) -> Element:
    """Return the ``<origin>`` of a transform (4, 4)."""
    xyz, rpy = matrices.to_origin(pose)
    return Element("origin", xyz=_numbers(xyz), rpy=_numbers(rpy))
