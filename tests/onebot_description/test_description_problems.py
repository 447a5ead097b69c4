"""What ``onebot check`` refuses and nodes take: what is left, and what is published of it."""

import math
from pathlib import Path

import pytest

from onebot_control.physics.physics_urdf import rigid_bodies
from onebot_description.description import (
    Description,
    DescriptionError,
    load_description,
    parse_description,
)
from onebot_description.description.summary import describe
from onebot_description.description.unit_check import shape_sizes
from onebot_description.elements.urdf import Capsule
from onebot_description.errors import OneBotError
from onebot_description.model import RobotModel
from tests.onebot_description.joints_support import constant, rest_of

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def hinge(name: str, child: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    """A joint of the base, and its link."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="base"/><child link="{child}"/>'
        f'{inside}</joint><link name="{child}"/>'
    )


def robot(*parts: str, base: str = "") -> str:
    """A robot of a base and other parts."""
    return f'<robot name="r"><link name="base">{base}</link>{"".join(parts)}</robot>'


def taken(urdf: str, problem: str) -> Description:
    """What nodes take of a robot with one problem."""
    description = parse_description(urdf, "r")
    [found] = description.problems
    assert problem in found
    assert description.notices == (found, *description.warnings)
    with pytest.raises(DescriptionError) as caught:
        description.raise_problems()
    assert (caught.value.problems, caught.value.warnings) == ((found,), description.warnings)
    again = parse_description(description.urdf, "again")
    assert [link.name for link in again.links] == [link.name for link in description.links]
    return description


def frames(description: Description) -> dict[str, str]:
    """Child and parent frames of what robot_state_publisher publishes."""
    model = RobotModel.from_description(description)
    parents = model.moving.parents + model.fixed.parents
    return dict(zip(model.moving.children + model.fixed.children, parents, strict=True))


def at_rest(description: Description, **parameters: object) -> dict[str, float]:
    """Positions that joint_state_publisher's core publishes."""
    positions = rest_of(description.joints, parameters).tolist()
    return dict(zip([joint.name for joint in description.moving_joints], positions, strict=True))


_OTHER = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'


@pytest.mark.parametrize(
    ("limit", "problem", "limits", "rest"),
    [
        (_OTHER.format(3, 1), "lower 3 is above upper 1; swap them", (1.0, 3.0, 1.0, 1.0), 2.0),
        (LIMIT.replace('effort="1"', 'effort="-1"'), "is negative", (-1.0, 1.0, None, 1.0), 0.0),
        (LIMIT.replace('ity="1"', 'ity="-1"'), "is negative", (-1.0, 1.0, 1.0, None), 0.0),
        ("", "a revolute joint needs a limit", (None, None, None, None), 0.0),
        (_OTHER.format("low", 1), '"low" is not a finite number', (None, None, 1.0, 1.0), 0.0),
    ],
)
def test_wrong_limits_are_mended_or_left_out(
    limit: str, problem: str, limits: tuple[float | None, ...], rest: float
) -> None:
    """A joint without limits stays at 0, whatever its motion."""
    description = taken(robot(hinge("j", "a", limit)), problem)
    [found] = description.joints
    assert (found.lower, found.upper, found.effort, found.velocity) == limits
    assert at_rest(description) == {"j": rest}
    if limits[0] is None:
        assert at_rest(description, motions={"j": constant(0.5)}) == {"j": 0.0}
    assert frames(description) == {"a": "base"}


def test_negative_damping_counts_as_none() -> None:
    """It would drive the joint."""
    description = taken(robot(hinge("j", "a", f'{LIMIT}<dynamics damping="-1"/>')), "is negative")
    assert not description.joints[0].damping


FIXED = hinge("f", "b", "", "fixed")


@pytest.mark.parametrize(
    ("mimic", "other", "problem"),
    [
        ('<mimic joint="x"/>', "", 'no joint "x" to mimic'),
        ('<mimic joint="k" offset="x"/>', hinge("k", "b"), '"x" is not'),
        ('<mimic joint="f"/>', FIXED, "is fixed"),
        (
            '<mimic joint="k"/>',
            hinge("k", "b", f'{LIMIT}<mimic joint="j"/>'),
            "j -> k -> j mimic each other",
        ),
    ],
)
def test_a_joint_that_can_follow_nothing_moves_by_itself(
    mimic: str, other: str, problem: str
) -> None:
    description = taken(robot(hinge("j", "a", LIMIT + mimic), other), problem)
    assert all(joint.mimic is None for joint in description.joints)
    assert at_rest(description)["j"] == 0.0
    assert frames(description)["a"] == "base"


def test_loose_links_have_joint_states_but_no_transforms() -> None:
    """As with the standard nodes: joint_state_publisher wants joints only, TF wants one tree."""
    arm = '<link name="arm"/>' + hinge("j", "hand").replace('link="base"', 'link="arm"')
    description = taken(robot(hinge("k", "a"), arm), "the robot is in 2 separate parts")
    assert (description.root_link, at_rest(description)) == ("base", {"k": 0.0, "j": 0.0})
    with pytest.raises(OneBotError, match="robot is in 2 separate parts, with the roots arm, b"):
        RobotModel.from_description(description)


def test_a_robot_may_lie_in_another_element() -> None:
    description = taken(
        f"<urdf>\n{robot(hinge('j', 'a'))}</urdf>", 'r:2: robot "r": is inside <urdf>'
    )
    assert (description.robot_name, at_rest(description)) == ("r", {"j": 0.0})
    assert parse_description(description.urdf).problems == ()
    nested = parse_description(f"<urdf>{robot(hinge('j', 'a', ''))}</urdf>", "r")
    assert 'r:1: joint "j": a revolute joint needs' in nested.problems[1]


def test_blank_lines_before_the_declaration_are_skipped(tmp_path: Path) -> None:
    """As urdfdom does, from a file as from text; the lines of what follows are the same."""
    text = f'\n \n<?xml version="1.0"?>\n{robot(hinge("j", "a", ""))}'
    file = tmp_path / "r.urdf"
    file.write_text(text)
    for description in (parse_description(text, "r"), load_description(file)):
        assert description.link_names == ("base", "a")
        assert ':4: joint "j": a revolute joint needs' in description.problems[0]
        assert ":1: blank lines before <?xml ...?>" in description.warnings[0]
    with pytest.raises(DescriptionError, match="r:2:1: malformed XML"):
        parse_description("\n<?xml <robot/>", "r")


def test_dashes_inside_comments_are_skipped(tmp_path: Path) -> None:
    """As urdfdom does; the lines of what follows are the same, and CDATA is no comment."""
    text = robot(f"<!-- ---- left wheel\n<link/> ---- -->\n{hinge('j', 'a', '')}<!--- --->")
    text = text.replace("</robot>", "<x><![CDATA[<!-- a--b -->]]></x></robot>")
    file = tmp_path / "r.urdf"
    file.write_text(text)
    for description in (parse_description(text, "r"), load_description(file)):
        assert description.link_names == ("base", "a")
        assert ':3: joint "j": a revolute joint needs' in description.problems[0]
        assert ':1: "--" inside a comment, which some programs reject' in description.warnings[0]
        assert "<x>&lt;!-- a--b --&gt;</x>" in description.urdf
    again = parse_description(robot("<!-- a - b --><!---->", hinge("j", "a")), "r")
    assert again.warnings == ()
    many = "<!-- --" * 200_000  # in time, though no comment ends
    with pytest.raises(DescriptionError, match="malformed XML"):
        parse_description(f"<robot>{many}", "r")


def test_the_simulation_names_what_it_cannot_do() -> None:
    urdf, text = robot("\n" + hinge("j", "a", "")), "r.urdf:2: joint .j. has no limits"
    with pytest.raises(OneBotError, match=text):
        rigid_bodies(parse_description(urdf, "r.urdf"))
    urdf = robot(hinge("j", "a"), '<link name="loose"/>')
    with pytest.raises(OneBotError, match="r.urdf: the robot is in 2 separate parts"):
        rigid_bodies(parse_description(urdf, "r.urdf"))


# ---- Versions of URDF ----------------------------------------------------------------------------


def versioned(version: str, origin: str = "", limit: str = LIMIT) -> Description:
    joint = hinge("j", "a", f'<axis xyz="0 0 1"/>{limit}{origin}')
    return parse_description(robot(joint).replace("<robot", f'<robot version="{version}"'), "r")


@pytest.mark.parametrize(
    ("version", "quaternion", "yaw", "words"),
    [
        ("1.1", "0 0 0.70710678 0.70710678", math.pi / 2.0, ()),
        ("1.2", "0 0 -1 -1", math.pi / 2.0, ("has length 1.414; it is taken as length 1",)),
        ("1.0", "0 0 1 0", 0.0, ('is ignored, as in other programs; write <robot version="1.1"',)),
    ],
)
def test_a_quaternion_from_version_1_1_on(
    version: str, quaternion: str, yaw: float, words: tuple[str, ...]
) -> None:
    description = versioned(version, f'<origin xyz="0 0 1" quat_xyzw="{quaternion}"/>')
    [joint] = description.joints
    assert joint.origin.rpy == pytest.approx((0.0, 0.0, yaw), abs=1e-8)
    assert not description.problems
    assert len(words) == len(description.warnings)
    assert all(word in text for word, text in zip(words, description.warnings, strict=True))


@pytest.mark.parametrize(
    "attributes",
    [
        'quat_xyzw="0 0 0 0"',
        'quat_xyzw="0 0 x 1"',
        'quat_xyzw="0 0 0 1" rpy="0 0 0"',
    ],
)
def test_a_rotation_that_is_none_is_refused(attributes: str) -> None:
    with pytest.raises(DescriptionError, match='joint "j" <origin>: .*quat_xyzw'):
        versioned("1.1", f"<origin {attributes}/>")


def test_a_capsule_of_version_1_1() -> None:
    shape = '<visual><geometry><capsule radius="1" length="2"/></geometry></visual>'
    urdf = robot(base=shape + shape.replace("visual", "collision"))
    older, description = (
        parse_description(urdf.replace("<robot", f'<robot version="{version}"'))
        for version in ("1.0", "1.1")
    )
    assert all("is a shape of URDF 1.1" in problem for problem in older.problems)
    assert older.links[0].visuals == description.links[0].visuals
    assert description.notices == ()
    assert shape_sizes(description)[0] == {Capsule(1.0, 2.0): (2.0, 2.0, 4.0)}


def test_limits_of_version_1_2() -> None:
    """Effort and velocity may be missing there; what nothing keeps to is named."""
    limit = '<limit lower="-1" upper="1" acceleration="3" deceleration="4" jerk="5"/>'
    description = versioned("1.2", limit=limit)
    [joint] = description.joints
    assert (joint.acceleration, joint.deceleration, joint.jerk) == (3.0, 4.0, 5.0)
    assert (joint.effort, joint.velocity) == (None, None)
    [warning] = description.notices
    assert warning.endswith(
        "<limit>: acceleration, deceleration, jerk of j: motions ignore this limit"
    )
    assert "3 rad/s²" in describe(description)
    [fault] = versioned("1.2", limit=LIMIT.replace("/>", ' jerk="-1"/>')).problems
    assert 'jerk="-1" is negative' in fault
    assert len(versioned("1.1", limit=limit).problems) == 2, "effort and velocity are needed there"


@pytest.mark.parametrize("version", ["2.0", "1", "latest", ""])
def test_a_version_that_nobody_knows_is_a_warning(version: str) -> None:
    [warning] = versioned(version).notices
    assert f'version="{version}" of URDF is not known (1.0, 1.1, 1.2)' in warning
