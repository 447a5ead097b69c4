"""What ``<gazebo>`` says of physics is read, or a line of ``onebot check``."""

import pytest

from onebot_description.description import Description, parse_description

SDFORMAT = """dampingFactor fdir1 fudgeFactor implicitSpringDamper cfmDamping kd kp laserRetro
    maxContacts maxVel minDepth material provideFeedback selfCollide self_collide springReference
    springStiffness static stopCfm stopErp velocity_decay enable_wind kinematic collision""".split()


def robot(*blocks: str, kind: str = "revolute") -> Description:
    """A base and an arm with ``<gazebo>`` blocks, one a line."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == "revolute" else ""
    joint = f'<joint name="j" type="{kind}"><parent link="base"/><child link="a"/>{limit}</joint>'
    links = '<link name="base"/><link name="a"/>'
    return parse_description(
        "\n".join([f'<robot name="r">{links}{joint}', *blocks, "</robot>"]), "r"
    )


def of(reference: str, inside: str) -> str:
    return f'<gazebo reference="{reference}">{inside}</gazebo>'


@pytest.mark.parametrize(
    ("inside", "gravity"),
    [
        ("<gravity>false</gravity>", False),
        ('<gravity value="false"/>', False),
        ("<turnGravityOff>true</turnGravityOff>", False),
        ("<gravity>true</gravity>", True),
        ("<turnGravityOff>False</turnGravityOff>", True),
    ],
)
def test_gravity_is_read(inside: str, gravity: bool) -> None:
    description = robot(of("a", inside))
    assert [link.gravity for link in description.links] == [True, gravity]
    assert description.notices == ()


@pytest.mark.parametrize(
    ("inside", "friction", "said"),
    [
        ("<mu1>0.2</mu1>", 0.2, False),
        ('<mu1 value="0.2"/>', 0.2, False),
        ("<mu1>0.2</mu1><mu2>0.2</mu2>", 0.2, False),
        ("<mu2>0.3</mu2>", 0.3, False),
        ("<mu1>0.2</mu1><mu2>0.3</mu2>", 0.2, True),
        ("<mu1>100000</mu1>", 100000.0, True),
    ],
)
def test_friction_is_read_and_what_is_lost_of_it_named(
    inside: str, friction: float, said: bool
) -> None:
    description = robot(of("a", inside))
    assert description.links[1].mu == friction
    assert not description.problems
    assert ["in all directions and at most 1" in text for text in description.warnings] == [
        True
    ] * said


def test_with_wheels_the_line_says_how_to_set_their_friction() -> None:
    [warning] = robot(
        of("base", "<mu1>0.2</mu1>"), of("a", "<mu1>1</mu1>"), kind="continuous"
    ).warnings
    assert warning.startswith("r:2: <gazebo> <mu1>: <mu1> of a, base: ")
    assert "<contact><lateral_friction" in warning


@pytest.mark.parametrize("tag", SDFORMAT)
@pytest.mark.parametrize("reference", ["a", "j"])
def test_what_nothing_simulates_is_named(tag: str, reference: str) -> None:
    [warning] = robot(of(reference, f"<{tag}>true 7</{tag}>")).warnings
    assert warning.startswith(f"r:2: <gazebo> <{tag}>: <{tag}> of {reference}: ")
    assert "not known" not in warning


def test_one_line_for_each_reason() -> None:
    """With the links; what asks for nothing is no line."""
    blocks = [
        of(name, "<kp>1e6</kp><kd value='1'/><provideFeedback>0</provideFeedback>")
        for name in ("a", "base")
    ]
    blocks += [
        of("j", "<preserveFixedJoint>true</preserveFixedJoint>"),
        of("a", "<selfCollide>false</selfCollide>"),
    ]
    blocks += ["<gazebo><plugin/></gazebo>", "<gazebo><self_collide>true</self_collide></gazebo>"]
    rigid, colliding = robot(*blocks).warnings
    assert rigid == "r:2: <gazebo> <kp>: <kp>, <kd> of a, base: contacts are rigid here"
    assert colliding.endswith("<self_collide> of the robot: links of one robot do not collide here")


@pytest.mark.parametrize(
    ("block", "text"),
    [
        (of("a", "<turngravityoff>true</turngravityoff>"), 'did you mean "turnGravityOff"?'),
        (of("b", "<kp>1</kp>"), 'there is no link or joint "b", so it is ignored (known|links'),
        (of("a", "<gravity>off</gravity>"), '"off" is neither true nor false'),
        (of("a", "<mu1>x</mu1>"), '"x" is not a finite number'),
        (of("a", "<mu1>-1</mu1>"), '"-1" is negative'),
    ],
)
def test_what_is_written_wrongly(block: str, text: str) -> None:
    [notice] = robot(block).notices
    assert any(part in notice for part in text.split("|"))
