"""Checks of a robot description beyond single values, which ``reading`` checks.

It checks names, the tree of links, mimic joints, masses, mesh files, materials, elements and
attributes that are not part of URDF, and xacro that is not expanded.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from onebot_description.elements.description import MOVING_KINDS, Inertial, Joint, Material
from onebot_description.elements.reading import ELEMENTS, Element, Findings, local_name
from onebot_description.elements.xml import XACRO_NAMESPACES
from onebot_description.errors import listing

# Robots in other formats, by their outermost elements.
_FORMATS = {"sdf": "SDF", "COLLADA": "COLLADA", "mujoco": "MJCF"}


def check_root(findings: Findings) -> None:
    """Check that the document is a robot with a name; if the robot is inside another, take it."""
    document = findings.document
    outer, root = document.root, document.root
    if outer.tag != "robot":
        inner = outer.find("robot")
        if inner is None:
            findings.error(outer, _wrong_root(outer))
            findings.raise_errors()
        else:
            root = inner
            findings.document = replace(document, root=root)
            findings.problem(root, f"lies in <{outer.tag}>; let <robot> be the outermost element")
    name = root.get("name")
    if name is None or not name.strip():
        findings.problem(root, 'the robot has no name; write <robot name="...">')


def _wrong_root(root: Element) -> str:
    """Return the message about a document without a robot."""
    form = _FORMATS.get(local_name(root))
    if form is not None:
        return f"is a robot in {form}, which is not read; convert it to URDF"
    children = listing(child.tag for child in root)
    return f'the outermost element must be <robot name="...">; this one holds: {children}'


def named(findings: Findings, tag: str) -> dict[str, Element]:
    """Return the robot's elements of a ``tag`` by name; bad and repeated names are reported."""
    elements: dict[str, Element] = {}
    for element in findings.document.root.findall(tag):
        name = element.get("name")
        if name is None or not name.strip():
            findings.error(element, f'has no name; write <{tag} name="...">')
            continue
        if re.search(r"[\s/]", name):
            text = f'the name "{name}" holds a space or slash, which TF dislikes'
            findings.warning(element, text)
        if name in elements:
            first = findings.document.places.get(elements[name], "above")
            findings.error(element, f"there is a {tag} of that name already, at {first}; rename it")
            continue
        elements[name] = element
    return elements


def check_tree(
    findings: Findings,
    joints: Mapping[str, Element],
    links: Mapping[str, Element],
    ends: Mapping[str, tuple[str, str]],
) -> str:
    """Check that the links form one tree.

    Args:
        findings: of the document; faults are added.
        joints: elements by name.
        links: elements by name.
        ends: parent and child link of each joint.

    Returns:
        The root link: the first one if there are several, "" if there is none.
    """
    if not links:
        findings.error(
            findings.document.root, 'has no links; write at least <link name="base_link"/>'
        )
        return ""
    above: dict[str, str] = {}  # child link -> the joint that moves it
    for joint, (_, child) in ends.items():
        if child in above:
            findings.error(
                joints[joint],
                f'link "{child}" has two parents: joint "{above[child]}" moves it already; '
                "a link hangs on one joint",
            )
        else:
            above[child] = joint
    parents = {child: ends[joint][0] for child, joint in above.items()}
    for loop in cycles(parents):
        loop.reverse()  # parents are before their children now
        names = " -> ".join([*loop, loop[0]])
        findings.error(
            joints[above[loop[0]]], f"the links {names} form a loop; remove one of its joints"
        )
    roots = [link for link in links if link not in parents]
    # A joint that could not be read may well be the missing connection.
    if len(roots) > 1 and len(ends) == len(findings.document.root.findall("joint")):
        findings.problem(
            links[roots[1]],
            f"the robot falls into {len(roots)} parts, whose roots are {listing(roots)}; "
            f'connect each with a joint, so that only "{roots[0]}" has no parent',
        )
    return roots[0] if roots else ""


def cycles(parents: Mapping[str, str]) -> list[list[str]]:
    """Return the cycles in a map of child to parent, each from child to parent."""
    loops = []
    done: set[str] = set()
    for link in parents:
        path: list[str] = []
        while link in parents and link not in done:
            done.add(link)
            path.append(link)
            link = parents[link]
        if link in path:
            loops.append(path[path.index(link) :])
    return loops


def check_mimics(
    findings: Findings, joints: Mapping[str, Joint], elements: Mapping[str, Element]
) -> set[str]:
    """Check that each mimic joint follows, maybe via others, a joint that moves by itself.

    Returns:
        The joints that follow a missing joint, themselves, a circle, or a joint without position.
    """
    masters = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    moving = [name for name, joint in joints.items() if joint.kind in MOVING_KINDS]
    wrong: dict[str, str] = {}  # joint -> what is wrong with its mimic
    for name, master in masters.items():
        kind = joints[name].kind
        if kind and kind not in MOVING_KINDS:
            wrong[name] = f"a {kind} joint has no single position, so it cannot mimic"
        elif master == name:
            wrong[name] = "the joint mimics itself; name another joint"
        elif master not in joints:
            hint = findings.hint(master, [joint for joint in moving if joint != name], "joints")
            wrong[name] = f'there is no joint "{master}" to mimic{hint}'
        elif joints[master].kind and joints[master].kind not in MOVING_KINDS:
            wrong[name] = f'joint "{master}" is {joints[master].kind} and has no position to mimic'
    circles = cycles({name: master for name, master in masters.items() if name not in wrong})
    for circle in circles:
        names = " -> ".join([*circle, circle[0]])
        wrong[circle[0]] = f"the joints {names} mimic each other in a circle"
    for name, text in wrong.items():
        element = elements[name].find("mimic")
        assert element is not None  # a Mimic was read from it
        findings.problem(element, text)
    return {*wrong, *(name for circle in circles for name in circle)}


# Moments are written with few digits; a plate's are just at the limit of the triangle inequality.
_INERTIA_ROUNDING = 0.01
# A moment below these is 0, apart from rounding in the program that computed it.
_CAD_ROUNDING, _RELATIVE_ROUNDING = 1e-15, 1e-9  # kg m^2, and of the largest moment


def check_inertial(findings: Findings, link: Element, inertial: Inertial) -> None:
    """Warn if mass or inertia of ``link`` are physically impossible."""
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    assert mass is not None and inertia is not None  # the inertial was read from them
    if inertial.mass == 0:
        findings.warning(mass, "the mass is 0; a simulation takes a base of mass 0 for fixed")
    moments = inertial.inertia
    largest = max(map(abs, moments))
    if largest == 0:
        findings.warning(inertia, "the inertia is zero; a simulation cannot turn such a link")
        return
    rounded = -max(_CAD_ROUNDING, _RELATIVE_ROUNDING * largest)
    for name, moment in {"ixx": moments[0], "iyy": moments[3], "izz": moments[5]}.items():
        if moment < rounded:
            findings.problem(inertia, f'{name}="{moment:g}" is negative; it must not be')
            return
    least, middle, greatest = _principal_moments(*(value / largest for value in moments))
    if least <= 0:
        text = f"the inertia is not positive definite (least moment {least * largest:.3g} kg m2)"
        findings.warning(inertia, f"{text}; no real body has such moments")
    elif greatest > (least + middle) * (1 + _INERTIA_ROUNDING):
        values = ", ".join(f"{value * largest:.3g}" for value in (least, middle, greatest))
        findings.warning(
            inertia, f"of the moments {values} one exceeds the sum of the others; no body has such"
        )


def _principal_moments(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float]:
    """Return the eigenvalues of a symmetric matrix with elements up to 1, in ascending order.

    O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", Communications of the ACM 4 (4), 1961.
    NumPy would take longer to import than everything here.
    """
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = determinant / (2 * spread**3) if spread > 1e-12 else 1.0
    angle = math.acos(max(-1.0, min(1.0, cosine))) / 3
    greatest = mean + 2 * spread * math.cos(angle)
    least = mean + 2 * spread * math.cos(angle + 2 * math.pi / 3)
    values = (round(value, 12) + 0.0 for value in (least, 3 * mean - greatest - least, greatest))
    least, middle, greatest = values
    return least, middle, greatest


def check_meshes(findings: Findings) -> None:
    """Report meshes without a file; each reason once, at the first such mesh."""
    reasons: dict[str, list[Element]] = {}
    for element, mesh in findings.meshes:
        if mesh.problem:
            reasons.setdefault(mesh.problem, []).append(element)
    for reason, elements in reasons.items():
        count = f"{len(elements)} meshes: " if len(elements) > 1 else ""
        findings.problem(elements[0], f"{count}{reason}")


def check_materials(findings: Findings, materials: Mapping[Element, Material]) -> None:
    """Check the names of the robot's materials, then of its visuals'."""
    robots = dict.fromkeys(findings.document.root.iterfind("material"))
    visuals = [element for element in materials if element not in robots]
    definitions: dict[str, Material] = {}
    for element in (*robots, *visuals):
        _check_material(findings, element, materials[element], definitions, element in robots)
    for element in visuals:
        name = materials[element].name
        if materials[element].is_reference and name and name not in definitions:
            hint = findings.hint(name, definitions, "materials")
            findings.warning(element, f"no material of that name is defined{hint}")


def _check_material(
    findings: Findings,
    element: Element,
    material: Material,
    definitions: dict[str, Material],
    is_robots: bool,
) -> None:
    """Check one material and add it to the definitions, which any visual may use."""
    if not material.name and (is_robots or material.name is None):
        remedy = "" if is_robots else ', if need be name=""'
        findings.problem(element, f'has no name; write <material name="...">{remedy}')
    elif material.is_reference and is_robots:
        findings.warning(element, "defines neither <color> nor <texture>")
    elif material.is_reference and not material.name:
        findings.warning(element, "has neither a name nor a <color>, so it does nothing")
    elif material.is_reference or not material.name:
        return
    elif definitions.setdefault(material.name, material) != material and is_robots:
        text = "there is another material of that name that looks different; rename one"
        findings.problem(element, text)
    elif definitions[material.name] != material:
        text = "a material of that name looks different elsewhere, and is used here; rename one"
        findings.warning(element, text)


# Other programs' elements; they may hold anything.
EXTENSIONS = frozenset(
    "gazebo transmission ros2_control sensor mujoco drake plugin contact audio_source "
    "self_collision_checking verbose calibration safety_controller loop_joint model".split()
)

_SINGLE = frozenset(
    "origin geometry material mass inertia inertial parent child axis limit mimic dynamics".split()
)
_XACRO_LEFT = re.compile(r"\$\{[^}]*\}?|\$\([^)]*\)?")


def check_schema(findings: Findings) -> None:
    """Warn of elements that URDF does not have, and report xacro that is not expanded."""
    leftovers: list[tuple[Element, str]] = []
    waiting = [findings.document.root]
    while waiting:
        element = waiting.pop()
        _check_attributes(findings, element, leftovers)
        inside = []
        for child in element:
            if child.tag.startswith("{"):
                if child.tag[1:].split("}")[0] in XACRO_NAMESPACES:
                    leftovers.append((child, f"<xacro:{local_name(child)}>"))
            elif child.tag not in EXTENSIONS:
                _check_child(findings, element, child)
                inside.append(child)
        _check_repeats(findings, element)
        waiting.extend(reversed(inside))
    if leftovers:
        element, text = leftovers[0]
        more = f" and {len(leftovers) - 1} more" if len(leftovers) > 1 else ""
        lacks_parts = any(leftover.tag.startswith("{") for leftover, _ in leftovers)
        report = findings.error if lacks_parts else findings.problem
        report(
            element,
            f"{text}{more} is xacro that was not expanded; name the file .xacro and write "
            f'<robot xmlns:xacro="{XACRO_NAMESPACES[0]}" ...>',
        )


def _check_child(findings: Findings, element: Element, child: Element) -> None:
    """Warn if ``child`` is not known inside ``element``."""
    if element.tag not in ELEMENTS or element.tag == "geometry":
        return  # unknown itself, so already reported, or checked with the shapes
    children = ELEMENTS[element.tag].children.split()
    if child.tag not in children:
        hint = findings.hint(child.tag, children, "known here") if children else ""
        findings.warning(child, f"unknown inside <{element.tag}>, so it is ignored{hint}")


def _check_attributes(
    findings: Findings, element: Element, leftovers: list[tuple[Element, str]]
) -> None:
    """Warn of unknown attributes and collect xacro expressions."""
    attributes = ELEMENTS[element.tag].attributes if element.tag in ELEMENTS else None
    for name, value in element.attrib.items():
        if left := _XACRO_LEFT.search(value):
            leftovers.append((element, f'{name}="{left[0]}"'))
        if attributes is None or name.startswith("{") or name in attributes:
            continue
        if element.tag == "origin" and name == "quat_xyzw":
            findings.error(element, "quat_xyzw is not supported; write rpy in radians")
        else:
            hint = findings.hint(name, attributes) if attributes else ""
            findings.warning(element, f'unknown attribute "{name}", so it is ignored{hint}')


def _check_repeats(findings: Findings, element: Element) -> None:
    """Report second elements where only one makes sense; readers differ in which they take."""
    if element.tag not in ELEMENTS or element.tag == "robot":
        return
    for tag, count in Counter(child.tag for child in element).items():
        if count > 1 and tag in _SINGLE:
            text = f"stands {count} times in {findings.label(element)}; leave one"
            findings.problem(element.findall(tag)[1], text)
