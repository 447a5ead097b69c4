"""What pages may say to the steering server."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.steering.protocol import (
    ChooseTopic,
    Drive,
    ProtocolError,
    Release,
    SetLimits,
    Stop,
    Velocity,
    error_text,
    parse,
    stamp_of,
    state_text,
    velocity_fields,
    welcome_text,
)


@pytest.mark.parametrize(
    "text, meant",
    [
        (
            '{"type":"drive","stamp":1500,"linear":0.5,"angular":-1}',
            Drive(Velocity(0.5, -1.0), 1.5),
        ),
        ('{"type":"release"}', Release()),
        ('{"type":"stop"}', Stop()),
        ('{"type":"topic","topic":"/robot_1/cmd_vel"}', ChooseTopic("/robot_1/cmd_vel")),
        ('{"type":"limits","linear":1,"angular":2e-1}', SetLimits(1.0, 0.2)),
        ('{"type":"limits","linear":null,"angular":1e9}', SetLimits(None, 1e9)),
    ],
)
def test_each_message_is_understood(text, meant):
    """The five messages of the protocol mean what they say."""
    assert parse(text) == meant


@pytest.mark.parametrize(
    "text",
    [
        "",
        "hello",
        "[]",
        "5",
        "null",
        "{}",
        '{"type":"fly"}',
        '{"type":["drive"]}',
        '{"type":"stop","now":true}',
        '{"type":"drive","linear":1,"angular":0}',
        '{"type":"drive","stamp":1,"linear":1,"angular":0,"z":1}',
        '{"type":"drive","stamp":1,"linear":NaN,"angular":0}',
        '{"type":"drive","stamp":1,"linear":1,"angular":-Infinity}',
        '{"type":"drive","stamp":1,"linear":1e999,"angular":0}',
        '{"type":"drive","stamp":1,"linear":1' + "0" * 400 + ',"angular":0}',
        '{"type":"drive","stamp":1,"linear":"1","angular":0}',
        '{"type":"drive","stamp":1,"linear":true,"angular":0}',
        '{"type":"drive","stamp":1,"linear":null,"angular":0}',
        '{"type":"drive","stamp":1,"linear":1,"linear":2,"angular":0}',
        '{"type":"drive","stamp":null,"linear":1,"angular":0}',
        '{"type":"drive","stamp":true,"linear":1,"angular":0}',
        '{"type":"limits","linear":0,"angular":1}',
        '{"type":"limits","linear":1,"angular":-1}',
        '{"type":"topic","topic":""}',
        '{"type":"topic","topic":"/a//b"}',
        '{"type":"topic","topic":"/1a"}',
        '{"type":"topic","topic":"/a\\n"}',
        '{"type":"topic","topic":"/' + "a" * 300 + '"}',
        '{"type":"topic","topic":7}',
        '{"type":"release"}' + " " * 2000,
        "[" * 1000,
        '{"type":"topic","topic":"\\ud800"}',
        '{"type":"release"}{"type":"stop"}',
    ],
)
def test_anything_else_is_refused(text):
    """It gives a ProtocolError in plain words, and nothing else."""
    with pytest.raises(ProtocolError) as caught:
        parse(text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
_names = st.sampled_from(["type", "stamp", "linear", "angular", "topic", "x"])
_kinds = st.sampled_from(["drive", "release", "stop", "topic", "limits"])


@given(st.text() | _json.map(json.dumps) | st.dictionaries(_names, _json | _kinds).map(json.dumps))
def test_whatever_comes_is_a_finite_command_or_refused(text):
    """No text gets an exception other than ProtocolError, or a number that is not finite, past."""
    try:
        message = parse(text)
    except ProtocolError:
        return
    if isinstance(message, Drive):
        assert math.isfinite(message.velocity.linear) and math.isfinite(message.velocity.angular)


_speed = st.floats(allow_nan=False, allow_infinity=False)
_bound = st.floats(0, 5)


@given(_speed, _speed, _bound, _bound, _bound, _bound)
def test_a_clamped_command_is_within_the_limits_on_the_same_arc(
    linear, angular, back, most, right, left
):
    """It is the command itself where that is within them; else one factor slows both speeds."""
    wanted = Velocity(linear, angular)
    clamped = wanted.clamped(Velocity(-back, -right), Velocity(most, left))
    assert -back <= clamped.linear <= most and -right <= clamped.angular <= left
    if -back <= linear <= most and -right <= angular <= left:
        assert clamped == wanted
        return
    size = max(abs(linear), abs(angular))
    across = clamped.linear * (angular / size), clamped.angular * (linear / size)
    assert math.isclose(*across, rel_tol=1e-9, abs_tol=1e-12)


@pytest.mark.parametrize(
    "wanted, sent",
    [
        ((10251000000100.0, 0.0), (0.4, 0.0)),
        ((-1e9, 0.0), (-0.2, 0.0)),
        ((0.8, 0.3), (0.4, 0.15)),
        ((0.4, 6.0), (0.1, 1.5)),
        ((0.0, -7.0), (0.0, -1.5)),
        ((0.3, -0.0), (0.3, 0.0)),
    ],
)
def test_a_command_beyond_a_limit_is_slowed_to_it(wanted, sent):
    """Forward, backward and turning; what is at its limit is exactly that."""
    clamped = Velocity(*wanted).clamped(Velocity(-0.2, -1.5), Velocity(0.4, 1.5))
    assert (clamped.linear, clamped.angular) == sent


def test_a_robot_that_cannot_reverse_does_not_turn_on_the_spot_instead():
    """The arc cannot be driven, at no speed: it stands."""
    assert Velocity(-0.5, 0.5).clamped(Velocity(0, -1), Velocity(1, 1)) == Velocity()
    assert Velocity(0.0, 0.5).clamped(Velocity(0, -1), Velocity(1, 1)) == Velocity(0.0, 0.5)


def test_the_state_is_json_that_browsers_take():
    """A NaN would not be: it is an error here, not a page that stands still."""
    with pytest.raises(ValueError):
        state_text({"odometry": {"x": math.nan}})


def test_what_is_just_possible_is_understood():
    """The longest message, and the longest name of a topic; one character more is refused."""
    longest = '{"type":"release"}'.ljust(1024)
    assert parse(longest) == Release()
    with pytest.raises(ProtocolError, match="at most 1024"):
        parse(longest + " ")
    name = "/" + "a" * 199
    assert parse(json.dumps({"type": "topic", "topic": name})) == ChooseTopic(name)
    with pytest.raises(ProtocolError, match="name of a ROS topic"):
        parse(json.dumps({"type": "topic", "topic": name + "a"}))
    for name in ("~/cmd_vel", "cmd_vel", "_a/b2", "A"):
        assert parse(json.dumps({"type": "topic", "topic": name})) == ChooseTopic(name)


@pytest.mark.parametrize(
    ("limits", "name"),
    [("0,1", None), ("1,0", None), ("-1,1", None), ("1e-9,1", "ok"), ("1,1e-9", "ok")],
)
def test_both_limits_are_above_zero(limits, name):
    """Each on its own."""
    linear, angular = limits.split(",")
    text = f'{{"type":"limits","linear":{linear},"angular":{angular}}}'
    if name:
        assert parse(text) == SetLimits(float(linear), float(angular))
    else:
        with pytest.raises(ProtocolError, match="above zero"):
            parse(text)


def test_what_is_refused_is_named():
    """The field, the type and what would be right."""
    for text, words in (
        ('{"type":"drive","stamp":1,"linear":0,"angular":"1"}', "angular must be a number"),
        ('{"type":"drive","stamp":1,"linear":1e999,"angular":0}', "linear must be a finite"),
        ('{"type":"drive","stamp":"","linear":1,"angular":0}', "stamp must be a number"),
        ('{"type":"release","a":1}', '"release" has no fields beside its type'),
        ('{"type":"drive"}', '"drive" has angular, linear, stamp beside its type'),
        ('{"type":"fly"}', "one of drive, release, stop, topic, limits"),
        ('{"type":"stop","type":"stop"}', "given twice"),
        ("NaN", "NaN is not valid JSON"),
        ("[]", "JSON object"),
    ):
        with pytest.raises(ProtocolError, match=words):
            parse(text)


@pytest.mark.parametrize(
    "text, about, field",
    [
        ('{"type":"limits","linear":-1,"angular":1}', "limits", "linear"),
        ('{"type":"limits","linear":null,"angular":"0,5"}', "limits", "angular"),
        ('{"type":"limits","linear":1}', "limits", None),
        ('{"type":"topic","topic":"/a//b"}', "topic", "topic"),
        ('{"type":"drive","stamp":"","linear":1,"angular":1}', "drive", "stamp"),
        ('{"type":"fly"}', None, None),
        ("hello", None, None),
    ],
)
def test_a_refusal_names_the_message_and_the_field(text, about, field):
    """For the page to show it beside the field that it is about."""
    with pytest.raises(ProtocolError) as caught:
        parse(text)
    assert (caught.value.about, caught.value.field) == (about, field)


def test_what_the_server_says_is_json():
    """Each message has its type."""
    assert json.loads(welcome_text("p1", 20.0, stamp_of(1.5))) == {
        "type": "welcome", "id": "p1", "rate": 20.0, "stamp": 1500
    }  # fmt: skip
    error = {"type": "error", "message": 'a "b"', "about": None, "field": None}
    assert json.loads(error_text('a "b"')) == error
    about = {"about": "limits", "field": "linear"}
    assert json.loads(error_text('a "b"', **about)) == {**error, **about}
    assert velocity_fields(Velocity(1.0, -2.0)) == {"linear": 1.0, "angular": -2.0}
    assert json.loads(state_text({"driver": None})) == {"type": "state", "driver": None}
