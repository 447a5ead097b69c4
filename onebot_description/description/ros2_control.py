"""``<ros2_control>``: by which interfaces a joint is commanded, and where it is at the start."""

from collections.abc import Collection

from onebot_description.description.description import JointInterfaces
from onebot_description.description.reading import Element, Findings, number_fault


def read_interfaces(findings: Findings, joints: Collection[str]) -> dict[str, JointInterfaces]:
    """Return the interfaces of the joints that have any; of two blocks the first counts."""
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
    """The initial value of a joint's position; None if it gives none."""
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
