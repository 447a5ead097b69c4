"""The builtin gives what the long way gives, for any sequence of bytes."""

import gc
import weakref

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message

from onebot_description.wire import state_converter
from onebot_description.wire.cdr import WireError
from onebot_description.wire.state_converter import StateConverter
from tests.onebot_description.test_state_converter import NOW, _message, _model, joint_states
from tests.random_robots import chain, robots


def _long_way(model, **options):
    """A converter without the builtin; its arithmetic is the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state_converter, "make_compiled_path", lambda _: None)
        return StateConverter(model, **options)


def _outcome(converter, data, now):
    try:
        return converter.convert_bytes(data, now)
    except WireError as error:
        return str(error)


@st.composite
def edits(draw, messages):
    """Serialized messages, some of them cut, longer, or with another byte somewhere."""
    data = draw(st.sampled_from(messages))
    if draw(st.integers(0, 3)):
        return data
    place = draw(st.integers(0, len(data)))
    byte = draw(st.sampled_from([b"", b"\x00", b"\x01", b"\xff"]))
    return data[:place] + byte + draw(st.sampled_from([data[place + len(byte) :], b"", data]))


@settings(deadline=None, max_examples=200)
@given(robots(), st.data(), st.booleans(), st.sampled_from([0, 1, 10**8, 2**70]))
def test_it_gives_what_the_long_way_gives(urdf, data, ignore_timestamp, interval):
    """Bytes, errors and warnings; more layouts than it knows, broken ones, a clock set back."""
    model = _model(urdf)
    said = ([], [])
    options = {"ignore_timestamp": ignore_timestamp, "interval_ns": interval}
    fast = StateConverter(model, warn=lambda *text: said[0].append(text), **options)
    slow = _long_way(model, warn=lambda *text: said[1].append(text), **options)
    states = data.draw(st.lists(joint_states([*model.joints]), min_size=1, max_size=12))
    messages = [serialize_message(state) for state in states]
    steps = st.tuples(edits(messages), st.sampled_from([0, 0, 0, 1, -1]))
    now = NOW
    for message, step in data.draw(st.lists(steps, max_size=60)):
        now += step
        assert _outcome(fast, message, now) == _outcome(slow, message, now)
    assert said[0] == said[1]


def _count_long_ways(monkeypatch):
    calls = []
    long_way = StateConverter._convert_bytes

    def counted(self, data, now):
        calls.append(data)
        return long_way(self, data, now)

    monkeypatch.setattr(StateConverter, "_convert_bytes", counted)
    return calls


@pytest.mark.parametrize("publishers", [1, 8])
def test_the_usual_message_never_takes_the_long_way(monkeypatch, publishers):
    """Only the first of each publisher does, also where their padding differs each time."""
    calls = _count_long_ways(monkeypatch)
    converter = StateConverter(_model(chain(9)))
    for second in range(1, 6):
        for joint in range(publishers):
            names = [f"joint_{joint}", "odd", f"joint_{joint + 1}"]
            data = serialize_message(_message(names, [0.1, 0.2, 0.3], (second, joint)))
            at = data.index(b"odd\0") + 4
            data = data[:at] + bytes([second]) * (-at % 4) + data[at + -at % 4 :]
            assert converter.convert_bytes(data, NOW) is not None
    assert len(calls) == publishers


def test_what_is_not_usual_takes_the_long_way(monkeypatch):
    """Stamp 0, positions that are not moderate, a clock set back; and the next is usual again."""
    calls = _count_long_ways(monkeypatch)
    converter = StateConverter(_model(chain(1)))

    def long_ways(position, stamp, now=NOW):
        calls.clear()
        converter.convert_bytes(serialize_message(_message(["joint_0"], [position], stamp)), now)
        return len(calls)

    assert long_ways(0.0, (5, 0)) == 1
    assert long_ways(0.0, (5, 1)) == 0
    assert long_ways(np.nan, (5, 2)) == 1
    assert long_ways(1e101, (5, 2)) == 1
    assert long_ways(0.0, (0, 0)) == 1
    assert long_ways(0.0, (4, 0), NOW - 1) == 1
    assert long_ways(0.0, (4, 1), NOW - 1) == 0


@pytest.mark.parametrize(
    "arguments", [(), (b"",), (b"", 1, 2), ("text", 1), (b"", "1"), (b"", 2**63)]
)
def test_wrong_arguments(arguments):
    """As a function in Python: an error, whatever it is given."""
    with pytest.raises((TypeError, OverflowError)):
        StateConverter(_model(chain(1))).convert_bytes(*arguments)


def test_a_converter_goes_with_the_robot_it_served():
    """Nothing keeps its memory once nobody uses it, and what it gave remains."""
    converter = StateConverter(_model(chain(3)))
    data = [serialize_message(_message(["joint_0"], [0.5], (second, 0))) for second in (1, 2)]
    converter.convert_bytes(data[0], NOW)
    kept = converter.convert_bytes(data[1], NOW)
    copy = bytes(bytearray(kept))
    gone = weakref.ref(converter)
    del converter
    gc.collect()
    assert gone() is None
    assert kept == copy


def test_the_builtin_outlives_its_converter():
    """Whoever holds the function alone holds all the memory that it reads."""
    convert = StateConverter(_model(chain(3))).convert_bytes
    for second in range(1, 20):
        names = [f"joint_{second % 3}", "x" * second]
        data = serialize_message(_message(names, [0.5, 0.0], (second, 0)))
        first = convert(data, NOW)
        gc.collect()
        assert convert(data, NOW) == first is not None
