"""The summary tree."""

from pathlib import Path

import pytest

from onebot_description.description import describe, parse_description
from tests.random_robots import chain

ROBOTS = Path(__file__).parents[1] / "robots"


def test_long_names_are_cut_and_what_a_terminal_would_obey_is_escaped() -> None:
    name = f"{'x' * 100_000}\u202e"
    ends = f'<parent link="a"/><child link="{name}"/>'
    joint = f'<joint name="last\x85" type="fixed">{ends}</joint>'
    urdf = f'<robot name="\u202er"><link name="a"/><link name="{name}"/>{joint}</robot>'
    text = describe(parse_description(urdf))
    assert len(text) < 1000
    assert text.startswith("\\u202er  (") and "last\\x85" in text
    deep = describe(parse_description(chain(100)))
    assert "…  " in deep and "└─ link_100" in deep


def _hinge(kind: str, inside: str = "") -> str:
    """The second row of the table of a robot of two links."""
    urdf = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="k" type="continuous">'
        '<parent link="a"/><child link="c"/></joint><link name="c"/>'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{inside}</joint></robot>'
    )
    (row,) = [line for line in describe(parse_description(urdf)).splitlines() if " b " in line]
    return " ".join(row.split())


_TURN = '<limit lower="-1" upper="0.5" effort="2" velocity="3"/>'
_SLIDE = '<limit lower="-0.25" upper="0.5" effort="2" velocity="3"/>'


@pytest.mark.parametrize(
    ("kind", "inside", "row"),
    [
        ("revolute", _TURN, "j revolute x -57.3° … 28.65° 3 rad/s, 2 Nm"),
        ("prismatic", _SLIDE, "j prismatic x -0.25 m … 0.5 m 3 m/s, 2 N"),
        ("continuous", '<axis xyz="0 -1 0"/>', "j continuous -y endless"),
        ("continuous", '<limit effort="0" velocity="0"/>', "j continuous x endless 0 rad/s, 0 Nm"),
        ("continuous", '<axis xyz="0 3 -4"/>', "j continuous 0 0.6 -0.8 endless"),
        ("fixed", '<axis xyz="0 1 0"/>', "j fixed"),
        ("planar", '<axis xyz="0 0 1"/>', "j planar z"),
        ("continuous", '<mimic joint="k" multiplier="-1"/>', "j continuous x endless = -1 × k"),
        ("continuous", '<mimic joint="k" offset="-0.5"/>', "j continuous x endless = k - 28.65°"),
        (
            "prismatic",
            f'{_SLIDE}<mimic joint="k" multiplier="0" offset="0.5"/>',
            "j prismatic x -0.25 m … 0.5 m = 0 × k + 0.5 m 3 m/s, 2 N",
        ),
    ],
)
def test_a_joint_is_one_row(kind: str, inside: str, row: str) -> None:
    assert _hinge(kind, inside) == f"└─ b {row}"


def test_branches_are_drawn_to_the_last() -> None:
    pairs = [("a", "b"), ("b", "c"), ("b", "d"), ("a", "e"), ("e", "f")]
    links = "".join(f'<link name="{name}"/>' for name in "abcdef")
    joints = "".join(
        f'<joint name="j{parent}{child}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{child}"/></joint>'
        for parent, child in pairs
    )
    lines = describe(parse_description(f'<robot name="r">{links}{joints}</robot>')).splitlines()
    assert lines[:4] == ["r  (<string>)", "6 links · 5 joints (0 movable)", "", lines[3]]
    assert lines[3].split() == ["link", "joint", "kind"]
    drawn = [line[:7].rstrip() for line in lines[4:]]
    assert drawn == ["a", "├─ b", "│  ├─ c", "│  └─ d", "└─ e", "   └─ f"]


def test_the_title_adds_up() -> None:
    mesh = ROBOTS / "meshes" / "cube.stl"
    shape = f'<geometry><mesh filename="{mesh}"/></geometry>'
    moments = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    inside = f'<inertial><mass value="1.25"/><inertia {moments}/></inertial>'
    parts = f"{inside}<visual>{shape}</visual><collision>{shape}</collision>"
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    links = f'<link name="a">{parts}</link><link name="b">{parts}</link>'
    text = describe(parse_description(f'<robot name="r">{links}{joint}</robot>'))
    assert text.splitlines()[1] == "2 links · 1 joint (0 movable) · 2.5 kg · 1 mesh"
    assert text.count("1.25 kg") == 2 and text.count("cube.stl") == 2
    assert "no collision" not in text and "collision only" not in text
    bare = describe(parse_description('<robot name="r"><link name="a"/></robot>'))
    assert bare == "r  (<string>)\n1 link · 0 joints (0 movable)\n\nlink\na"


@pytest.mark.parametrize(
    ("seen", "collide", "cell"),
    [
        ('<sphere radius="0.25"/>', "", "sphere r 0.25 (no collision)"),
        ("", '<cylinder radius="0.5" length="2"/>', "cylinder r 0.5 l 2 (collision only)"),
        ('<box size="1 2.5 3"/>', '<sphere radius="1"/>', "box 1×2.5×3"),
        ("", "", ""),
    ],
)
def test_shapes_seen_are_shown_before_those_that_collide(
    seen: str, collide: str, cell: str
) -> None:
    parts = "".join(
        f"<{tag}><geometry>{shape}</geometry></{tag}>"
        for tag, shape in (("visual", seen), ("collision", collide))
        if shape
    )
    text = describe(parse_description(f'<robot name="r"><link name="a">{parts}</link></robot>'))
    assert text.splitlines()[4].removeprefix("a").strip() == cell
