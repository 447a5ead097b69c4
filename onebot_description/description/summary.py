"""Formats a robot description as a tree for the terminal."""

import math
from collections.abc import Mapping
from pathlib import PurePath
from types import MappingProxyType

from onebot_description.description.sensors.kind_table import MESSAGE_TYPES
from onebot_description.description.tree_text import aligned, branches, cell
from onebot_description.elements.sensor import Sensor
from onebot_description.elements.urdf import (
    Box,
    Capsule,
    Description,
    Joint,
    Link,
    Mesh,
    Shape,
    Sphere,
)
from onebot_description.elements.xml import shown_path
from onebot_description.errors import printable
from onebot_description.geometry.poses import Triple

_HEADINGS = ("link", "joint", "kind", "axis", "range", "at most", "mass", "shape")
_SENSOR_HEADINGS = ("sensor", "measures", "rate", "topic", "type", "frame")
_Row = tuple[str, ...]


def describe(description: Description, sizes: Mapping[Shape, Triple] = MappingProxyType({})) -> str:
    """Return a table of the links as a tree, with the joint above each, and a table of sensors.

    Angles are in degrees, everything else in SI units.

    Args:
        description: the robot.
        sizes: side lengths of its meshes, m; see ``sizes.shape_sizes``.
    """
    description = description.independent()
    links = {link.name: link for link in description.links}
    rows: list[_Row] = [_HEADINGS]
    for branch, name, joint in _walk(description):
        link = links[name]
        cells = (name, *_joint_cells(joint), _mass(link), _shapes(link, sizes))
        first, *columns = map(cell, cells)
        rows.append((branch + first, *columns))
    lines = [_title(description), "", *aligned(rows)]
    if description.sensors:
        written = [row for sensor in description.sensors for row in _sensor_rows(sensor)]
        lines += ["", *aligned([_SENSOR_HEADINGS, *(tuple(map(cell, row)) for row in written)])]
    return "\n".join(lines)


def _title(description: Description) -> str:
    links = description.links
    joints = description.joints
    movable = [joint for joint in joints if joint.kind != "fixed"]
    driven = sum(joint.mimic is not None for joint in movable)
    follow = f", {driven} following" if driven else ""
    shapes = [part.shape for link in links for part in (*link.visuals, *link.collisions)]
    meshes = {shape.uri for shape in shapes if isinstance(shape, Mesh)}
    mass = math.fsum(link.inertial.mass for link in links if link.inertial is not None)
    facts = [
        _count(len(links), "link"),
        f"{_count(len(joints), 'joint')} ({len(movable)} movable{follow})",
        *([f"{mass:.4g} kg"] if mass else []),
        *([_count(len(meshes), "mesh", "meshes")] if meshes else []),
    ]
    source = description.source
    where = printable(shown_path(source) if description.files else source)
    return f"{cell(description.robot_name)}  ({where})\n{' · '.join(facts)}"


def _walk(description: Description) -> list[tuple[str, str, Joint | None]]:
    """Return each link with the box drawing before it and the joint above it, depth first."""
    below: dict[str, list[Joint]] = {}
    above: dict[str, Joint] = {}
    for joint in description.joints:
        below.setdefault(joint.parent, []).append(joint)
        above[joint.child] = joint
    drawn = branches(description.roots, lambda link: [joint.child for joint in below.get(link, [])])
    return [(branch, link, above.get(link)) for branch, link in drawn]


def _joint_cells(joint: Joint | None) -> _Row:
    """Return name, kind, axis, range, and maximum speed and effort of a joint."""
    if joint is None:
        return ("", "", "", "", "")
    has_axis = joint.kind not in ("fixed", "floating")
    return (
        joint.name,
        joint.kind,
        _axis(joint.axis) if has_axis else "",
        _range(joint),
        _most(joint),
    )


def _axis(axis: Triple) -> str:
    """Return ``z`` or ``-z`` for an axis of the frame, otherwise three numbers."""
    for index, letter in enumerate("xyz"):
        if abs(abs(axis[index]) - 1) < 1e-9:
            return letter if axis[index] > 0 else f"-{letter}"
    return " ".join(f"{value:.3g}" for value in axis)


def _position(value: float, kind: str) -> str:
    return f"{value:.4g} m" if kind == "prismatic" else f"{math.degrees(value):.4g}°"


def _range(joint: Joint) -> str:
    text = ""
    if joint.lower is not None and joint.upper is not None:
        text = f"{_position(joint.lower, joint.kind)} … {_position(joint.upper, joint.kind)}"
    elif joint.kind == "continuous":
        text = "endless"
    if joint.mimic is None:
        return text
    factor = "" if joint.mimic.multiplier == 1 else f"{joint.mimic.multiplier:.4g} × "
    offset = joint.mimic.offset
    shift = f" {'+' if offset > 0 else '-'} {_position(abs(offset), joint.kind)}" if offset else ""
    return f"{text} = {factor}{joint.mimic.joint}{shift}".strip()


def _most(joint: Joint) -> str:
    linear = joint.kind == "prismatic"
    parts = []
    if joint.velocity is not None:
        parts.append(f"{joint.velocity:.4g} {'m/s' if linear else 'rad/s'}")
    if joint.effort is not None:
        parts.append(f"{joint.effort:.4g} {'N' if linear else 'Nm'}")
    if joint.acceleration is not None:
        parts.append(f"{joint.acceleration:.4g} {'m/s²' if linear else 'rad/s²'}")
    return ", ".join(parts)


def _mass(link: Link) -> str:
    return "" if link.inertial is None else f"{link.inertial.mass:.4g} kg"


def _shapes(link: Link, sizes: Mapping[Shape, Triple]) -> str:
    """Return the visible shapes of a link or, if there are none, its collision shapes."""
    shapes = ", ".join(_shape(part.shape, sizes) for part in link.visuals or link.collisions)
    if link.visuals:
        return shapes + ("" if link.collisions else " (no collision)")
    return shapes + (" (collision only)" if link.collisions else "")


def _shape(shape: Shape, sizes: Mapping[Shape, Triple]) -> str:
    if isinstance(shape, Mesh):
        size = "×".join(f"{side:.4g}" for side in sizes.get(shape, ()))
        return f"{PurePath(shape.uri).name} {size}".rstrip()
    if isinstance(shape, Box):
        return "box " + "×".join(f"{side:.4g}" for side in shape.size)
    if isinstance(shape, Sphere):
        return f"sphere r {shape.radius:.4g}"
    kind = "capsule" if isinstance(shape, Capsule) else "cylinder"
    return f"{kind} r {shape.radius:.4g} l {shape.length:.4g}"


def _sensor_rows(sensor: Sensor) -> list[_Row]:
    """Return a row for each topic; values that all share are in the first one."""
    rate = f"{sensor.rate:.4g} Hz" if sensor.rate else "each cycle"
    first, *other_rows = ((topic, MESSAGE_TYPES[output]) for output, topic in sensor.topics.items())
    return [
        (sensor.name, sensor.model.summary, rate, *first, sensor.frame),
        *(("", "", "", *row, "") for row in other_rows),
    ]


def _count(number: int, one: str, many: str | None = None) -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
