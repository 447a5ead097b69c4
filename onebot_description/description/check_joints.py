"""Joints: kind, axis, limits and what they mimic."""

import math
from collections.abc import Mapping

from onebot_description.description.report import Element, Report
from onebot_description.description.spec import JOINT_KINDS, JointSpec, MimicSpec, Triple
from onebot_description.description.values import ZERO, read_number, read_triple
from onebot_description.text import did_you_mean

_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
_WITH_LIMIT = ("revolute", "prismatic")
_WITH_POSITION = ("revolute", "continuous", "prismatic")
_DEFAULT_AXIS: Triple = (1.0, 0.0, 0.0)
# Further than this from 1, an axis was not merely rounded when written.
_ROUNDING = 1e-3


def read_joint(
    report: Report, name: str, element: Element, ends: tuple[str, str] | None
) -> JointSpec:
    """Read one joint; what is wrong is reported and replaced by a default."""
    kind = _read_kind(report, element)
    origin = element.find("origin")
    lower, upper, velocity, effort = _read_limit(report, element, kind)
    parent, child = ends or ("", "")
    return JointSpec(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        xyz=read_triple(report, origin, "xyz") or ZERO,
        rpy=read_triple(report, origin, "rpy") or ZERO,
        axis=_read_axis(report, element, kind),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort,
        mimic=_read_mimic(report, element),
    )


def _read_kind(report: Report, element: Element) -> str:
    kind = element.get("type")
    if kind is None:
        report.problem(element, f"has no type; write one of: {', '.join(JOINT_KINDS)}")
    elif kind not in JOINT_KINDS:
        hint = did_you_mean(kind, JOINT_KINDS)
        report.problem(element, f'unknown joint type "{kind}"{hint}')
    return kind if kind in JOINT_KINDS else ""


def _read_axis(report: Report, element: Element, kind: str) -> Triple:
    axis = element.find("axis")
    if axis is None:
        return _DEFAULT_AXIS
    if axis.get("xyz") is None:
        report.problem(axis, 'has no xyz; write for example <axis xyz="0 0 1"/>')
    xyz = read_triple(report, axis, "xyz")
    if xyz is None or kind not in _WITH_AXIS:
        return _DEFAULT_AXIS
    largest = max(abs(value) for value in xyz)
    if largest == 0:
        report.problem(
            axis, f'the axis of a {kind} joint cannot be zero; write for example "0 0 1"'
        )
        return _DEFAULT_AXIS
    # Scaled first, so that neither huge nor tiny numbers leave the range of a float.
    scaled = [value / largest for value in xyz]
    norm = math.hypot(*scaled)
    if abs(norm * largest - 1) > _ROUNDING:
        report.warning(axis, f"the axis has length {norm * largest:.4g}; it is taken as length 1")
    unit: Triple = (scaled[0] / norm, scaled[1] / norm, scaled[2] / norm)
    if abs(norm * largest - 1) > 1e-6:
        # Rerun turns by wrong angles about axes of another length.
        axis.set("xyz", " ".join(repr(value) for value in unit))
        return unit
    return xyz if abs(norm * largest - 1) < 1e-15 else unit


def _read_limit(
    report: Report, element: Element, kind: str
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return lower, upper, velocity and effort."""
    limit = element.find("limit")
    bounded = kind in _WITH_LIMIT
    if limit is None:
        if bounded:
            report.problem(
                element,
                f"a {kind} joint needs a limit; write "
                '<limit lower="..." upper="..." effort="..." velocity="..."/>',
            )
        return (0.0, 0.0, None, None) if bounded else (None, None, None, None)
    lower = read_number(report, limit, "lower")
    upper = read_number(report, limit, "upper")
    needed = kind in _WITH_POSITION
    effort = read_number(report, limit, "effort", required=needed, negative=False)
    velocity = read_number(report, limit, "velocity", required=needed, negative=False)
    if not bounded:
        if kind == "continuous" and (lower or upper):
            report.warning(limit, "a continuous joint has no lower or upper; make it revolute")
        return None, None, velocity, effort
    low, high = lower or 0.0, upper or 0.0  # as the specification has it
    if low > high:
        report.problem(limit, f"lower {low:g} is above upper {high:g}; swap them")
    elif low == high == 0:
        report.warning(limit, "lower and upper are both 0, so the joint cannot move")
    if velocity == 0:
        report.warning(limit, "velocity is 0, so the joint cannot move")
    return low, high, velocity, effort


def _read_mimic(report: Report, element: Element) -> MimicSpec | None:
    mimic = element.find("mimic")
    if mimic is None:
        return None
    joint = mimic.get("joint")
    if not joint:
        report.problem(mimic, 'names no joint; write <mimic joint="..."/>')
        return None
    multiplier = read_number(report, mimic, "multiplier")
    offset = read_number(report, mimic, "offset")
    return MimicSpec(joint, 1.0 if multiplier is None else multiplier, offset or 0.0)


def check_mimics(
    report: Report, joints: Mapping[str, JointSpec], elements: Mapping[str, Element]
) -> None:
    """Report joints that follow nothing, themselves, a circle, or one that has no position."""
    masters = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic}
    seen: set[str] = set()
    for name, master in masters.items():
        element = elements[name].find("mimic")
        assert element is not None  # a MimicSpec was read from it
        moving = [other for other, joint in joints.items() if joint.kind in _WITH_POSITION]
        kind = joints[name].kind
        if kind and kind not in _WITH_POSITION:
            report.problem(element, f"a {kind} joint has no single position, so it cannot mimic")
        elif master == name:
            report.problem(element, "the joint mimics itself; name another joint")
        elif master not in joints:
            hint = did_you_mean(master, [other for other in moving if other != name], "joints")
            report.problem(element, f'there is no joint "{master}" to mimic{hint}')
        elif joints[master].kind and joints[master].kind not in _WITH_POSITION:
            text = f'joint "{master}" is {joints[master].kind} and has no position to mimic'
            report.problem(element, text)
        elif name not in seen and (circle := _circle(name, masters)):
            seen.update(circle)
            names = " -> ".join([*circle, name])
            report.problem(element, f"the joints {names} mimic each other in a circle")


def _circle(start: str, masters: Mapping[str, str]) -> list[str]:
    """The joints passed from ``start`` until back there; empty if the way leads elsewhere."""
    path = [start]
    visited = {start}
    while (master := masters.get(path[-1])) is not None:
        if master == start:
            return path
        if master in visited:
            return []
        path.append(master)
        visited.add(master)
    return []
