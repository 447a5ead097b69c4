"""Reads ``<ros2_control>``: the command interfaces of joints, their limits and start positions."""

import math
from collections.abc import Callable, Mapping

from onebot_description.elements.reading import Element, Findings, number_fault
from onebot_description.elements.urdf import Joint, JointInterfaces


def read_interfaces(findings: Findings, joints: Mapping[str, Joint]) -> dict[str, JointInterfaces]:
    """Return the interfaces by joint; if a joint is listed twice, the first one counts."""
    interfaces: dict[str, JointInterfaces] = {}
    for block in findings.document.root.iter("ros2_control"):
        for element in block.iter("joint"):
            name = element.get("name", "")
            if name not in joints:
                hint = findings.hint(name, joints, "joints")
                findings.warning(element, f'the robot has no joint "{name}"{hint}')
            elif name not in interfaces:
                interfaces[name] = _interfaces(findings, element, joints[name])
    return interfaces


def _interfaces(findings: Findings, element: Element, joint: Joint) -> JointInterfaces:
    earlier = len(findings.by_severity("problem"))
    commands = tuple(part.get("name", "") for part in element.iter("command_interface"))
    mimics = element.get("mimic", "").lower()
    if joint.mimic and mimics != "false" and commands:
        text = f'follows "{joint.mimic.joint}" by <mimic>, so it cannot have a command interface'
        # Before Jazzy, ROS required one, and this parameter.
        older = element.find("param[@name='mimic']") is not None
        report = findings.warning if older else findings.problem
        report(element, f'{text}; remove that, or write mimic="false" here')
    if mimics == "true" and joint.mimic is None:
        findings.problem(element, 'mimic="true", but the joint has no <mimic>')
    limits = {
        part.get("name", ""): _limits(findings, part)
        for part in element.iter("command_interface")
        if element.find("limits[@enable='false']") is None
        and part.find("limits[@enable='false']") is None
    }
    start = _start(findings, element, joint, *limits.get("position", (-math.inf, math.inf)))
    faults = findings.by_severity("problem")[earlier:]
    return JointInterfaces(commands, start, limits, mimics != "false", faults)


def _limits(findings: Findings, command: Element) -> tuple[float, float]:
    """Return the parameters min and max of a command interface; ROS ignores unusable ones."""
    minimum, maximum = (
        _number(command, name, default, findings.warning)
        for name, default in (("min", -math.inf), ("max", math.inf))
    )
    if minimum > maximum:
        findings.warning(command, f"min {minimum:g} is greater than max {maximum:g}: ignored")
        return -math.inf, math.inf
    return minimum, maximum


def _start(
    findings: Findings, element: Element, joint: Joint, minimum: float, maximum: float
) -> float | None:
    """Return the initial value of a joint's position; None if there is none.

    ``minimum`` and ``maximum`` are the limits of its command interface.
    """
    state = element.find("state_interface[@name='position']")
    for interface in element:
        if interface is not state and _number(interface, "initial_value", 0.0, findings.problem):
            text = "initial_value has no effect; only a position's state_interface has one"
            findings.warning(interface, text)
    if state is None:
        return None
    start = _number(state, "initial_value", math.nan, findings.problem)
    if math.isnan(start):
        return None
    if fault := joint.start_fault(start, minimum, maximum):
        findings.problem(element, f"initial_value {fault}")
        return None
    return start


def _number(
    interface: Element,
    name: str,
    default: float,
    report: Callable[[Element, str], None],
) -> float:
    """Return the number in a <param> of an interface, or else the default."""
    parameter = interface.find(f"param[@name='{name}']")
    if parameter is None:
        return default
    text = (parameter.text or "").strip()
    if fault := number_fault(text):
        report(parameter, f"{name}: {fault}")
        return default
    return float(text)
