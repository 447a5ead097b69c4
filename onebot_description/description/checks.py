"""Checks a robot description as a whole; ``reading`` checks single values.

It checks names, the tree of links, mimic joints, mesh files and materials, and finds elements and
attributes that are not part of URDF, and xacro that is not expanded. ``unit_check`` finds lengths
in millimeters.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from onebot_description.elements.reading import ELEMENTS, Element, Findings, local_name
from onebot_description.elements.urdf import MOVING_KINDS, Joint, Material
from onebot_description.elements.xml import XACRO_NAMESPACES
from onebot_description.errors import listing

_VERSIONS = ("1.0", "1.1", "1.2")  # URDF's; the first is the default


def check_root(findings: Findings) -> None:
    """Check that the document is a robot with a name, or contains a robot, which is then used."""
    document = findings.document
    outer, root = document.root, document.root
    if outer.tag != "robot":
        inner = outer.find("robot")
        if inner is None:
            text = 'the outermost element must be <robot name="...">; convert other formats to URDF'
            findings.error(outer, text)
            findings.raise_errors()
        else:
            root = inner
            findings.document = replace(document, root=root)
            findings.problem(root, f"is inside <{outer.tag}>; make <robot> the outermost element")
    name = root.get("name")
    if name is None or not name.strip():
        findings.problem(root, 'the robot has no name; write <robot name="...">')
    version = root.get("version", _VERSIONS[0])
    if version not in _VERSIONS:
        text = f'version="{version}" of URDF is not known ({", ".join(_VERSIONS)}), so other '
        findings.warning(root, f"{text}programs reject it; it is read as {_VERSIONS[-1]}")
        version = _VERSIONS[-1]
    major, minor = version.split(".")
    findings.version = int(major), int(minor)


def named(findings: Findings, tag: str) -> dict[str, Element]:
    """Return the robot's elements with a ``tag`` by name; report bad and repeated names."""
    elements: dict[str, Element] = {}
    for element in findings.document.root.findall(tag):
        name = element.get("name")
        if name is None or not name.strip():
            findings.error(element, f'has no name; write <{tag} name="...">')
            continue
        if re.search(r"[\s/]", name):
            text = f'the name "{name}" contains a space or slash, which breaks TF frame names'
            findings.warning(element, text)
        if name in elements:
            first = findings.document.places.get(elements[name], "above")
            findings.error(element, f"there already is a {tag} of that name, at {first}; rename it")
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
        findings: findings of the document; faults are added.
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
                "a link can have only one",
            )
        else:
            above[child] = joint
    parents = {child: ends[joint][0] for child, joint in above.items()}
    for loop in cycles(parents):
        loop.reverse()  # now parents come before their children
        names = " -> ".join([*loop, loop[0]])
        findings.error(
            joints[above[loop[0]]], f"the links {names} form a loop; remove one of its joints"
        )
    roots = [link for link in links if link not in parents]
    # A joint that could not be read may well be the missing connection.
    if len(roots) > 1 and len(ends) == len(findings.document.root.findall("joint")):
        findings.problem(
            links[roots[1]],
            f"the robot is in {len(roots)} separate parts, with the roots {listing(roots)}; "
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
        The joints that follow a missing joint, themselves, a cycle, or a joint without position.
    """
    masters = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    moving = [name for name, joint in joints.items() if joint.kind in MOVING_KINDS]
    wrong: dict[str, str] = {}  # joint -> what is wrong with its mimic
    for name, master in masters.items():
        kind = joints[name].kind
        if kind and kind not in MOVING_KINDS:
            wrong[name] = f"a {kind} joint has no single position, so it cannot mimic"
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
    """Check the names of the robot's materials, and that each reference has a definition."""
    definitions: dict[str, Material] = {}
    for element, material in materials.items():
        if material.name is None:
            findings.problem(element, 'has no name; write <material name="...">')
        elif not material.name or material.is_reference:
            continue
        elif definitions.setdefault(material.name, material) != material:
            text = "a material of that name looks different elsewhere, and is used here; rename one"
            findings.warning(element, text)
    for element, material in materials.items():
        if material.is_reference and material.name is not None and material.name not in definitions:
            hint = findings.hint(material.name, definitions, "materials")
            findings.warning(element, f"no material of that name is defined{hint}")


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
    """Warn about elements that URDF does not have, and report xacro that is not expanded."""
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
    """Warn about unknown attributes, and collect xacro expressions."""
    content = ELEMENTS.get(element.tag)
    attributes = [*content.texts.split(), *content.numbers] if content else []
    for name, value in element.attrib.items():
        if left := _XACRO_LEFT.search(value):
            leftovers.append((element, f'{name}="{left[0]}"'))
        if content is None or name.startswith("{") or name in attributes:
            continue
        hint = findings.hint(name, attributes) if attributes else ""
        findings.warning(element, f'unknown attribute "{name}", so it is ignored{hint}')


def _check_repeats(findings: Findings, element: Element) -> None:
    """Report repeated elements where only one makes sense; readers differ in which one they use."""
    if element.tag not in ELEMENTS or element.tag == "robot":
        return
    for tag, count in Counter(child.tag for child in element).items():
        if count > 1 and tag in _SINGLE:
            text = f"occurs {count} times in {findings.label(element)}; keep one"
            findings.problem(element.findall(tag)[1], text)
