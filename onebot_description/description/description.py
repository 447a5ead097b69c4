"""What a checked robot description says, as plain values."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

from onebot_description.description.xml import Document
from onebot_description.errors import DescriptionError
from onebot_description.model.quaternions import from_rpy

Triple = tuple[float, float, float]

JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")


@dataclass(frozen=True)
class MimicSpec:
    """A joint that follows another: position = multiplier * position of ``joint`` + offset.

    Attributes:
        joint: the name of the joint followed, which may itself follow one.
        multiplier: without unit (or m/rad and rad/m between kinds).
        offset: rad, or m for a prismatic joint.
    """

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class JointSpec:
    """One joint, as REP-103 has it: SI units, radians.

    Attributes:
        name: the joint's name.
        kind: one of ``JOINT_KINDS``.
        parent: the link it hangs on.
        child: the link it moves.
        xyz: position of the joint frame in the parent link's frame, m.
        rpy: its orientation there: roll, pitch, yaw about the parent's fixed axes, rad.
        axis: unit vector in the joint frame; (1, 0, 0) if none is given or the kind has none.
        lower: least position, rad or m; None for kinds that have no limits.
        upper: greatest position, rad or m; None for kinds that have no limits.
        velocity: greatest speed, rad/s or m/s; None if not given.
        effort: greatest torque or force, Nm or N; None if not given.
        mimic: what it follows, or None.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    mimic: MimicSpec | None


@dataclass(frozen=True)
class Description:
    """A robot description that has passed every check.

    Attributes:
        urdf: the URDF text: xacro expanded, axes of unit length, indented, no comments.
        robot_name: the ``name`` of ``<robot>``.
        source: absolute path of the file loaded, or the name given to ``parse_description``.
        files: absolute paths of all files read, the loaded one first (for watching them).
        root_link: the one link that is no joint's child.
        links: link names in the order of the XML.
        joints: the joints in the order of the XML.
        warnings: what works but is probably not meant.
    """

    urdf: str
    robot_name: str
    source: str
    files: tuple[Path, ...]
    root_link: str
    links: tuple[str, ...]
    joints: tuple[JointSpec, ...]
    warnings: tuple[str, ...]


# Collecting what is wrong, so that one run shows all of it.

Element = ElementTree.Element


class Report:
    """Problems and warnings of one document, each prefixed with file, line and element.

    Attributes:
        problems: what makes the description unusable.
        warnings: what works but is probably not meant.
    """

    def __init__(self, document: Document) -> None:
        """Start with nothing found in ``document``."""
        self.document = document
        self.problems: list[str] = []
        self.warnings: list[str] = []
        self._typos: list[str] = []
        self._parents = {child: parent for parent in document.root.iter() for child in parent}

    def problem(self, element: Element, text: str) -> None:
        """Note that ``element`` makes the description unusable."""
        self.problems.append(f"{self.where(element)}: {text}")

    def warning(self, element: Element, text: str) -> None:
        """Note that ``element`` works but is probably not what was meant."""
        self.warnings.append(f"{self.where(element)}: {text}")

    def typo(self, element: Element, text: str) -> None:
        """Warn of a probable slip of the pen; shown with the problems it may have caused."""
        self.warning(element, text)
        self._typos.append(self.warnings[-1])

    def where(self, element: Element) -> str:
        """Return for example ``robot.urdf:12: joint "hip" <limit>``."""
        place = self.document.places.get(element, self.document.shown)
        return f"{place}: {self.label(element)}"

    def label(self, element: Element) -> str:
        """Return for example ``link "base" <visual> <box>``."""
        parts: list[str] = []
        root = self.document.root
        current: Element | None = element
        while current is not None and (current is not root or not parts):
            parts.append(_short(current))
            current = self._parents.get(current)
        return " ".join(reversed(parts))

    def raise_if_any(self) -> None:
        """Raise everything found, if any of it is a problem.

        Raises:
            DescriptionError: all problems, then the slips of the pen that may explain them.
        """
        if self.problems:
            raise DescriptionError([*self.problems, *self._typos])


def local_name(element: Element) -> str:
    """Return the tag without its namespace."""
    return element.tag.rpartition("}")[2]


def _short(element: Element) -> str:
    """``joint "hip"`` for what has a name, else ``<limit>``."""
    name = element.get("name")
    tag = local_name(element)
    return f'{tag} "{name}"' if name and tag != "visual" else f"<{tag}>"


# Numbers in attributes: as many as needed, finite, and in the range that makes sense.

# What every URDF reader takes for a number. float() would also take "1_000", "nan" and Thai digits.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
ZERO: Triple = (0.0, 0.0, 0.0)


def read_numbers(
    report: Report, element: Element, attribute: str, count: int
) -> tuple[float, ...] | None:
    """Return the numbers in an attribute; None if it is absent, or wrong (then reported)."""
    text = element.get(attribute)
    if text is None:
        return None
    written = f'{attribute}="{_cut(text)}"'
    words = text.split()
    if "," in text and len(text.replace(",", " ").split()) == count:
        report.problem(element, f"{written} has commas; separate the numbers by spaces")
        return None
    for word in words:
        if fault := _fault(word):
            report.problem(element, f"{written}: {fault}")
            return None
    if len(words) != count:
        noun = "number" if count == 1 else "numbers"
        report.problem(element, f"{written} holds {len(words)}; it takes {count} {noun}")
        return None
    return tuple(float(word) for word in words)


def read_triple(report: Report, element: Element | None, attribute: str) -> Triple | None:
    """Return three numbers; None if there is no such element or attribute, or it is wrong."""
    numbers = None if element is None else read_numbers(report, element, attribute, 3)
    return None if numbers is None else (numbers[0], numbers[1], numbers[2])


def read_number(
    report: Report,
    element: Element,
    attribute: str,
    *,
    required: bool = False,
    negative: bool = True,
) -> float | None:
    """Return the one number in an attribute; None if it is absent or wrong.

    Args:
        report: takes what is wrong.
        element: has the attribute.
        attribute: its name.
        required: whether its absence is a problem.
        negative: whether it may be below zero.
    """
    if element.get(attribute) is None:
        if required:
            report.problem(element, f'has no {attribute}; write {attribute}="..."')
        return None
    numbers = read_numbers(report, element, attribute, 1)
    if numbers is None:
        return None
    if not negative and numbers[0] < 0:
        report.problem(element, f'{attribute}="{numbers[0]:g}" is negative; it must not be')
        return None
    return numbers[0]


def _fault(word: str) -> str | None:
    """Why ``word`` is no usable number; None if it is one."""
    if _NOT_FINITE.fullmatch(word):
        return f"{word} is not a finite number"
    if not _NUMBER.fullmatch(word):
        return f'"{_cut(word)}" is not a number'
    if not math.isfinite(float(word)):
        return f"{_cut(word)} is too large for a number"
    return None


def _cut(text: str) -> str:
    """A text short enough to show in one line."""
    flat = " ".join(text.split())
    return flat if len(flat) <= 60 else flat[:57] + "..."


# The shapes of a URDF: what to draw, on which link, where and in which colour.

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
