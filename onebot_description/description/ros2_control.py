"""Reads ``<ros2_control>``: the command interfaces of joints, and their start positions."""

from collections.abc import Collection

from onebot_description.elements.reading import Element, Findings, number_fault
from onebot_description.elements.urdf import JointInterfaces


def read_interfaces(findings: Findings, joints: Collection[str]) -> dict[str, JointInterfaces]:
    """Return the interfaces by joint; if a joint is listed twice, the first one counts."""
    interfaces: dict[str, JointInterfaces] = {}
    for block in findings.document.root.iter("ros2_control"):
        for element in block.iter("joint"):
            name = element.get("name", "")
            if name not in joints:
                hint = findings.hint(name, joints, "joints")
                findings.warning(element, f'the robot has no joint "{name}"{hint}')
            elif name not in interfaces:
                commands = (part.get("name", "") for part in element.iter("command_interface"))
                interfaces[name] = JointInterfaces(tuple(commands), _start(findings, element))
    return interfaces


def _start(findings: Findings, joint: Element) -> float | None:
    """Return the initial value of a joint's position; None if there is none."""
    for state in joint.iter("state_interface"):
        for value in state.iter("param"):
            if (state.get("name"), value.get("name")) != ("position", "initial_value"):
                continue
            text = (value.text or "").strip()
            if fault := number_fault(text):
                findings.problem(value, f"initial_value: {fault}")
                return None
            return float(text)
    return None
