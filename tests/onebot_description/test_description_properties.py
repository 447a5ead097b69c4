"""Properties over random robots and random damage."""

import io
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from onebot_description.description import (
    DescriptionError,
    describe,
    load_description,
    parse_description,
)

ROBOTS = Path(__file__).parents[1] / "robots"
SEEDS = [(ROBOTS / f"good_{name}").read_bytes() for name in ("mimic_chain.urdf", "arguments.xacro")]
PIECES = st.sampled_from(
    [
        b"<",
        b">",
        b'"',
        b"/>",
        b"${",
        b"}",
        b"$(",
        b"&a;",
        b"nan",
        b"-",
        b"1e999",
        b"\xff",
        b"\0",
        b"",
    ]
    + [b"<link/>", b"<!DOCTYPE a>", b"<xacro:wheel/>", b"<!--", b"joint", b"base", b"xacro:", b"0"]
)
EDITS = st.lists(
    st.tuples(st.integers(0, 2000), st.integers(0, 30), PIECES), min_size=1, max_size=4
)
NAMES = st.text("abcdefgh_0123", min_size=1, max_size=6)
NUMBER = st.floats(-1e3, 1e3, allow_nan=False)
TRIPLE = st.tuples(NUMBER, NUMBER, NUMBER)
KINDS = st.sampled_from(["fixed", "revolute", "continuous", "prismatic", "floating", "planar"])


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(SEEDS), EDITS)
def test_damage_is_always_explained(seed: bytes, edits: list[tuple[int, int, bytes]]) -> None:
    for start, length, piece in edits:
        seed = seed[:start] + piece + seed[start + length :]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xacro"
        path.write_bytes(seed)
        try:
            describe(load_description(path))
        except DescriptionError as error:
            assert error.problems and all("\n" not in problem for problem in error.problems)
    try:
        describe(parse_description(seed.decode("latin-1")))
    except DescriptionError as error:
        assert error.problems


@settings(max_examples=100, deadline=None)
@given(st.text() | st.binary().map(lambda data: data.decode("utf-8", "surrogateescape")))
def test_any_text_is_explained(text: str) -> None:
    with pytest.raises(DescriptionError):
        parse_description(text)


@st.composite
def robots(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Random trees: for each joint its name, kind, parent, child, origin, axis and limits."""
    links = draw(st.lists(NAMES, min_size=1, max_size=8, unique=True))
    joints = []
    for index, child in enumerate(links[1:], start=1):
        low, high = sorted((draw(NUMBER), draw(NUMBER)))
        joints.append(
            {
                "name": f"to_{child}",
                "kind": draw(KINDS),
                "parent": links[draw(st.integers(0, index - 1))],
                "child": child,
                "xyz": draw(TRIPLE),
                "rpy": draw(TRIPLE),
                "axis": draw(TRIPLE.filter(any)),
                "lower": low,
                "upper": high,
            }
        )
    return [{"root": links[0], "links": links}, *draw(st.permutations(joints))]


def write(robot: list[dict[str, Any]]) -> str:
    """Return the URDF of a random robot."""
    rows = [f'<link name="{name}"/>' for name in robot[0]["links"]]
    for joint in robot[1:]:
        texts = {key: " ".join(map(repr, joint[key])) for key in ("xyz", "rpy", "axis")}
        rows.append(
            f'<joint name="{joint["name"]}" type="{joint["kind"]}">'
            f'<parent link="{joint["parent"]}"/><child link="{joint["child"]}"/>'
            f'<origin xyz="{texts["xyz"]}" rpy="{texts["rpy"]}"/><axis xyz="{texts["axis"]}"/>'
            f'<limit lower="{joint["lower"]!r}" upper="{joint["upper"]!r}" '
            'effort="1" velocity="2"/></joint>'
        )
    return f'<robot name="random">{"".join(rows)}</robot>'


@settings(max_examples=100, deadline=None)
@given(robots())
def test_random_tree_is_read_as_written(robot: list[dict[str, Any]]) -> None:
    description = parse_description(write(robot))
    assert description.root_link == robot[0]["root"]
    assert list(description.link_names) == robot[0]["links"]
    assert [joint.name for joint in description.joints] == [joint["name"] for joint in robot[1:]]
    stream = io.BytesIO(description.urdf.encode())
    theirs = yourdfpy.URDF.load(stream, build_scene_graph=False, load_meshes=False).robot
    for written, joint, their in zip(robot[1:], description.joints, theirs.joints, strict=True):
        assert (joint.kind, joint.parent, joint.child, joint.origin.xyz, joint.origin.rpy) == tuple(
            written[key] for key in ("kind", "parent", "child", "xyz", "rpy")
        )
        assert (their.name, their.type, their.parent) == (joint.name, joint.kind, joint.parent)
        assert tuple(their.origin[:3, 3]) == joint.origin.xyz
        if joint.kind in ("revolute", "prismatic"):
            assert (joint.lower, joint.upper) == (written["lower"], written["upper"])
            assert (their.limit.lower, their.limit.upper) == (joint.lower, joint.upper)
        if joint.kind not in ("fixed", "floating"):
            largest = max(map(abs, written["axis"]))
            scaled = [value / largest for value in written["axis"]]
            norm = math.hypot(*scaled)
            assert joint.axis == pytest.approx([value / norm for value in scaled], abs=1e-9)
            assert math.hypot(*joint.axis) == pytest.approx(1, abs=1e-12)
            assert tuple(their.axis) == pytest.approx(joint.axis, abs=1e-6)
