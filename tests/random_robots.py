"""Random robots for property tests, as URDF text."""

import math
from xml.etree import ElementTree

from hypothesis import strategies as st

numbers = st.floats(-2.0, 2.0).map(lambda x: round(x, 6))
triples = st.tuples(numbers, numbers, numbers)
angles = st.floats(-math.pi, math.pi).map(lambda x: round(x, 6))
axes = triples.filter(lambda a: math.hypot(*a) > 0.1)
KINDS = ("fixed", "revolute", "continuous", "prismatic")


@st.composite
def robots(draw: st.DrawFn, max_joints: int = 8, kinds: tuple[str, ...] = KINDS) -> str:
    """A tree of random joints, some of which mimic an earlier or later one."""
    count = draw(st.integers(1, max_joints))
    robot = ElementTree.Element("robot", name="random")
    for number in range(count + 1):
        ElementTree.SubElement(robot, "link", name=f"link_{number}")
    drawn = [draw(st.sampled_from(kinds)) for _ in range(count)]
    moving = [number for number, kind in enumerate(drawn) if kind != "fixed"]
    # Mimics point along one random order, so that chains arise but no cycles.
    order = draw(st.permutations(moving))
    for number, kind in enumerate(drawn):
        joint = ElementTree.SubElement(robot, "joint", name=f"joint_{number}", type=kind)
        parent = draw(st.integers(0, number))
        ElementTree.SubElement(joint, "parent", link=f"link_{parent}")
        ElementTree.SubElement(joint, "child", link=f"link_{number + 1}")
        rpy = draw(st.tuples(angles, angles, angles))
        ElementTree.SubElement(joint, "origin", xyz=_text(draw(triples)), rpy=_text(rpy))
        if kind == "fixed":
            continue
        ElementTree.SubElement(joint, "axis", xyz=_text(draw(axes)))
        ElementTree.SubElement(joint, "limit", lower="-9", upper="9", effort="1", velocity="1")
        before = order[: order.index(number)]
        if before and draw(st.booleans()):
            multiplier, offset = draw(numbers), draw(numbers)
            ElementTree.SubElement(
                joint,
                "mimic",
                joint=f"joint_{draw(st.sampled_from(before))}",
                multiplier=repr(multiplier),
                offset=repr(offset),
            )
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def chain(joints: int) -> str:
    """A serial chain of revolute joints, joint_0 to joint_N-1."""
    links = "".join(f'<link name="link_{number}"/>' for number in range(joints + 1))
    return (
        f'<robot name="chain">{links}'
        + "".join(
            f'<joint name="joint_{n}" type="revolute"><parent link="link_{n}"/>'
            f'<child link="link_{n + 1}"/><origin xyz="0.1 0 0.2" rpy="0.1 0.2 0.3"/>'
            '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            for n in range(joints)
        )
        + "</robot>"
    )


def _text(values: tuple[float, ...]) -> str:
    return " ".join(repr(value) for value in values)
