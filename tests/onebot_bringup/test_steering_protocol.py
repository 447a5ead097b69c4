"""What pages may say to the steering server."""

import json
import math
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.steering.protocol import (
    MESSAGES,
    ChooseTopic,
    DriveMessage,
    ProtocolError,
    Release,
    SetLimits,
    Stop,
    Velocity,
    message_text,
    parse,
)


@pytest.mark.parametrize(
    "text, meant",
    [
        (
            '{"type":"drive","stamp":1500,"linear":0.5,"angular":-1,"lateral":0.25,'
            '"joints":{"a":1,"b":0}}',
            DriveMessage(0.5, -1.0, 1.5, {"a": 1.0}, 0.25),
        ),
        ('{"type":"release"}', Release()),
        ('{"type":"stop"}', Stop()),
        ('{"type":"topic","topic":"/robot_1/cmd_vel"}', ChooseTopic("/robot_1/cmd_vel")),
        (
            '{"type":"limits","linear":1e-9,"angular":2e-1,"lateral":3}',
            SetLimits(1e-9, 0.2, 3.0),
        ),
        (
            '{"type":"limits","linear":null,"angular":1e9,"lateral":null}',
            SetLimits(None, 1e9, None),
        ),
    ],
)
def test_each_message_is_understood(text, meant):
    """The five messages of the protocol mean what they say."""
    assert parse(text) == meant


def _drive(**changes: object) -> str:
    fields = {"type": "drive", "stamp": 1, "linear": 1, "angular": 0, "lateral": 0, "joints": {}}
    return json.dumps({**fields, **changes})


@pytest.mark.parametrize(
    "text, words, about",
    [
        ("", "must be JSON", None),
        (b"\xff", "must be JSON", None),
        ("[" * 1000, "must be JSON", None),
        ("[]", "JSON object", None),
        ('{"type":"release"}' + " " * 2000, "at most 1024", None),
        ("{}", "one of drive, release, stop, topic, limits", None),
        ('{"type":"stop","now":true}', '"stop", beside its type, has no fields', "stop"),
        ('{"type":"drive"}', "has linear, angular, lateral, stamp, joints, no", "drive"),
        (_drive(linear=math.nan), "linear must be a finite", "drive"),
        (_drive(linear=True), "linear must be a finite number", "drive"),
        (_drive(lateral=-math.inf), "lateral must be a finite number", "drive"),
        (_drive(stamp=None), "stamp must be a finite number", "drive"),
        (_drive(joints=[1]), "joints must have velocities by the joints", "drive"),
        (_drive(joints={"a": math.inf}), "joints must be a finite", "drive"),
        ('{"type":"limits","linear":0,"angular":1,"lateral":1}', "linear must be above", "limits"),
        ('{"type":"limits","linear":1,"angular":1,"lateral":-1}', "lateral must be", "limits"),
        ('{"type":"limits","linear":1,"angular":1}', "linear, angular, lateral, no oth", "limits"),
        ('{"type":"topic","topic":"/a//b"}', "name of a ROS topic", "topic"),
        ('{"type":"topic","topic":"/a\\n"}', "name of a ROS topic", "topic"),
        ('{"type":"topic","topic":"/%s"}' % ("a" * 200), "name of a ROS", "topic"),
        ('{"type":"topic","topic":7}', "name of a ROS topic", "topic"),
        ('{"type":"topic","topic":"\\ud800"}', "must be JSON", None),
    ],
)  # fmt: skip
def test_anything_else_is_refused(text, words, about):
    """With the problem in words, and the message for the page to show it beside."""
    with pytest.raises(ProtocolError, match=words) as caught:
        parse(text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200
    assert caught.value.about == about


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
_names = st.sampled_from(["type", "stamp", *Velocity._fields, "joints", "topic", "x"])
_kinds = st.sampled_from(list(MESSAGES))


@given(st.text() | _json.map(json.dumps) | st.dictionaries(_names, _json | _kinds).map(json.dumps))
def test_whatever_comes_is_a_finite_command_or_refused(text):
    """No text gets an exception other than ProtocolError, or a number that is not finite, past."""
    try:
        message = parse(text)
    except ProtocolError:
        return
    if isinstance(message, DriveMessage):
        velocity, joints = message.command.velocity, message.joints
        assert all(map(math.isfinite, (*velocity, *joints.values())))


_speed = st.floats(allow_nan=False, allow_infinity=False)
_velocity = st.builds(Velocity, _speed, _speed, _speed)
_bound = st.floats(0, 5)
_bounds = st.builds(Velocity, _bound, _bound, _bound)


@given(_velocity, _bounds, _bounds)
def test_a_clamped_command_is_within_the_limits_on_the_same_arc(wanted, back, most):
    """It is the command itself where that is within them; else one factor slows all speeds."""
    least = Velocity(*(-speed for speed in back))
    clamped = wanted.clamped(least, most)
    assert all(a <= speed <= b for a, speed, b in zip(least, clamped, most, strict=True))
    if all(a <= speed <= b for a, speed, b in zip(least, wanted, most, strict=True)):
        assert clamped == wanted
        return
    size = max(map(abs, wanted))
    for one, other in combinations(range(3), 2):
        across = clamped[one] * (wanted[other] / size), clamped[other] * (wanted[one] / size)
        assert math.isclose(*across, rel_tol=1e-9, abs_tol=1e-12)


def test_a_robot_that_cannot_reverse_does_not_turn_on_the_spot_instead():
    """The arc cannot be driven, at no speed: it stands. What is at its limit is exactly that."""
    assert Velocity(-0.5, 0.5).clamped(Velocity(0, -1), Velocity(1, 1)) == Velocity()
    assert Velocity(0.0, 0.5).clamped(Velocity(0, -1), Velocity(1, 1)) == Velocity(0.0, 0.5)
    assert Velocity(0.4, 6.0).clamped(Velocity(), Velocity(0.4, 1.5)) == Velocity(0.1, 1.5)


def test_the_server_sends_json_that_browsers_take():
    """A NaN would not be: it is an error here, not a page that stands still."""
    text = message_text("error", message='a "b"', about=None)
    assert json.loads(text) == {"type": "error", "message": 'a "b"', "about": None}
    with pytest.raises(ValueError):
        message_text("state", odometry={"x": math.nan})
