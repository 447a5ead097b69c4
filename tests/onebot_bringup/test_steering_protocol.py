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
    Command,
    DriveMessage,
    ProtocolError,
    Release,
    SetLimits,
    Stop,
    Velocity,
    message_text,
    parse,
)


def test_each_message_is_understood():
    """The five messages of the protocol mean what they say; a joint at rest does not move."""
    drive = _drive(stamp=1.5, angular=-1, lateral=0.25, joints={"a": 1, "b": 0})
    message = parse(drive)
    assert message == DriveMessage(1.0, -1.0, 1.5, {"a": 1.0, "b": 0.0}, 0.25)
    assert message.command == Command(Velocity(1.0, -1.0, 0.25), {"a": 1.0})
    for text, meant in {
        '{"type":"release"}': Release(),
        '{"type":"stop"}': Stop(),
        '{"type":"topic","topic":"/robot_1/cmd_vel"}': ChooseTopic("/robot_1/cmd_vel"),
        '{"type":"limits","linear":1e-9,"angular":null,"lateral":3}': SetLimits(1e-9, None, 3.0),
    }.items():
        assert parse(text) == meant


def _drive(**changes: object) -> str:
    fields = {"type": "drive", "stamp": 1, "linear": 1, "angular": 0, "lateral": 0, "joints": {}}
    return json.dumps({**fields, **changes})


@pytest.mark.parametrize(
    "text, words, about",
    [
        (b"\xff", "must be JSON", None),
        ("[" * 1000, "must be JSON", None),
        ('{"type":"topic","topic":"\\ud800"}', "must be JSON", None),
        ("[]", "JSON object", None),
        ('{"type":"release"}' + " " * 2000, "at most 1024", None),
        ("{}", "one of drive, release, stop, topic, limits", None),
        ('{"type":"stop","now":true}', "now: no such parameter", "stop"),
        ('{"type":"drive"}', "linear: is missing", "drive"),
        (_drive(linear=math.nan), "linear: nan is not finite", "drive"),
        (_drive(linear=True), "linear: true is a bool; write a number", "drive"),
        (_drive(stamp=None), "stamp: has no value", "drive"),
        (_drive(joints=[1]), "joints: .* is a list", "drive"),
        (_drive(joints={"a": math.inf}), "joints.a: inf is not finite", "drive"),
        ('{"type":"limits","linear":0}', "linear: 0 is not above 0", "limits"),
        ('{"type":"topic","topic":7}', "topic: 7.* is a number", "topic"),
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
