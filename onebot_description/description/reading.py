"""From XML elements to links and joints; whatever cannot be read becomes a finding.

A finding names file, line, element and remedy. Reading goes on after each, so that one run shows
all of them.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Literal, NamedTuple
from xml.etree import ElementTree

from onebot_description.description.description import (
    JOINT_KINDS,
    MOVING_KINDS,
    ZERO,
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
    Moments,
    Origin,
    Rgba,
    Shape,
    Sphere,
    Triple,
)
from onebot_description.description.meshes import locate_mesh
from onebot_description.description.packages import Resources
from onebot_description.description.xml import Document
from onebot_description.errors import DescriptionError, clipped, did_you_mean, listing, printable

Element = ElementTree.Element

_SHAPES = ("box", "cylinder", "sphere", "mesh")
_AXIS_KINDS = (*MOVING_KINDS, "planar")
_LIMITED_KINDS = ("revolute", "prismatic")
_DEFAULT_AXIS: Triple = (1.0, 0.0, 0.0)
# Further than this from 1, an axis was not merely rounded when written.
_AXIS_ROUNDING = 1e-3
_MOST_HINTS = 100
_TURN = 2 * math.pi + 0.01  # rad, as 6.29 is a turn rounded up
_MOST_DEGREES = 720  # of a joint's limit; what is more means no limit

Severity = Literal["error", "problem", "warning"]


class Finding(NamedTuple):
    """What is wrong with one element."""

    severity: Severity
    element: Element
    text: str  # with file, line and element in front


class Findings:
    """What is wrong with one document.

    Of an error nothing can be published. A problem is left out or replaced: nodes warn of it and go
    on, and ``onebot check`` refuses it. A warning is of what works but is probably not meant.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.found: list[Finding] = []
        self.resources = Resources(document.folder)
        self.meshes: list[tuple[Element, Mesh]] = []  # in the order they were read
        self._hints = 0

    def error(self, element: Element, text: str) -> None:
        """Note that ``element`` leaves nothing that can be published."""
        self._add("error", element, text)

    def problem(self, element: Element, text: str) -> None:
        """Note that ``element`` is wrong, and that the rest can be used without it."""
        self._add("problem", element, text)

    def warning(self, element: Element, text: str) -> None:
        """Note that ``element`` works but is probably not what was meant."""
        self._add("warning", element, text)

    def _add(self, severity: Severity, element: Element, text: str) -> None:
        message = printable(clipped(f"{self.where(element)}: {self.label(element)}: {text}"))
        self.found.append(Finding(severity, element, message))

    def hint(
        self, name: str, candidates: Iterable[str], what: str = "known", without: str = ""
    ) -> str:
        """Return ``did_you_mean``, which takes time, unless it was asked for very often.

        Args:
            name: as ``did_you_mean`` has it.
            candidates: likewise.
            what: likewise.
            without: a candidate that is not meant.
        """
        self._hints += 1
        if self._hints > _MOST_HINTS:
            return ""
        return did_you_mean(name, [other for other in candidates if other != without], what)

    def texts(self, *severities: Severity) -> tuple[str, ...]:
        """Return the texts of the findings of these severities, in the order they were found."""
        return tuple(finding.text for finding in self.found if finding.severity in severities)

    def raise_errors(self, warnings: Iterable[str] = ()) -> None:
        """Raise the errors, if there are any, with everything else that was found.

        Args:
            warnings: others, that are raised along.

        Raises:
            DescriptionError: all errors and problems, and the warnings, which may explain them.
        """
        if self.texts("error"):
            problems = self.texts("error", "problem")
            raise DescriptionError(problems, (*warnings, *self.texts("warning")))

    def where(self, element: Element) -> str:
        """Return where ``element`` was written, for example ``robot.urdf:12``."""
        return self.document.places.get(element, self.document.shown)

    def label(self, element: Element) -> str:
        """Return for example ``link "base" <visual> <box>``."""
        inside = [other for other in self.path(element) if other is not self.document.root]
        return " ".join(map(_short, reversed(inside or [element])))

    def path(self, element: Element) -> Iterator[Element]:
        """Yield ``element`` and those that it lies in, the root last."""
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
    """``joint "hip"`` for what has a name, else ``<limit>``."""
    name = element.get("name")
    tag = local_name(element)
    return f'{tag} "{name}"' if name and tag != "visual" else f"<{tag}>"


# What every URDF reader takes for a number. float() would also take "1_000", "nan" and Thai digits.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


def read_numbers(
    findings: Findings, element: Element, attribute: str, count: int, *, needed: bool = False
) -> tuple[float, ...] | None:
    """Return the numbers in an attribute; None if it is absent, or wrong (then reported).

    Args:
        findings: takes what is wrong.
        element: has the attribute.
        attribute: its name.
        count: how many numbers it takes.
        needed: whether nothing can be published without them.
    """
    text = element.get(attribute)
    if text is None:
        return None
    words = text.split()
    fault = next(filter(None, map(number_fault, words)), None)
    if fault is None and len(words) == count:
        return tuple(map(float, words))
    report = findings.error if needed else findings.problem
    written = f'{attribute}="{_cut(text)}"'
    if "," in text and len(text.replace(",", " ").split()) == count:
        report(element, f"{written} has commas; separate the numbers by spaces")
    elif fault is not None:
        report(element, f"{written}: {fault}")
    else:
        noun = "number" if count == 1 else "numbers"
        report(element, f"{written} holds {len(words)}; it takes {count} {noun}")
    return None


def read_triple(
    findings: Findings, element: Element, attribute: str, *, needed: bool = False
) -> Triple | None:
    """Return three numbers; None if there is no such attribute, or it is wrong."""
    numbers = read_numbers(findings, element, attribute, 3, needed=needed)
    return None if numbers is None else (numbers[0], numbers[1], numbers[2])


def read_number(
    findings: Findings,
    element: Element,
    attribute: str,
    *,
    required: bool = False,
    negative: bool = True,
) -> float | None:
    """Return the one number in an attribute; None if it is absent or wrong.

    Args:
        findings: takes what is wrong.
        element: has the attribute.
        attribute: its name.
        required: whether its absence is a problem.
        negative: whether it may be below zero.
    """
    if element.get(attribute) is None:
        if required:
            findings.problem(element, f'has no {attribute}; write {attribute}="..."')
        return None
    numbers = read_numbers(findings, element, attribute, 1)
    if numbers is None:
        return None
    if not negative and numbers[0] < 0:
        findings.problem(element, f'{attribute}="{numbers[0]:g}" is negative; it must not be')
        return None
    return numbers[0]


def number_fault(word: str) -> str | None:
    """Why ``word`` is no usable number; None if it is one."""
    if _NUMBER.fullmatch(word):
        finite = math.isfinite(float(word))
        return None if finite else f"{_cut(word)} is too large for a number"
    if _NOT_FINITE.fullmatch(word):
        return f"{word} is not a finite number"
    return f'"{_cut(word)}" is not a number'


def _cut(text: str) -> str:
    """A text short enough to show in one line."""
    flat = " ".join(text.split())
    return flat if len(flat) <= 60 else flat[:57] + "..."


def _read_origin(findings: Findings, element: Element, *, needed: bool = False) -> Origin | None:
    """Return the <origin> of ``element``; None if a number in it is wrong."""
    origin = element.find("origin")
    if origin is None:
        return Origin()
    xyz, rpy = (
        ZERO if origin.get(name) is None else read_triple(findings, origin, name, needed=needed)
        for name in ("xyz", "rpy")
    )
    _check_radians(findings, origin, rpy or ())
    return None if xyz is None or rpy is None else Origin(xyz, rpy)


def _check_radians(findings: Findings, element: Element, angles: Sequence[float]) -> None:
    """Warn of angles that are probably in degrees, as they are above a turn."""
    degrees = max(map(abs, angles), default=0.0)
    if degrees > _TURN:
        radians = f"{math.radians(degrees):.4g}"
        text = f"{degrees:g} is more than a turn; angles are in rad"
        findings.warning(element, f"{text}: if it is in degrees, write {radians}")


def read_links(findings: Findings, materials: Mapping[Element, Material]) -> dict[Element, Link]:
    """Read every link, those without a name or with a repeated one among them.

    Args:
        findings: takes what is wrong.
        materials: of the document, see ``read_materials``.
    """
    root = findings.document.root
    colors = _colors(root, materials)
    return {element: _read_link(findings, element, colors) for element in root.iterfind("link")}


def _read_link(findings: Findings, element: Element, colors: Mapping[Element, Rgba]) -> Link:
    visuals: list[Geometry] = []
    collisions: list[Geometry] = []
    left_out: list[str] = []
    for part in element:
        if part.tag in ("visual", "collision"):
            before = len(findings.found)
            geometry = _read_geometry(findings, part, colors)
            if geometry is not None:
                (visuals if part.tag == "visual" else collisions).append(geometry)
            else:
                left_out += [finding.text for finding in findings.found[before:]]
    friction = element.find("contact/lateral_friction")
    return Link(
        element.get("name", ""),
        tuple(visuals),
        tuple(collisions),
        _read_inertial(findings, element),
        None if friction is None else read_number(findings, friction, "value"),
        findings.where(element),
        tuple(left_out),
    )


def _read_inertial(findings: Findings, link: Element) -> Inertial | None:
    element = link.find("inertial")
    if element is None:
        return None
    origin = _read_origin(findings, element)
    mass = _read_mass(findings, element)
    inertia = _read_inertia(findings, element)
    if origin is None or mass is None or inertia is None:
        return None
    return Inertial(origin, mass, inertia)


def _read_mass(findings: Findings, inertial: Element) -> float | None:
    mass = inertial.find("mass")
    if mass is None:
        findings.problem(inertial, 'has no <mass>; write <mass value="..."/>, in kg')
        return None
    value = read_number(findings, mass, "value", required=True)
    if value is not None and value < 0:
        findings.problem(mass, f'value="{value:g}" is negative; it must not be')
    return value


def _read_inertia(findings: Findings, inertial: Element) -> Moments | None:
    inertia = inertial.find("inertia")
    if inertia is None:
        text = 'has no <inertia>; write ixx="..." iyy="..." izz="..." and the rest'
        findings.problem(inertial, text)
        return None
    xx, xy, xz, yy, yz, zz = (
        read_number(findings, inertia, name, required=True)
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    if xx is None or xy is None or xz is None or yy is None or yz is None or zz is None:
        return None
    return xx, xy, xz, yy, yz, zz


def _read_geometry(
    findings: Findings, part: Element, colors: Mapping[Element, Rgba]
) -> Geometry | None:
    """Read a <visual> or <collision>; None if anything in it is wrong."""
    origin = _read_origin(findings, part)
    geometry = part.find("geometry")
    known = f"one of: {', '.join(_SHAPES)}"
    if geometry is None:
        findings.problem(part, f"has no <geometry>; it takes {known}")
        return None
    found = [_read_shape(findings, element) for element in geometry]
    if len(found) == 1 and found[0] is not None and origin is not None:
        return Geometry(found[0], origin, colors.get(part), findings.where(part))
    if not found:
        findings.problem(geometry, f"is empty; it takes {known}")
    elif len(found) > 1:
        names = listing(str(element.tag) for element in geometry)
        findings.problem(
            geometry,
            f"holds {len(found)} shapes ({names}); it takes one; "
            f"give the link a second <{part.tag}>",
        )
    return None


def _read_shape(findings: Findings, element: Element) -> Shape | None:
    if element.tag == "capsule":
        findings.problem(element, "is no shape of URDF; other programs refuse the robot")
    elif element.tag not in _SHAPES:
        findings.problem(element, f"unknown shape{findings.hint(str(element.tag), _SHAPES)}")
        return None
    if element.tag == "mesh":
        return _read_mesh(findings, element)
    if element.tag == "box":
        if element.get("size") is None:
            findings.problem(element, 'has no size; write size="x y z", in m')
        size = read_triple(findings, element, "size")
        return Box(size) if size and _is_size(findings, element, "size", size) else None
    radius = _read_size(findings, element, "radius")
    if element.tag == "sphere":
        return None if radius is None else Sphere(radius)
    length = _read_size(findings, element, "length")
    if radius is None or length is None:
        return None
    return (Cylinder if element.tag == "cylinder" else Capsule)(radius, length)


def _read_size(findings: Findings, element: Element, attribute: str) -> float | None:
    size = read_number(findings, element, attribute, required=True)
    return size if size is not None and _is_size(findings, element, attribute, (size,)) else None


def _is_size(
    findings: Findings, element: Element, attribute: str, sizes: tuple[float, ...]
) -> bool:
    written = f'{attribute}="{element.get(attribute)}"'
    if min(sizes) == 0:
        findings.warning(element, f"{written} is zero; sizes are in m and above 0")
    elif min(sizes) < 0:
        findings.problem(element, f"{written} is negative; sizes are in m and above 0")
    return min(sizes) >= 0


def _read_mesh(findings: Findings, element: Element) -> Mesh | None:
    uri = element.get("filename")
    if not uri:
        findings.problem(element, 'names no file; write filename="package://<package>/<path>"')
    scale: Triple | None = (1.0, 1.0, 1.0)
    if element.get("scale") is not None:
        scale = read_triple(findings, element, "scale")
        if scale is not None and 0 in scale:
            findings.warning(element, f'scale="{element.get("scale")}" flattens the mesh')
    if not uri or not scale:
        return None
    mesh = locate_mesh(findings.resources, uri, scale)
    element.set("filename", mesh.uri)
    findings.meshes.append((element, mesh))
    return mesh


def _colors(root: Element, materials: Mapping[Element, Material]) -> dict[Element, Rgba]:
    """Return the colour of each visual that has one: its material's own, or one of that name.

    A material of the robot overrides one of the same name in a visual.
    """
    named = {material.name: material.color for material in materials.values() if material.color}
    colors = {}
    for visual in root.iterfind("link/visual"):
        element = visual.find("material")
        if element is not None:
            material = materials[element]
            color = material.color or (named.get(material.name) if material.name else None)
            if color is not None:
                colors[visual] = color
    return colors


def read_materials(findings: Findings) -> dict[Element, Material]:
    """Read the materials of the visuals, then those of the robot."""
    root = findings.document.root
    elements = [*root.iterfind("link/visual/material"), *root.iterfind("material")]
    return {element: _read_material(findings, element) for element in elements}


def _read_material(findings: Findings, element: Element) -> Material:
    color, texture = element.find("color"), element.find("texture")
    return Material(
        element.get("name"),
        None if color is None else _read_color(findings, color),
        # Exporters write <texture filename=""/> where there is none.
        None if texture is None else texture.get("filename") or None,
    )


def _read_color(findings: Findings, color: Element) -> Rgba | None:
    if color.get("rgba") is None:
        findings.problem(color, 'has no rgba; write <color rgba="red green blue alpha"/>')
    rgba = read_numbers(findings, color, "rgba", 4)
    if rgba is None:
        return None
    if not all(0 <= value <= 1 for value in rgba):
        findings.problem(
            color, f'rgba="{color.get("rgba")}" leaves 0 to 1; divide values of 0 to 255 by 255'
        )
    red, green, blue, alpha = rgba
    return red, green, blue, alpha


def read_ends(
    findings: Findings, joints: Mapping[str, Element], links: Mapping[str, Element]
) -> dict[str, tuple[str, str]]:
    """Return the parent and child link of each joint whose ends are both known links."""
    ends = {}
    for name, joint in joints.items():
        parent = _read_end(findings, joint, "parent", links)
        child = _read_end(findings, joint, "child", links)
        if parent is not None and child is not None:
            if parent == child:
                findings.error(
                    joint, f'connects link "{parent}" with itself; parent or child is wrong'
                )
            else:
                ends[name] = (parent, child)
    return ends


def _read_end(
    findings: Findings, joint: Element, end: str, links: Mapping[str, Element]
) -> str | None:
    element = joint.find(end)
    if element is None:
        findings.error(joint, f'has no <{end}>; write <{end} link="..."/>')
        return None
    link = element.get("link")
    if not link:
        findings.error(element, f'names no link; write <{end} link="..."/>')
        return None
    if link not in links:
        hint = findings.hint(link, links, "links")
        findings.error(element, f'there is no link "{link}"{hint}')
        return None
    return link


def read_joint(
    findings: Findings, name: str, element: Element, ends: tuple[str, str] | None
) -> Joint:
    """Read one joint; what is wrong is reported and replaced by a default."""
    kind = _read_kind(findings, element)
    origin = _read_origin(findings, element, needed=True)
    lower, upper, velocity, effort = _read_limit(findings, element, kind)
    soft_lower, soft_upper = _read_soft_limits(findings, element)
    damping, friction = _read_dynamics(findings, element)
    parent, child = ends or ("", "")
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        origin=origin or Origin(),
        axis=_read_axis(findings, element, kind),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort,
        soft_lower=soft_lower,
        soft_upper=soft_upper,
        damping=damping,
        friction=friction,
        mimic=_read_mimic(findings, element),
        where=findings.where(element),
    )


def _read_kind(findings: Findings, element: Element) -> str:
    kind = element.get("type")
    if kind is None:
        findings.error(element, f"has no type; write one of: {', '.join(JOINT_KINDS)}")
    elif kind not in JOINT_KINDS:
        hint = findings.hint(kind, JOINT_KINDS)
        findings.error(element, f'unknown joint type "{kind}"{hint}')
    else:
        return kind
    return ""


def _read_axis(findings: Findings, element: Element, kind: str) -> Triple:
    axis = element.find("axis")
    if axis is None:
        return _DEFAULT_AXIS
    if axis.get("xyz") is None:
        findings.problem(axis, 'has no xyz; write for example <axis xyz="0 0 1"/>')
    xyz = read_triple(findings, axis, "xyz", needed=kind in _AXIS_KINDS)
    if xyz is None or kind not in _AXIS_KINDS:
        return _DEFAULT_AXIS
    largest = max(abs(value) for value in xyz)
    if largest == 0:
        findings.error(
            axis, f'the axis of a {kind} joint cannot be zero; write for example "0 0 1"'
        )
        return _DEFAULT_AXIS
    # Scaled first, so that neither huge nor tiny numbers leave the range of a float.
    scaled = [value / largest for value in xyz]
    norm = math.hypot(*scaled)
    if abs(norm * largest - 1) > _AXIS_ROUNDING:
        findings.warning(axis, f"the axis has length {norm * largest:.4g}; it is taken as length 1")
    unit: Triple = (scaled[0] / norm, scaled[1] / norm, scaled[2] / norm)
    if abs(norm * largest - 1) > 1e-6:
        # Rerun turns by wrong angles about axes of another length.
        axis.set("xyz", " ".join(repr(value) for value in unit))
        return unit
    return xyz if abs(norm * largest - 1) < 1e-15 else unit


def _read_limit(
    findings: Findings, element: Element, kind: str
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return lower, upper, velocity and effort."""
    limit = element.find("limit")
    bounded = kind in _LIMITED_KINDS
    if limit is None:
        if bounded:
            findings.problem(
                element,
                f"a {kind} joint needs a limit; write "
                '<limit lower="..." upper="..." effort="..." velocity="..."/>',
            )
        return None, None, None, None
    lower, upper = _read_range(findings, limit)
    needed = kind in MOVING_KINDS
    effort = read_number(findings, limit, "effort", required=needed, negative=False)
    velocity = read_number(findings, limit, "velocity", required=needed, negative=False)
    if not bounded:
        if kind == "continuous" and (lower or upper):
            text = "a continuous joint turns without end, so lower and upper are ignored"
            findings.warning(
                limit, f"{text}; delete them, or if it must stop there make it revolute"
            )
        return None, None, velocity, effort
    # The last joints of real arms turn by more than a turn, but not by whole numbers of radians.
    ends = [end for end in (lower, upper) if end is not None and kind == "revolute"]
    if all(end.is_integer() and abs(end) <= _MOST_DEGREES for end in ends):
        _check_radians(findings, limit, ends)
    if lower is not None and upper is not None and lower > upper:
        findings.problem(limit, f"lower {lower:g} is above upper {upper:g}; swap them")
        lower, upper = upper, lower
    elif lower == upper == 0:
        findings.warning(limit, "lower and upper are both 0, so the joint cannot move")
    if velocity == 0:
        findings.warning(limit, "velocity is 0, so the joint cannot move")
    return lower, upper, velocity, effort


def _read_range(findings: Findings, limit: Element) -> tuple[float | None, float | None]:
    """Return the least and the greatest position; None if either cannot be read."""
    # An end that is not given is 0, as the specification has it.
    lower, upper = (
        0.0 if limit.get(end) is None else read_number(findings, limit, end)
        for end in ("lower", "upper")
    )
    return (None, None) if lower is None or upper is None else (lower, upper)


def _read_soft_limits(findings: Findings, element: Element) -> tuple[float | None, float | None]:
    safety = element.find("safety_controller")
    if safety is None:
        return None, None
    lower = read_number(findings, safety, "soft_lower_limit")
    return lower, read_number(findings, safety, "soft_upper_limit")


def _read_dynamics(findings: Findings, element: Element) -> tuple[float, float]:
    """Return damping and friction, which only the simulation uses, and checks."""
    dynamics = element.find("dynamics")
    if dynamics is None:
        return 0.0, 0.0
    damping = read_number(findings, dynamics, "damping")
    return damping or 0.0, read_number(findings, dynamics, "friction") or 0.0


def _read_mimic(findings: Findings, element: Element) -> Mimic | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    joint = mimic.get("joint")
    if not joint:
        findings.problem(mimic, 'names no joint; write <mimic joint="..."/>')
        return None
    multiplier, offset = (
        default if mimic.get(name) is None else read_number(findings, mimic, name)
        for name, default in (("multiplier", 1.0), ("offset", 0.0))
    )
    return None if multiplier is None or offset is None else Mimic(joint, multiplier, offset)
