"""Elements and attributes that URDF does not know (probable typos), names, leftovers of xacro."""

import re
from collections import Counter

from onebot_description.description.reading import XACRO_NAMESPACES
from onebot_description.description.report import Element, Report, local_name
from onebot_description.text import did_you_mean, listing

# Other programs' parts, of which nothing is known here; they may hold anything.
EXTENSIONS = frozenset(
    "gazebo transmission ros2_control sensor mujoco drake plugin contact audio_source "
    "self_collision_checking verbose calibration safety_controller loop_joint model".split()
)

# element: (children, attributes)
_SCHEMA = {
    "robot": ("link joint material", "name version"),
    "link": ("inertial visual collision", "name type"),
    "joint": ("origin parent child axis limit dynamics mimic", "name type"),
    "inertial": ("origin mass inertia", ""),
    "visual": ("origin geometry material", "name"),
    "collision": ("origin geometry", "name group concave"),
    "geometry": ("box cylinder sphere mesh", ""),
    "material": ("color texture", "name"),
    "origin": ("", "xyz rpy"),
    "mass": ("", "value"),
    "inertia": ("", "ixx ixy ixz iyy iyz izz"),
    "box": ("", "size"),
    "cylinder": ("", "radius length"),
    "sphere": ("", "radius"),
    "mesh": ("", "filename scale"),
    "color": ("", "rgba"),
    "texture": ("", "filename"),
    "parent": ("", "link"),
    "child": ("", "link"),
    "axis": ("", "xyz"),
    "limit": ("", "lower upper effort velocity acceleration jerk deceleration"),
    "dynamics": ("", "damping friction"),
    "mimic": ("", "joint multiplier offset"),
}
_SINGLE = frozenset(
    "origin geometry material mass inertia inertial parent child axis limit mimic dynamics".split()
)
_XACRO_LEFT = re.compile(r"\$\{[^}]*\}?|\$\([^)]*\)?")


def check_schema(report: Report) -> None:
    """Warn of what URDF does not know, and refuse xacro that nobody has expanded."""
    leftovers: list[tuple[Element, str]] = []
    waiting = [report.document.root]
    while waiting:
        element = waiting.pop()
        _check_attributes(report, element, leftovers)
        inside = []
        for child in element:
            if child.tag.startswith("{"):
                if child.tag[1:].split("}")[0] in XACRO_NAMESPACES:
                    leftovers.append((child, f"<xacro:{local_name(child)}>"))
            elif child.tag not in EXTENSIONS:
                _check_child(report, element, child)
                inside.append(child)
        _check_repeats(report, element)
        waiting.extend(reversed(inside))
    if leftovers:
        element, text = leftovers[0]
        more = f" and {len(leftovers) - 1} more" if len(leftovers) > 1 else ""
        report.problem(
            element,
            f"{text}{more} is xacro that was not expanded; name the file .xacro and write "
            f'<robot xmlns:xacro="{XACRO_NAMESPACES[0]}" ...>',
        )


def _check_child(report: Report, element: Element, child: Element) -> None:
    """Warn if ``child`` is not known inside ``element``."""
    if element.tag not in _SCHEMA or element.tag == "geometry":
        return  # unknown itself, so already reported, or checked with the shapes
    children = _SCHEMA[element.tag][0].split()
    if child.tag not in children:
        hint = did_you_mean(child.tag, children, "known here") if children else ""
        report.typo(child, f"unknown inside <{element.tag}>, so it is ignored{hint}")


def _check_attributes(
    report: Report, element: Element, leftovers: list[tuple[Element, str]]
) -> None:
    """Warn of unknown attributes and collect xacro expressions."""
    known = _SCHEMA[element.tag][1].split() if element.tag in _SCHEMA else None
    for name, value in element.attrib.items():
        if left := _XACRO_LEFT.search(value):
            leftovers.append((element, f'{name}="{left[0]}"'))
        if known is None or name.startswith("{") or name in known:
            continue
        if element.tag == "origin" and name == "quat_xyzw":
            report.problem(element, "quat_xyzw is not supported; write rpy in radians")
        else:
            hint = did_you_mean(name, known) if known else ""
            report.typo(element, f'unknown attribute "{name}", so it is ignored{hint}')


def _check_repeats(report: Report, element: Element) -> None:
    """Refuse second elements where only one makes sense; readers differ in which they take."""
    if element.tag not in _SCHEMA or element.tag == "robot":
        return
    for tag, count in Counter(child.tag for child in element).items():
        if tag in _SINGLE and count > 1:
            second = element.findall(tag)[1]
            report.problem(second, f"stands {count} times in {report.label(element)}; leave one")


def named(report: Report, tag: str) -> dict[str, Element]:
    """Return the robot's elements of one ``tag`` by name, reporting bad and repeated names."""
    found: dict[str, Element] = {}
    for element in report.document.root.findall(tag):
        name = element.get("name")
        if name is None or not name.strip():
            report.problem(element, f'has no name; write <{tag} name="...">')
            continue
        if re.search(r"[\s/]", name):
            report.warning(element, f'the name "{name}" holds a space or slash, which TF dislikes')
        if name in found:
            first = report.document.places.get(found[name], "above")
            report.problem(element, f"there is a {tag} of that name already, at {first}; rename it")
            continue
        found[name] = element
    return found


def check_root(report: Report) -> None:
    """Check that the document is a robot, with a name and a link.

    Raises:
        DescriptionError: it is not a robot, so that nothing else can be checked.
    """
    root = report.document.root
    if root.tag != "robot":
        found = listing(child.tag for child in root)
        report.problem(
            root, f'the outermost element must be <robot name="...">; this one holds: {found}'
        )
        report.raise_if_any()
    name = root.get("name")
    if name is None or not name.strip():
        report.problem(root, 'the robot has no name; write <robot name="...">')
