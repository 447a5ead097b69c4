"""Messages that repeat their names are read as ``decode_tf`` and ``decode_joint_state`` do."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.wire.cdr import WireError, decode_joint_state, decode_tf
from onebot_description.wire.repeated import JointStateReader, TfReader
from onebot_description.wire.tf_message import TFMessage

_NAMES = st.lists(st.text("abü_/1", max_size=9), max_size=5)
_NUMBERS = st.floats(-10.0, 10.0)


def _tf(names, numbers, sec=1):
    """A serialized TFMessage whose frames hang on each other."""
    header = [Header(frame_id=name, stamp=Time(sec=sec, nanosec=7)) for name in names]
    shifts = Vector3(x=numbers[0], y=numbers[1], z=numbers[2])
    turn = Quaternion(x=numbers[3], y=numbers[4], z=numbers[5], w=numbers[6])
    transform = Transform(translation=shifts, rotation=turn)
    return serialize_message(
        TFMessage(
            transforms=[
                TransformStamped(
                    header=item, child_frame_id=item.frame_id + "x", transform=transform
                )
                for item in header
            ]
        )
    )


def _same(one, other):
    for first, second in zip(one, other, strict=True):
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second)
        else:
            assert first == second


@given(st.lists(st.tuples(_NAMES, st.lists(_NUMBERS, min_size=7, max_size=7)), max_size=6))
def test_any_sequence_of_tf_messages_is_read_as_each_alone(messages):
    """Whatever was read before, twice over."""
    reader = TfReader()
    for names, numbers in [*messages, *messages]:
        data = _tf(names, numbers)
        _same(reader.read(data), decode_tf(data))


@given(st.lists(st.tuples(_NAMES, st.booleans(), st.booleans()), max_size=6))
def test_any_sequence_of_joint_states_is_read_as_each_alone(messages):
    """With and without velocities; frame_id and names may change."""
    reader = JointStateReader()
    for names, velocities, framed in [*messages, *messages]:
        values = [float(number) for number in range(len(names))]
        data = serialize_message(
            JointState(
                header=Header(frame_id="base" if framed else "", stamp=Time(sec=3, nanosec=9)),
                name=names,
                position=values,
                velocity=values if velocities else [],
            )
        )
        _same(reader.read(data), decode_joint_state(data))


def test_names_that_repeat_are_the_same_objects():
    """So that whoever keeps them finds them at once."""
    reader, joints = TfReader(), JointStateReader()
    first, second = (reader.read(_tf(["a", "b"], [float(i)] * 7, sec=i)) for i in (1, 2))
    third = reader.read(_tf(["a", "b"], [3.0] * 7))
    assert second.children is third.children and second.parents is third.parents
    assert first.children == third.children
    data = serialize_message(JointState(name=["a"], position=[1.0]))
    joints.read(data)
    assert joints.read(data).names is joints.read(data).names


def test_stamps_before_1970_and_past_2038_are_read_as_they_are():
    """Seconds are signed, nanoseconds are not."""
    reader = TfReader()
    for sec in (-1, 2**31 - 1, -(2**31)):
        data = _tf(["a"], [0.0] * 7, sec=sec)
        for _ in range(2):
            _same(reader.read(data), decode_tf(data))


@pytest.mark.parametrize("reader", [TfReader, JointStateReader])
def test_what_is_no_message_is_refused_every_time(reader):
    """Also when a whole one of the same length was read before."""
    kind = (
        _tf(["a"], [0.0] * 7) if reader is TfReader else serialize_message(JointState(name=["a"]))
    )
    read = reader()
    read.read(kind)
    for data in (b"", kind[:-9], b"\x00\x00" + kind[2:]):
        for _ in range(2):
            with pytest.raises(WireError):
                read.read(data)


def test_padding_may_hold_anything():
    """Fast CDR leaves in it what was in the buffer."""
    reader = TfReader()
    data = bytearray(_tf(["a"], [0.5] * 7))
    reader.read(bytes(data))
    # After the stamp: 2 for "a" with its NUL, then two bytes of padding.
    assert data[16:22] == b"\x02\x00\x00\x00a\x00"
    expected = reader.read(bytes(data))
    data[22:24] = b"\xff\xff"
    found = reader.read(bytes(data))
    _same(found, expected)
    assert found.children is expected.children


_KINDS = {
    TfReader: (lambda names, number: _tf(names, [number] * 7, sec=int(number)), decode_tf),
    JointStateReader: (
        lambda names, number: serialize_message(
            JointState(
                header=Header(stamp=Time(sec=int(number), nanosec=9)),
                name=names,
                position=[number + place for place in range(len(names))],
                effort=[number] * (int(number) % 2),
            )
        ),
        decode_joint_state,
    ),
}


@pytest.mark.parametrize("reader", list(_KINDS))
@given(names=st.lists(_NAMES, min_size=1, max_size=12))
def test_many_at_once_are_read_as_each_alone(reader, names):
    """In the order they came, of whatever publishers; None for those not known."""
    make, decode = _KINDS[reader]
    messages = [make(item, float(place)) for place, item in enumerate(names)]
    read = reader()
    assert read.read_known(messages) == [None] * len(messages)
    for data in messages:
        read.read(data)
    unknown = make(["another"], 0.0)
    *found, none = read.read_known([*messages, unknown])
    assert none is None or unknown in messages
    for item, data in zip(found, messages, strict=True):
        if item is not None:  # of more names than are kept
            _same(item, decode(data))
    known = [item for item in found if item is not None]
    assert known


@pytest.mark.parametrize("reader", list(_KINDS))
def test_publishers_whose_messages_are_of_one_length_are_told_apart(reader):
    """As those of robots r1 and r2 are, one message of each in turn."""
    make, decode = _KINDS[reader]
    messages = [make([f"r{place % 3}/a"], 2.0 * place) for place in range(10)]
    read = reader()
    for data in messages[:3]:
        read.read(data)
    for item, data in zip(read.read_known(messages), messages, strict=True):
        _same(item, decode(data))
