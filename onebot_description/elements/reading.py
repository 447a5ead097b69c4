"""Reads links and joints from XML elements; unreadable values become findings.

A finding names file, line, element and how to fix it. Reading continues after each, so that one run
shows all of them. ``ELEMENTS`` declares URDF's elements: their children and attributes, and the
count, default and check of numeric attributes.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

from onebot_description.elements.meshes import locate_mesh
from onebot_description.elements.packages import Resources
from onebot_description.elements.urdf import (
    JOINT_KINDS,
    MOVING_KINDS,
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Inertial,
    Joint,
    Link,
    Material,
    Mesh,
    Mimic,
    Rgba,
    Shape,
    Sphere,
)
from onebot_description.elements.xml import Document
from onebot_description.errors import (
    DescriptionError,
    clipped,
    did_you_mean,
    printable,
    shortened,
)
from onebot_description.geometry.poses import ZERO, Origin, Quaternion, Triple, to_rpy

Element = ElementTree.Element

_AXIS_KINDS = (*MOVING_KINDS, "planar")
_LIMITED_KINDS = ("revolute", "prismatic")
_DEFAULT_AXIS: Triple = (1.0, 0.0, 0.0)
# An axis whose length differs from 1 by more than this was not merely rounded.
_AXIS_ROUNDING = 1e-3
_INERTIA_ROUNDING = 1e-15  # kg or kg m^2; CAD programs write less than this for 0
_MAX_HINTS = 100
_TURN = 2 * math.pi + 0.01  # rad, as 6.29 is a turn rounded up
_MAX_DEGREES = 720  # larger limits of a joint mean no limit
_QUATERNION = "quat_xyzw"

Severity = Literal["error", "problem", "warning"]


class Findings:
    """Collects all faults of one document.

    With an error, nothing can be published. An element with a problem is left out or replaced:
    nodes warn about it, and ``onebot check`` rejects it. A warning is about something that works,
    but is probably not intended.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.texts: list[tuple[Severity, str]] = []  # each begins with file, line and element
        self.resources = Resources(document.folder)
        self.meshes: list[tuple[Element, Mesh]] = []  # order of reading
        self.version = (1, 0)  # version of URDF that the robot declares
        self._hints = 0

    def error(self, element: Element, text: str) -> None:
        self._add("error", element, text)

    def problem(self, element: Element, text: str) -> None:
        self._add("problem", element, text)

    def warning(self, element: Element, text: str) -> None:
        self._add("warning", element, text)

    def _add(self, severity: Severity, element: Element, text: str) -> None:
        message = printable(clipped(f"{self.where(element)}: {self.label(element)}: {text}"))
        self.texts.append((severity, message))

    def hint(self, name: str, candidates: Iterable[str], what: str = "known") -> str:
        """Return the hint of ``did_you_mean``, or "" after many calls, because it takes time."""
        self._hints += 1
        return did_you_mean(name, candidates, what) if self._hints <= _MAX_HINTS else ""

    def by_severity(self, *severities: Severity) -> tuple[str, ...]:
        """Return the findings of these severities, in the order they were found."""
        return tuple(text for severity, text in self.texts if severity in severities)

    def raise_errors(self, warnings: Iterable[str] = ()) -> None:
        """Raise a DescriptionError if there are errors.

        Args:
            warnings: further warnings to include in it.
        """
        if self.by_severity("error"):
            own_warnings = self.by_severity("warning")
            raise DescriptionError(self.by_severity("error", "problem"), (*warnings, *own_warnings))

    def where(self, element: Element) -> str:
        """Return where ``element`` was written, for example ``robot.urdf:12``."""
        return self.document.places.get(element, self.document.shown)

    def label(self, element: Element) -> str:
        """Return for example ``link "base" <visual> <box>``."""
        path = [part for part in self._path(element) if part is not self.document.root]
        return " ".join(map(_short, reversed(path or [element])))

    def _path(self, element: Element) -> Iterator[Element]:
        """Yield ``element`` and its ancestors, the root last."""
        current: Element | None = element
        while current is not None:
            yield current
            current = self._parents.get(current)

    @cached_property
    def _parents(self) -> dict[Element, Element]:
        return {child: parent for parent in self.document.root.iter() for child in parent}


def local_name(element: Element) -> str:
    """Return the tag without its namespace."""
    return element.tag.rpartition("}")[2]


def _short(element: Element) -> str:
    """Return ``joint "hip"`` for an element with a name, otherwise ``<limit>``."""
    name = element.get("name")
    tag = local_name(element)
    return f'{tag} "{name}"' if name and tag != "visual" else f"<{tag}>"


# ---- Checks of numbers: each reports what is wrong, and returns whether they can be used ----


def _not_negative(findings: Findings, element: Element, name: str, values: Sequence[float]) -> bool:
    if min(values) < 0:
        findings.problem(element, f'{name}="{element.get(name)}" is negative; it must not be')
    return min(values) >= 0


def _inertia(findings: Findings, element: Element, name: str, values: Sequence[float]) -> bool:
    """Report a mass or moment below zero; it is kept, for nodes that only publish."""
    if min(values) < -_INERTIA_ROUNDING:
        _not_negative(findings, element, name, values)
    return True


def _colors(findings: Findings, element: Element, name: str, values: Sequence[float]) -> bool:
    if not all(0 <= value <= 1 for value in values):
        written = f'{name}="{element.get(name)}"'
        findings.problem(element, f"{written} is beyond 0 to 1; divide values of 0 to 255 by 255")
    return True


def _radians(findings: Findings, element: Element, name: str, values: Sequence[float]) -> bool:
    """Warn about angles of more than a turn, which are probably in degrees."""
    degrees = max(map(abs, values), default=0.0)
    if degrees > _TURN:
        radians = f"{math.radians(degrees):.4g}"
        text = f"{degrees:g} is more than a turn; angles are in rad"
        findings.warning(element, f"{text}: if it is in degrees, write {radians}")
    return True


# ---- Elements of URDF ----


class Numbers(NamedTuple):
    """A numeric attribute."""

    size: int = 1  # how many numbers
    default: float | Triple | None = None  # value if the attribute is missing
    write: str = ""  # what to write if it is missing, {} for its name; "": it may be missing
    check: Callable[[Findings, Element, str, Sequence[float]], bool] | None = None


class Content(NamedTuple):
    """The allowed content of an element."""

    children: str = ""
    texts: str = ""  # attributes
    numbers: Mapping[str, Numbers] = {}  # attributes


_NEEDED = Numbers(write='{}="..."')
_NOT_NEGATIVE = _NEEDED._replace(check=_not_negative)
_INERTIA = _NEEDED._replace(check=_inertia)
ELEMENTS = {
    "robot": Content("link joint material", "name version"),
    "link": Content("inertial visual collision", "name type"),
    "joint": Content("origin parent child axis limit dynamics mimic", "name type"),
    "inertial": Content("origin mass inertia"),
    "visual": Content("origin geometry material", "name"),
    "collision": Content("origin geometry", "name group concave"),
    "geometry": Content("box cylinder sphere capsule mesh"),
    "material": Content("color texture", "name"),
    "origin": Content(
        # m, rad
        numbers={
            "xyz": Numbers(3, ZERO),
            "rpy": Numbers(3, ZERO, check=_radians),
            _QUATERNION: Numbers(4),
        },
    ),
    "mass": Content(numbers={"value": _INERTIA}),  # kg
    "inertia": Content(  # kg m^2
        numbers={
            "ixx": _INERTIA,
            "ixy": _NEEDED,
            "ixz": _NEEDED,
            "iyy": _INERTIA,
            "iyz": _NEEDED,
            "izz": _INERTIA,
        }
    ),
    "box": Content(numbers={"size": Numbers(3, write='{}="x y z", in m', check=_not_negative)}),
    "cylinder": Content(numbers={"radius": _NOT_NEGATIVE, "length": _NOT_NEGATIVE}),  # m
    "capsule": Content(numbers={"radius": _NOT_NEGATIVE, "length": _NOT_NEGATIVE}),
    "sphere": Content(numbers={"radius": _NOT_NEGATIVE}),
    "mesh": Content("", "filename", {"scale": Numbers(3, (1.0, 1.0, 1.0))}),
    "color": Content(
        numbers={"rgba": Numbers(4, write='<color {}="red green blue alpha"/>', check=_colors)}
    ),
    "texture": Content("", "filename"),
    "parent": Content("", "link"),
    "child": Content("", "link"),
    "axis": Content(numbers={"xyz": Numbers(3, write='for example <axis {}="0 0 1"/>')}),
    "limit": Content(
        # rad or m, Nm or N, rad/s or m/s; by URDF's specification, a missing end is 0.
        numbers={
            "lower": Numbers(1, 0.0),
            "upper": Numbers(1, 0.0),
            "effort": _NOT_NEGATIVE,
            "velocity": _NOT_NEGATIVE,
            # URDF 1.2: rad/s^2 and rad/s^3, or m/s^2 and m/s^3.
            **dict.fromkeys(("acceleration", "deceleration", "jerk"), Numbers(check=_not_negative)),
        },
    ),
    "dynamics": Content(
        numbers=dict.fromkeys(("damping", "friction"), Numbers(1, 0.0, check=_not_negative))
    ),
    "mimic": Content("", "joint", {"multiplier": Numbers(1, 1.0), "offset": Numbers(1, 0.0)}),
    # Extensions; their other attributes are not known here.
    "safety_controller": Content(
        numbers={"soft_lower_limit": Numbers(), "soft_upper_limit": Numbers()}
    ),
    "lateral_friction": Content(numbers={"value": Numbers()}),
}
_SHAPE_TAGS = ELEMENTS["geometry"].children.split()
_SHAPES = {"box": Box, "cylinder": Cylinder, "sphere": Sphere, "capsule": Capsule}


def read(
    findings: Findings, element: Element, *, needed: bool = False, complete: bool = True
) -> dict[str, Any]:
    """Return an element's numbers by attribute, in the order of ``ELEMENTS``.

    Args:
        findings: collects faults.
        element: the element.
        needed: whether a fault is an error, because nothing can be published without the numbers.
        complete: whether a missing attribute is a problem.

    Returns:
        For each attribute a float, or a tuple of several; None if it is missing or wrong.
    """
    values = {}
    for name, numbers in ELEMENTS[element.tag].numbers.items():
        text = element.get(name)
        if text is not None:
            values[name] = _read_numbers(findings, element, name, text, numbers, needed)
            continue
        if numbers.write and complete:
            findings.problem(element, f"has no {name}; write {numbers.write.format(name)}")
        values[name] = numbers.default
    return values


def _read_numbers(
    findings: Findings, element: Element, name: str, text: str, numbers: Numbers, needed: bool
) -> Any:
    words = text.split()
    fault = next(filter(None, map(number_fault, words)), None)
    if fault is None and len(words) == numbers.size:
        values = tuple(map(float, words))
        if numbers.check is not None and not numbers.check(findings, element, name, values):
            return None
        return values[0] if numbers.size == 1 else values
    noun = "number" if numbers.size == 1 else "numbers"
    fault = fault or f"holds {len(words)}; it takes {numbers.size} {noun}"
    message = f'{name}="{shortened(text)}": {fault}'
    (findings.error if needed else findings.problem)(element, message)
    return None


# Numbers that every URDF reader accepts; float() would also accept "1_000", "nan" and Thai digits.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def number_fault(word: str) -> str | None:
    """Return why ``word`` is not a usable number; None if it is one."""
    if _NUMBER.fullmatch(word) and math.isfinite(float(word)):
        return None
    return f'"{shortened(word)}" is not a finite number'


def value_text(element: Element) -> str:
    """Return what an element holds, as sdformat does: its attribute ``value``, or else its text."""
    return element.get("value", element.text or "").strip()


def _read_origin(findings: Findings, element: Element, *, needed: bool = False) -> Origin | None:
    """Return the <origin> of ``element``; None if a number in it is wrong."""
    origin = element.find("origin")
    if origin is None:
        return Origin()
    xyz, rpy, quaternion = read(findings, origin, needed=needed).values()
    if _QUATERNION in origin.keys():
        rpy = _rotation(findings, origin, rpy, quaternion, needed=needed)
    return None if xyz is None or rpy is None else Origin(xyz, rpy)


def _rotation(
    findings: Findings,
    origin: Element,
    rpy: Triple | None,
    quaternion: Quaternion | None,
    *,
    needed: bool,
) -> Triple | None:
    """Return roll, pitch, yaw of an <origin> with a quaternion; None if it cannot be used."""
    if findings.version < (1, 1):
        text = f'{_QUATERNION} is ignored, as in other programs; write <robot version="1.1" ...>'
        findings.warning(origin, text)
        return rpy
    if quaternion is None:
        return None
    length, report = math.hypot(*quaternion), findings.error if needed else findings.problem
    if length == 0.0 or "rpy" in origin.keys():
        written = (
            f"rpy and {_QUATERNION}" if length else f'{_QUATERNION}="{origin.get(_QUATERNION)}"'
        )
        report(
            origin, f"{written} is not a rotation; write either rpy or a {_QUATERNION} of length 1"
        )
        return None
    if abs(length - 1.0) > _AXIS_ROUNDING:
        text = f"{_QUATERNION} has length {length:.4g}; it is taken as length 1"
        findings.warning(origin, text)
    x, y, z, w = quaternion
    return to_rpy((x / length, y / length, z / length, w / length))


# ---- Links ----


def read_links(findings: Findings, materials: Mapping[Element, Material]) -> dict[Element, Link]:
    """Read every link, including those without a name or with a repeated name."""
    root = findings.document.root
    colors = _visual_colors(root, materials)
    return {element: _read_link(findings, element, colors) for element in root.iterfind("link")}


def _read_link(findings: Findings, element: Element, colors: Mapping[Element, Rgba]) -> Link:
    parts: dict[str, list[Geometry]] = {"visual": [], "collision": []}
    warnings: list[str] = []
    for part in element:
        if part.tag in parts:
            start = len(findings.texts)
            geometry = _read_geometry(findings, part, colors)
            if geometry is not None:
                parts[part.tag].append(geometry)
            else:
                warnings += [text for _, text in findings.texts[start:]]
    friction = element.find("contact/lateral_friction")
    return Link(
        element.get("name", ""),
        visuals=tuple(parts["visual"]),
        collisions=tuple(parts["collision"]),
        inertial=_read_inertial(findings, element),
        friction=None if friction is None else read(findings, friction)["value"],
        where=findings.where(element),
        left_out=tuple(warnings),
    )


def _read_inertial(findings: Findings, link: Element) -> Inertial | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    origin = _read_origin(findings, inertial)
    values: list[Any] = []
    for tag, write in (
        ("mass", '<mass value="..."/>, in kg'),
        ("inertia", 'ixx="..." iyy="..." izz="..." and the rest'),
    ):
        element = inertial.find(tag)
        if element is None:
            findings.problem(inertial, f"has no <{tag}>; write {write}")
        values += [None] if element is None else read(findings, element).values()
    if origin is None or None in values:
        return None
    mass, *moments = values
    return Inertial(origin, mass, tuple(moments))


def _read_geometry(
    findings: Findings, part: Element, colors: Mapping[Element, Rgba]
) -> Geometry | None:
    """Read a <visual> or <collision>; None if anything in it is wrong."""
    origin = _read_origin(findings, part)
    geometry = part.find("geometry")
    takes = f"it takes one of: {', '.join(_SHAPE_TAGS)}"
    if geometry is None:
        findings.problem(part, f"has no <geometry>; {takes}")
        return None
    shapes = [_read_shape(findings, element) for element in geometry]
    if len(shapes) != 1:
        findings.problem(geometry, f"holds {len(shapes)} shapes; {takes}")
    elif shapes[0] is not None and origin is not None:
        return Geometry(shapes[0], origin, colors.get(part), findings.where(part))
    return None


def _read_shape(findings: Findings, element: Element) -> Shape | None:
    if element.tag == "mesh":
        return _read_mesh(findings, element)
    if element.tag not in _SHAPES:
        findings.problem(element, f"unknown shape{findings.hint(str(element.tag), _SHAPE_TAGS)}")
        return None
    if element.tag == "capsule" and findings.version < (1, 1):
        text = 'is a shape of URDF 1.1; other programs need <robot version="1.1" ...> for it'
        findings.problem(element, text)
    sizes = read(findings, element)
    return None if None in sizes.values() else _SHAPES[element.tag](**sizes)


def _read_mesh(findings: Findings, element: Element) -> Mesh | None:
    uri = element.get("filename")
    if not uri:
        findings.problem(element, 'names no file; write filename="package://<package>/<path>"')
    scale = read(findings, element)["scale"]
    if not uri or not scale:
        return None
    mesh = locate_mesh(findings.resources, uri, scale)
    element.set("filename", mesh.uri)
    findings.meshes.append((element, mesh))
    return mesh


def _visual_colors(root: Element, materials: Mapping[Element, Material]) -> dict[Element, Rgba]:
    """Return the color of each visual with a material, looked up by its name if it has one.

    As in urdfdom, the first definition of a name counts everywhere; the robot's come before the
    visuals'.
    """
    backwards = reversed([*materials.values()])
    named = {material.name: material.color for material in backwards if material.color}
    colors = {}
    for visual in root.iterfind("link/visual"):
        element = visual.find("material")
        if element is not None:
            material = materials[element]
            color = named.get(material.name) if material.name else material.color
            if color is not None:
                colors[visual] = color
    return colors


def read_materials(findings: Findings) -> dict[Element, Material]:
    """Read the materials of the robot, then those of the visuals."""
    root = findings.document.root
    elements = [*root.iterfind("material"), *root.iterfind("link/visual/material")]
    return {element: _read_material(findings, element) for element in elements}


def _read_material(findings: Findings, element: Element) -> Material:
    color, texture = element.find("color"), element.find("texture")
    return Material(
        element.get("name"),
        None if color is None else read(findings, color)["rgba"],
        # Exporters write <texture filename=""/> where there is none.
        None if texture is None else texture.get("filename") or None,
    )


# ---- Joints ----


def read_ends(
    findings: Findings, joints: Mapping[str, Element], links: Mapping[str, Element]
) -> dict[str, tuple[str, str]]:
    """Return the parent and child link of each joint whose ends are both known links."""
    ends = {}
    for name, joint in joints.items():
        parent = _read_end(findings, joint, "parent", links)
        child = _read_end(findings, joint, "child", links)
        if parent is not None and child is not None:
            ends[name] = (parent, child)
    return ends


def _read_end(
    findings: Findings, joint: Element, end: str, links: Mapping[str, Element]
) -> str | None:
    element = joint.find(end)
    if element is None:
        findings.error(joint, f'has no <{end}>; write <{end} link="..."/>')
        return None
    link = element.get("link", "")
    if link not in links:
        hint = findings.hint(link, links, "links")
        findings.error(element, f'there is no link "{link}"{hint}')
        return None
    return link


def read_joint(
    findings: Findings, name: str, element: Element, ends: tuple[str, str] | None
) -> Joint:
    """Read one joint; faulty values are reported, and replaced by defaults."""
    kind = _read_kind(findings, element)
    origin = _read_origin(findings, element, needed=True)
    limits = _read_limit(findings, element, kind)
    safety, dynamics = element.find("safety_controller"), element.find("dynamics")
    soft = {} if safety is None else read(findings, safety)
    resistance = {} if dynamics is None else read(findings, dynamics)
    parent, child = ends or ("", "")
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        origin=origin or Origin(),
        axis=_read_axis(findings, element, kind),
        **limits,
        soft_lower=soft.get("soft_lower_limit"),
        soft_upper=soft.get("soft_upper_limit"),
        damping=resistance.get("damping") or 0.0,
        friction=resistance.get("friction") or 0.0,
        mimic=_read_mimic(findings, element),
        where=findings.where(element),
    )


def _read_kind(findings: Findings, element: Element) -> str:
    kind = element.get("type", "")
    if kind in JOINT_KINDS:
        return kind
    findings.error(element, f'unknown joint type "{kind}"{findings.hint(kind, JOINT_KINDS)}')
    return ""


def _read_axis(findings: Findings, element: Element, kind: str) -> Triple:
    axis = element.find("axis")
    if axis is None:
        return _DEFAULT_AXIS
    xyz = read(findings, axis, needed=kind in _AXIS_KINDS)["xyz"]
    if xyz is None or kind not in _AXIS_KINDS:
        return _DEFAULT_AXIS
    length = math.hypot(*xyz)
    if length == 0:
        findings.error(
            axis, f'the axis of a {kind} joint cannot be zero; write for example "0 0 1"'
        )
        return _DEFAULT_AXIS
    excess = abs(length - 1)
    if excess > _AXIS_ROUNDING:
        findings.warning(axis, f"the axis has length {length:.4g}; it is taken as length 1")
    unit = xyz[0] / length, xyz[1] / length, xyz[2] / length
    if excess > 1e-6:
        # Rerun would rotate by wrong angles about an axis that is not of unit length.
        axis.set("xyz", " ".join(map(repr, unit)))
    return xyz if excess < 1e-15 else unit


def _read_limit(findings: Findings, element: Element, kind: str) -> dict[str, Any]:
    """Return the limits by the attributes of <limit>, which are those of a Joint."""
    limit = element.find("limit")
    bounded = kind in _LIMITED_KINDS
    if limit is None:
        if bounded:
            findings.problem(
                element,
                f"a {kind} joint needs a limit; write "
                '<limit lower="..." upper="..." effort="..." velocity="..."/>',
            )
        return {}
    # In URDF 1.2 and later, effort and velocity may be missing.
    complete = kind in MOVING_KINDS and findings.version < (1, 2)
    limits = read(findings, limit, complete=complete)
    lower, upper = limits["lower"], limits["upper"]
    if not bounded:
        if kind == "continuous" and (lower or upper):
            text = "a continuous joint turns endlessly, so lower and upper are ignored"
            findings.warning(
                limit, f"{text}; delete them, or make it revolute if it must stop there"
            )
        return limits | {"lower": None, "upper": None}
    if limits["velocity"] == 0:
        text = "velocity is 0, so the joint cannot move; the simulation takes 0 for no limit"
        findings.warning(limit, text)
    if kind == "revolute":
        _check_degrees(findings, limit, [end for end in (lower, upper) if end is not None])
    lower, upper = _ordered(findings, limit, lower, upper)
    return limits | {"lower": lower, "upper": upper}


def _check_degrees(findings: Findings, limit: Element, ends: Sequence[float]) -> None:
    # Wrists of real arms have limits beyond a turn, but these are not whole numbers of radians.
    if all(end.is_integer() and abs(end) <= _MAX_DEGREES for end in ends):
        _radians(findings, limit, "", ends)


def _ordered(
    findings: Findings, limit: Element, lower: float | None, upper: float | None
) -> tuple[float | None, float | None]:
    """Return the limits in ascending order; None for both if either cannot be read."""
    if lower is None or upper is None:
        return None, None
    if lower > upper:
        findings.problem(limit, f"lower {lower:g} is above upper {upper:g}; swap them")
    elif lower == upper == 0:
        findings.warning(limit, "lower and upper are both 0, so the joint cannot move")
    return min(lower, upper), max(lower, upper)


def _read_mimic(findings: Findings, element: Element) -> Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    factors = read(findings, mimic)
    return None if None in factors.values() else Mimic(mimic.get("joint", ""), **factors)
