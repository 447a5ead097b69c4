"""Reads what ``<gazebo>`` says of a robot's drive: its plugin, and the rollers of its wheels."""

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

from onebot_description.elements.reading import Element, Findings, number_fault
from onebot_description.elements.urdf import DriveKind, DrivePlugin, Joint
from onebot_description.errors import shortened
from onebot_description.geometry.poses import Triple, from_rpy, rotate

# Gazebo moves the base of a "planar" robot as a whole, so its wheels may look like any others.
_KINDS: dict[DriveKind, re.Pattern[str]] = {
    "mecanum": re.compile(r"mec+anum.?drive", re.IGNORECASE),
    "ackermann": re.compile(r"ackerman+", re.IGNORECASE),
    "planar": re.compile(
        r"planar.?move|mec+anum|omni|(?<!joint)(?<!joint.)velocity.?control(?!ler)", re.IGNORECASE
    ),
}
_CONTROL = re.compile(r"ros2?_control", re.IGNORECASE)  # its name may hold that of a controller
_TAGS_BY_ROLE: dict[DriveKind, dict[str, tuple[str, ...]]] = {
    "mecanum": {
        "front_left": ("front_left_joint",),
        "front_right": ("front_right_joint",),
        "rear_right": ("back_right_joint",),
        "rear_left": ("back_left_joint",),
    },
    "ackermann": {
        "left": ("left_joint", "front_left_joint", "rear_left_joint"),
        "right": ("right_joint", "front_right_joint", "rear_right_joint"),
        "left_steering": ("left_steering_joint",),
        "right_steering": ("right_steering_joint",),
    },
    "planar": {},
}
_LENGTHS = {
    "wheelbase": "wheelbase",
    "wheel_base": "wheelbase",
    "wheel_separation": "wheel_separation",
    "wheel_radius": "wheel_radius",
    "kingpin_width": "kingpin_width",
    "steering_limit": "steering_limit",
    "max_steer": "steering_limit",
}
_DIRECTION, _FIRST, _SECOND = "fdir1", ("mu", "mu1"), "mu2"
_SLIDES = 0.2  # A wheel with rollers has at most this fraction of its friction across their axles.
_OBLIQUE = math.sin(math.radians(5.0))  # sine of the least angle between oblique lines
_ROUNDING = 1e-9  # rad


def read_drive_plugin(findings: Findings, joints: Collection[str]) -> DrivePlugin | None:
    """Return the first Gazebo plugin that drives the robot, except differential drives.

    Args:
        findings: findings of the document; faults are added.
        joints: names of the joints.
    """
    for plugin in findings.document.root.iterfind("gazebo/plugin"):
        filename = plugin.get("filename", "")
        words = f"{filename} {plugin.get('name', '')}"
        kind = next((kind for kind, pattern in _KINDS.items() if pattern.search(words)), None)
        if kind is not None and not _CONTROL.search(filename):
            return DrivePlugin(
                kind,
                f"{findings.where(plugin)}: plugin {filename}",
                {
                    role: names
                    for role, tags in _TAGS_BY_ROLE[kind].items()
                    if (names := tuple(_joints(findings, plugin, tags, joints)))
                },
                dict(_lengths(findings, plugin)),
                (plugin.findtext("topic") or "").strip(),
            )
    return None


def _joints(
    findings: Findings, plugin: Element, tags: Collection[str], joints: Collection[str]
) -> Iterator[str]:
    """Yield the joints that exist of those that a plugin names in these elements."""
    for element in plugin:
        if element.tag in tags:
            name = (element.text or "").strip()
            if name in joints:
                yield name
            else:
                hint = findings.hint(name, joints, "joints")
                findings.warning(element, f'the robot has no joint "{name}"{hint}')


def _lengths(findings: Findings, plugin: Element) -> Iterator[tuple[str, float]]:
    for element in plugin:
        if element.tag in _LENGTHS:
            text = (element.text or "").strip()
            if not (fault := number_fault(text)) and float(text) > 0.0:
                yield _LENGTHS[element.tag], float(text)
            else:
                findings.problem(element, fault or f'"{text}" is not positive; it must be')


class Rollers(NamedTuple):
    """The rollers of wheels."""

    angles: Mapping[str, float]  # by link; see Description.rollers
    elements: frozenset[Element]  # they say so


def read_rollers(findings: Findings, links: Collection[str], joints: Iterable[Joint]) -> Rollers:
    """Read the rollers of wheels from the two directions of their friction.

    Friction grips along the axle of the roller at the ground, and slides across it. Directions
    without a frame are in the base's, though Gazebo would turn them with the wheel.

    Args:
        findings: findings of the document; faults are added.
        links: names of the links.
        joints: the joints.
    """
    above = {joint.child: joint for joint in joints}
    friction: dict[str, list[Element]] = {}
    for block in findings.document.root.iterfind("gazebo[@reference]"):
        link = _body(block.get("reference", ""), above)
        if link in above and above[link].kind in ("continuous", "revolute"):
            tags = (_DIRECTION, *_FIRST, _SECOND)
            friction.setdefault(link, []).extend(e for e in block.iter() if e.tag in tags)
    angles, elements = {}, set[Element]()
    for link, parts in friction.items():
        direction = next((part for part in parts if part.tag == _DIRECTION), None)
        if direction is None or (vector := _vector(findings, direction)) is None:
            continue
        frame = _frame(findings, direction, links)
        grips, axle = _angle(vector, frame, above), _angle(above[link].axis, link, above)
        across = abs(math.sin(grips - axle))
        first, second = _number(parts, _FIRST), _number(parts, (_SECOND,))
        if first is None and second is None:
            rolls = across > _OBLIQUE and abs(math.cos(grips - axle)) > _OBLIQUE
        else:
            most = _SLIDES * (1.0 if first is None else first)
            rolls = across > _OBLIQUE and (1.0 if second is None else second) <= most
        if rolls:
            angles[link] = grips
            elements.update(parts)
    return Rollers(angles, frozenset(elements))


def _body(link: str, above: Mapping[str, Joint]) -> str:
    """Return the link that carries ``link`` by fixed joints, which Gazebo makes one."""
    left = dict(above)  # each once, because the links may still form a loop
    while link in left and left[link].kind == "fixed":
        link = left.pop(link).parent
    return link


def _vector(findings: Findings, element: Element) -> Triple | None:
    """Return the direction in an element; None if it is faulty, or zero, which means none."""
    text = element.get("value", element.text or "")
    words = text.split()
    if len(words) != 3 or any(map(number_fault, words)):
        findings.problem(element, f'"{shortened(text)}" is not a direction; write x y z')
        return None
    x, y, z = map(float, words)
    return (x, y, z) if any((x, y, z)) else None


def _frame(findings: Findings, direction: Element, links: Collection[str]) -> str:
    """Return the link in whose frame a direction is; "" for the base."""
    frames = (text for key, text in direction.items() if key.endswith("expressed_in"))
    name = next(frames, "")  # The attribute's prefix is gz, ignition, or lost.
    if not name or name in links:
        return name
    hint = findings.hint(name, links, "links")
    text = f'expressed_in="{name}" is no link{hint}, so the direction is in the base\'s frame'
    findings.warning(direction, text)
    return ""


def _angle(vector: Triple, link: str, above: Mapping[str, Joint]) -> float:
    """Return a line's angle to the base's x axis seen from above, rad, in (-pi/2, pi/2].

    It is not a number for a vertical line.

    Args:
        vector: a direction of the line, in the frame of ``link`` with all joints at 0.
        link: the frame.
        above: the joint above each link.
    """
    left = dict(above)
    while link in left:
        joint = left.pop(link)
        vector, link = rotate(from_rpy(joint.origin.rpy), vector), joint.parent
    x, y, _ = vector
    if math.hypot(x, y) < _OBLIQUE * math.hypot(*vector):
        return math.nan
    angle = math.remainder(math.atan2(y, x), math.pi)
    return angle if angle > _ROUNDING - math.pi / 2 else angle + math.pi


def _number(parts: Iterable[Element], tags: Collection[str]) -> float | None:
    """Return the first number in elements with one of these tags; None if there is none."""
    texts = ((part.get("value") or part.text or "").strip() for part in parts if part.tag in tags)
    return next((float(text) for text in texts if not number_fault(text)), None)
