"""The summary tree."""

from pathlib import Path

from onebot_description.description import describe, load_description, parse_description

ROBOTS = Path(__file__).parents[1] / "robots"


def test_tree_shows_every_joint() -> None:
    """Each link stands on a line of its own with its joint, kind, axis and limits."""
    lines = describe(load_description(ROBOTS / "good_all_kinds.urdf")).splitlines()
    assert lines[0].startswith("good_all_kinds  (") and lines[0].endswith("good_all_kinds.urdf)")
    assert lines[1] == "7 links · 6 joints (5 movable)"
    rows = {line.split()[1]: line for line in lines[5:]}
    assert rows["on_revolute"].startswith("├─ on_revolute")
    assert "z     -85.94° … 85.94°  2 rad/s, 10 Nm" in rows["on_revolute"]
    assert "-x    0 m … 0.4 m       0.2 m/s, 100 N" in rows["on_prismatic"]
    assert "endless" in rows["on_continuous"]
    assert rows["on_planar"].startswith("└─ on_planar")


def test_tree_nests_and_shows_mimics() -> None:
    """Links below links are indented; a follower says what it follows."""
    text = describe(load_description(ROBOTS / "good_mimic_chain.urdf"))
    assert "└─ one" in text and "   └─ two" in text and "      └─ three" in text
    assert "= 2 × a + 5.73°" in text and "= -0.5 × b" in text
    assert "3 joints (3 movable, 2 following)" in text


def test_masses_shapes_and_warnings() -> None:
    """Mass, shapes and the number of meshes are shown, then the warnings."""
    assert "6 meshes" in describe(load_description(ROBOTS / "good_meshes.urdf"))
    text = describe(load_description(ROBOTS / "warn_inertia_triangle.urdf"))
    assert "1 link · 0 joints (0 movable) · 1 kg" in text
    assert "\n1 warning:\n  ! " in text and "exceeds the sum" in text
    text = describe(load_description(ROBOTS / "warn_size_zero.urdf"))
    assert "box 1×1×0 (no collision)" in text


def test_long_chain_is_no_trouble() -> None:
    """A chain of a thousand links is drawn without recursion."""
    links = "".join(f'<link name="l{i}"/>' for i in range(1000))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(999)
    )
    text = describe(parse_description(f'<robot name="chain">{links}{joints}</robot>', "text"))
    assert text.startswith("chain  (text)") and "└─ l999" in text
