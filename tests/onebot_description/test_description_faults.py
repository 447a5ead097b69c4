"""Files that are no robot, and whole robots; test_description_checks.py has faults of elements."""

from pathlib import Path

import pytest

from onebot_description.description import (
    DescriptionError,
    describe,
    load_description,
    parse_description,
)

ROBOTS = Path(__file__).parents[1] / "robots"
SECRET = '<!DOCTYPE robot [<!ENTITY secret SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("", ":1:1: is not XML; URDF starts with <robot"),
        (b"\0\1\2", ":1:1: is not XML"),
        ('<robot>\n<link name="a">\n</robot>', ":3:3: malformed XML: mismatched tag: <link> of l"),
        (b'<robot name="r">\n<link name="\xdf"/></robot>', ":2: is not UTF-8 text (byte 0xdf)"),
        ('<?xml version="1.0" encoding="klingon"?><robot/>', "encoding cannot be read"),
        (f'{SECRET}\n<robot name="&secret;"/>', ":1: <!DOCTYPE> and entities are rejected"),
        (
            '<robot name="a">\n<xacro:a/></robot>',
            ":2:1: the prefix of a name is not declared; for xacro: write <robot xmlns:xacro=",
        ),
        ("<robot/>", ':1: <robot>: has no links; write at least <link name="base_link"/>'),
        ('<COLLADA xmlns="http://www.collada.org/2008/03/COLLADASchema"/>', "<COLLADA>: the outer"),
        ('<sdf version="1.6"/>', "<sdf>: the outermost element must be <ro"),
    ],
)
def test_a_document_that_is_no_robot(tmp_path: Path, document: str | bytes, words: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(document if isinstance(document, bytes) else document.encode())
    with pytest.raises(DescriptionError) as caught:
        load_description(path)
    assert caught.value.problems and words in str(caught.value)


def test_text_with_half_a_character_is_refused() -> None:
    with pytest.raises(DescriptionError, match="is not UTF-8 text"):
        parse_description("<robot name='\ud800'/>")


@pytest.mark.parametrize("name", sorted(p.name for p in ROBOTS.glob("good_*")))
def test_good_robot_loads_without_warning(name: str) -> None:
    description = load_description(ROBOTS / name)
    assert description.notices == () and describe(description)
    again = parse_description(description.urdf, str(ROBOTS / name))
    assert again.urdf == description.urdf
    assert (again.links, again.joints) == (description.links, description.joints)


def test_all_problems_come_at_once() -> None:
    with pytest.raises(DescriptionError) as caught:
        load_description(ROBOTS / "broken_everywhere.urdf").raise_problems()
    parts = ("<mass>", "<inertia>", '"big"', '"revolut"', '"bas"', 'xyz="0 1": holds 2')
    assert len(caught.value.problems) == len(parts)
    for part in parts:
        assert any(part in problem for problem in caught.value.problems), part


@pytest.mark.parametrize(
    ("source", "part"),
    [
        (ROBOTS, "is a folder"),
        (ROBOTS / "good_mimik_chain.urdf", 'mean "good_mimic_chain.urdf"?'),
        (ROBOTS / "nowhere" / "a.urdf", "nowhere/a.urdf: no such file"),
        ("", "is a folder"),
        ("a\0b.urdf", "no such file"),
        ("x" * 5000, "cannot be read"),
        ("package://onebot_descripton/urdf/a.urdf", 'no ROS package "onebot_descripton"'),
        ("package://onebot_description", "is a folder"),
    ],
)
def test_source_that_is_no_file(source: str | Path, part: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        load_description(source)
    assert part in str(caught.value)
