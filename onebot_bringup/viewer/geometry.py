"""The shapes of a URDF: what to draw, on which link, where and in which colour.

Only shapes are read here; joints are not, because where a link stands comes from /tf alone.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Literal

from onebot_description.errors import DescriptionError
from onebot_description.model.quaternions import from_rpy

Kind = Literal["visual", "collision"]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Rgba = tuple[int, int, int, int]


@dataclass(frozen=True)
class Box:
    """A box centred on its origin; ``size`` in metres along x, y, z."""

    size: Vector


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, centred on its origin; metres."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred on its origin; metres."""

    radius: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder of ``length`` about z with a half sphere on either end; metres."""

    radius: float
    length: float


@dataclass(frozen=True)
class Mesh:
    """A mesh file, its axes scaled by ``scale``."""

    uri: str
    scale: Vector


Shape = Box | Cylinder | Sphere | Capsule | Mesh


@dataclass(frozen=True)
class Geometry:
    """One <visual> or <collision>.

    Attributes:
        link: name of the link it belongs to.
        kind: "visual" or "collision".
        index: its place among the link's elements of that kind, from 0.
        shape: what to draw.
        translation: origin in the link's frame, metres.
        rotation: origin in the link's frame, quaternion x y z w.
        color: sRGB and alpha, 0 to 255; None if the URDF gives none.
    """

    link: str
    kind: Kind
    index: int
    shape: Shape
    translation: Vector
    rotation: Quaternion
    color: Rgba | None


@dataclass(frozen=True)
class Robot:
    """All that is drawn of a robot.

    Attributes:
        name: the robot's name.
        root: its root link.
        links: names of all links.
        moves: it has a joint that is not fixed.
        geometries: every shape that can be drawn.
        warnings: what had to be left out, and why.
    """

    name: str
    root: str
    links: tuple[str, ...]
    moves: bool
    geometries: tuple[Geometry, ...]
    warnings: tuple[str, ...]


def read_robot(urdf: str) -> Robot:
    """Read the shapes of the robot described by ``urdf`` (expanded XML, no xacro).

    Raises:
        DescriptionError: it is no URDF. A shape that cannot be read is left out with a warning.
    """
    try:
        root = ET.fromstring(urdf)
    except ET.ParseError as error:
        raise DescriptionError([f"robot_description is not XML: {error}"]) from error
    if root.tag != "robot":
        raise DescriptionError([f"robot_description starts with <{root.tag}>, not <robot>"])
    links = tuple(link.get("name", "") for link in root.findall("link"))
    children = {child.get("link") for child in root.findall("joint/child")}
    roots = [link for link in links if link not in children]
    if not roots:
        raise DescriptionError(["robot_description has no root link (every link is a child)"])
    materials = _named_materials(root)
    geometries: list[Geometry] = []
    warnings: list[str] = []
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for index, element in enumerate(link.findall(kind)):
                try:
                    geometries.append(_geometry(link, kind, index, element, materials))
                except ValueError as error:
                    name = link.get("name")
                    warnings.append(f'link "{name}", <{kind}> {index + 1}: {error}; not drawn')
    name = root.get("name", "robot")
    moves = any(joint.get("type") != "fixed" for joint in root.findall("joint"))
    return Robot(name, roots[0], links, moves, tuple(geometries), tuple(warnings))


def _geometry(
    link: ET.Element,
    kind: str,
    index: int,
    element: ET.Element,
    materials: dict[str, Rgba],
) -> Geometry:
    origin = element.find("origin")
    attributes = {} if origin is None else origin.attrib
    return Geometry(
        link=link.get("name", ""),
        kind="visual" if kind == "visual" else "collision",
        index=index,
        shape=_shape(element.find("geometry")),
        translation=_vector(attributes.get("xyz", "0 0 0"), "origin xyz"),
        rotation=_rotation(attributes.get("rpy", "0 0 0")),
        color=_color(element.find("material"), materials),
    )


def _shape(geometry: ET.Element | None) -> Shape:
    element = None if geometry is None or len(geometry) == 0 else geometry[0]
    if element is None:
        raise ValueError("no <geometry>")
    if element.tag == "box":
        return Box(_vector(element.get("size", ""), "box size"))
    if element.tag == "sphere":
        return Sphere(_number(element, "radius"))
    if element.tag == "cylinder":
        return Cylinder(_number(element, "radius"), _number(element, "length"))
    if element.tag == "capsule":
        return Capsule(_number(element, "radius"), _number(element, "length"))
    if element.tag == "mesh":
        if not element.get("filename"):
            raise ValueError("<mesh> without a filename")
        return Mesh(element.get("filename", ""), _vector(element.get("scale", "1 1 1"), "scale"))
    raise ValueError(f"<{element.tag}> is no shape (box, cylinder, sphere, capsule, mesh)")


def _named_materials(root: ET.Element) -> dict[str, Rgba]:
    """Every material that has a colour, by name; one defined at the top wins over one in a link."""
    found: dict[str, Rgba] = {}
    for material in [*root.iter("material"), *root.findall("material")]:
        color = _rgba(material)
        if color is not None and material.get("name"):
            found[material.get("name", "")] = color
    return found


def _color(material: ET.Element | None, materials: dict[str, Rgba]) -> Rgba | None:
    if material is None:
        return None
    own = _rgba(material)
    return own if own is not None else materials.get(material.get("name", ""))


def _rgba(material: ET.Element) -> Rgba | None:
    """The bytes that reach the screen: URDF colours are shown as they are, as RViz does."""
    color = material.find("color")
    if color is None:
        return None
    try:
        values = [float(value) for value in color.get("rgba", "").split()]
    except ValueError:
        return None
    if len(values) != 4 or not all(math.isfinite(value) for value in values):
        return None
    red, green, blue, alpha = (round(255 * min(max(value, 0.0), 1.0)) for value in values)
    return red, green, blue, alpha


def _number(element: ET.Element, attribute: str) -> float:
    text = element.get(attribute, "")
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f'{element.tag} {attribute}="{text}" is no number') from None
    if not math.isfinite(value):
        raise ValueError(f'{element.tag} {attribute}="{text}" is not finite')
    return value


def _vector(text: str, what: str) -> Vector:
    try:
        x, y, z = (float(value) for value in text.split())
    except ValueError:
        raise ValueError(f'{what} "{text}" is not three numbers') from None
    if not all(math.isfinite(value) for value in (x, y, z)):
        raise ValueError(f'{what} "{text}" is not finite')
    return x, y, z


def _rotation(rpy: str) -> Quaternion:
    x, y, z, w = from_rpy(_vector(rpy, "origin rpy")).tolist()
    return x, y, z, w
