"""Reads a robot's drive from ``<gazebo>``: its plugin, and the rollers of its wheels."""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from onebot_description.elements.frames import placed
from onebot_description.elements.reading import Element, Findings, number_fault, value_text
from onebot_description.elements.urdf import DriveKind, DrivePlugin, Joint
from onebot_description.errors import shortened
from onebot_description.geometry.poses import Origin, Triple, rotate

# Patterns of each kind's plugin names, and of the elements that name joints (group: the role).
# Gazebo moves the base of a "planar" robot as a whole, so its wheels may look like any others.
_KINDS: dict[DriveKind, tuple[str, str]] = {
    "mecanum": (r"mec+anum.?drive", r"((?:front|back)_(?:left|right))_joint"),
    "ackermann": (
        r"ackerman+",
        r"(?:front_|rear_)?((?:left|right)(?:_steering)?)(?:_front|_rear)?_joint",
    ),
    "planar": (r"planar.?move|mec+anum|omni|(?<!joint)(?<!joint.)velocity.?control(?!ler)", ""),
}
_CONTROL = re.compile(r"ros2?_control", re.IGNORECASE)  # may be named after a controller
_STEERING_LIMIT = "steering_limit", "max_steer"
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")  # some plugins write leftHingeJoint
_DIRECTION, _FIRST, _SECOND = "fdir1", ("mu", "mu1"), ("mu2",)
_FRICTION = (_DIRECTION, *_FIRST, *_SECOND)
# Maximum friction of an omni wheel along its axle, as a fraction of that in its rolling direction.
_SLIDES = 0.2
_OBLIQUE = math.sin(math.radians(5.0))  # sine of the minimum angle between oblique lines
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
        for kind, (names, _) in _KINDS.items():
            if re.search(names, words, re.IGNORECASE) and not _CONTROL.search(filename):
                return _read_plugin(findings, plugin, kind, joints)
    return None


def _read_plugin(
    findings: Findings, plugin: Element, kind: DriveKind, joints: Collection[str]
) -> DrivePlugin:
    named: dict[str, tuple[str, ...]] = {}
    limit = math.inf
    for element in plugin:
        text = (element.text or "").strip()
        tag = _HUMP.sub("_", element.tag).lower().replace("_hinge_", "_steering_")
        if match := re.fullmatch(_KINDS[kind][1], tag):
            role = match[1].replace("back", "rear")
            if text in joints:
                named[role] = (*named.get(role, ()), text)
            else:
                hint = findings.hint(text, joints, "joints")
                findings.warning(element, f'the robot has no joint "{text}"{hint}')
        elif tag in _STEERING_LIMIT:
            if (fault := number_fault(text)) or float(text) <= 0.0:
                findings.problem(element, fault or f'"{text}" is not positive; it must be')
            else:
                limit = float(text)
    where = f"{findings.where(plugin)}: plugin {plugin.get('filename', '')}"
    return DrivePlugin(kind, where, named, limit)


class Rollers(NamedTuple):
    """The rollers of wheels."""

    angles: Mapping[str, float]  # keys are links; see Description.rollers
    elements: frozenset[Element]  # the elements that were read


def read_rollers(findings: Findings, links: Collection[str], joints: Collection[Joint]) -> Rollers:
    """Read the rollers of wheels from the two directions of their friction.

    Friction grips along the axle of the roller at the ground, and slides across it: if that axle is
    oblique, any difference counts. Directions without a frame are in the base's, though Gazebo
    would turn them with the wheel.

    Args:
        findings: findings of the document; faults are added.
        links: names of the links.
        joints: the joints.
    """
    above = {joint.child: joint for joint in joints}
    friction: dict[str, list[Element]] = {}
    for block in findings.document.root.iterfind("gazebo[@reference]"):
        link = block.get("reference", "")
        if link in above and above[link].kind in ("continuous", "revolute"):
            friction.setdefault(link, []).extend(e for e in block.iter() if e.tag in _FRICTION)
    angles: dict[str, float] = {}
    elements: set[Element] = set()
    for link, parts in friction.items():
        direction = next((part for part in parts if part.tag == _DIRECTION), None)
        if direction is None or (vector := _vector(findings, direction)) is None:
            continue
        angle = _angle(vector, _frame(findings, direction, links), joints)
        turn = angle - _angle(above[link].axis, link, joints)
        numbers = [_number(parts, tags) for tags in (_FIRST, _SECOND)]
        first, second = (1.0 if number is None else number for number in numbers)
        oblique = abs(math.cos(turn)) > _OBLIQUE
        slides = second < first and second <= (first if oblique else _SLIDES * first)
        slides = slides or (oblique and numbers == [None, None])
        if slides and abs(math.sin(turn)) > _OBLIQUE:  # otherwise they turn like the wheel
            angles[link] = angle
            elements.update(parts)
    return Rollers(angles, frozenset(elements))


def _vector(findings: Findings, element: Element) -> Triple | None:
    """Return the direction in an element; None if it is faulty, empty or zero."""
    text = value_text(element)
    words = text.split() or ["0"] * 3
    if len(words) != 3 or any(map(number_fault, words)):
        findings.problem(element, f'"{shortened(text)}" is not a direction; write x y z')
        return None
    x, y, z = map(float, words)
    return (x, y, z) if any((x, y, z)) else None


def _frame(findings: Findings, direction: Element, links: Collection[str]) -> str:
    """Return the link in whose frame a direction is; "" for the base."""
    frames = (text for key, text in direction.items() if key.endswith("expressed_in"))
    name = next(frames, "")  # the attribute's prefix is gz, ignition, or missing
    if not name or name in links:
        return name
    hint = findings.hint(name, links, "links")
    text = f'expressed_in="{name}" is no link{hint}, so the direction is in the base\'s frame'
    findings.warning(direction, text)
    return ""


def _angle(vector: Triple, link: str, joints: Iterable[Joint]) -> float:
    """Return a line's angle to the base's x axis seen from above, rad, in (-pi/2, pi/2].

    It is not a number for a vertical line.

    Args:
        vector: a direction of the line, in the frame of ``link`` with all joints at 0.
        link: the frame.
        joints: the joints.
    """
    _, pose = placed(link, Origin(), joints)
    x, y, _ = rotate(pose.rotation, vector)
    if math.hypot(x, y) < _OBLIQUE * math.hypot(*vector):
        return math.nan
    angle = math.remainder(math.atan2(y, x), math.pi)
    return angle if angle > _ROUNDING - math.pi / 2 else angle + math.pi


def _number(parts: Iterable[Element], tags: Collection[str]) -> float | None:
    """Return the first number in elements with one of these tags; None if there is none."""
    texts = (value_text(part) for part in parts if part.tag in tags)
    return next((float(text) for text in texts if not number_fault(text)), None)
