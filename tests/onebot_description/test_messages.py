"""Messages are read as rclpy wrote them, from plain CDR and from any other encoding."""

import struct

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Quaternion,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
)
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.wire.cdr import WireError
from onebot_description.wire.messages import (
    decode_joint_state,
    decode_odometry,
    decode_tf,
    decode_twist,
    decode_twist_stamped,
    odometry_sample,
    one_joint_state,
    tf_arrays,
    twist_sample,
    twist_stamped_sample,
)
from onebot_description.wire.tf_message import TFMessage

names = st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\0"), max_size=12)
doubles = st.floats(allow_nan=True, allow_infinity=True)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 999_999_999))


def _joint_state(stamp, frame_id, joints, position, velocity, effort):
    header = Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=frame_id)
    return JointState(
        header=header, name=joints, position=position, velocity=velocity, effort=effort
    )


@given(
    stamps, names, st.lists(names, max_size=6), *[st.lists(doubles, max_size=6) for _ in range(3)]
)
def test_joint_state_reads_as_rclpy_wrote_it(stamp, frame_id, joints, position, velocity, effort):
    """Every field of a JointState survives, whatever the strings and lengths."""
    data = serialize_message(_joint_state(stamp, frame_id, joints, position, velocity, effort))
    state = decode_joint_state(data)
    assert state.stamp_ns == stamp[0] * 10**9 + stamp[1]
    assert (state.frame_id, state.names) == (frame_id, tuple(joints))
    for ours, theirs in zip(state[3:], (position, velocity, effort), strict=True):
        np.testing.assert_array_equal(ours, theirs)


edges = st.tuples(names, names, st.lists(doubles, min_size=7, max_size=7))


def _stamped(stamp, edge):
    parent, child, numbers = edge
    x, y, z, qx, qy, qz, qw = numbers
    return TransformStamped(
        header=Header(stamp=Time(sec=stamp[0], nanosec=stamp[1]), frame_id=parent),
        child_frame_id=child,
        transform=Transform(
            translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw)
        ),
    )


@given(stamps, st.lists(edges, max_size=5))
def test_tf_reads_as_rclpy_wrote_it(stamp, edges):
    """Frames, stamps and numbers of a TFMessage survive."""
    data = serialize_message(TFMessage(transforms=[_stamped(stamp, edge) for edge in edges]))
    tf = decode_tf(data)
    assert tf.parents == [edge[0] for edge in edges]
    assert tf.children == [edge[1] for edge in edges]
    assert tf.stamps_ns.tolist() == [stamp[0] * 10**9 + stamp[1]] * len(edges)
    numbers = np.array([edge[2] for edge in edges]).reshape(-1, 7)
    np.testing.assert_array_equal(np.hstack((tf.translations, tf.rotations)), numbers)


@given(st.binary(max_size=200), st.integers(0, 300))
def test_broken_bytes_are_refused(noise, cut):
    """Truncated or random bytes raise WireError or decode; nothing else happens."""
    whole = serialize_message(_joint_state((1, 2), "f", ["a", "bc"], [1.0, 2.0], [], [3.0]))
    for data in (whole[:cut], b"\0\1\0\0" + noise, noise):
        for decode in (decode_joint_state, decode_tf):
            try:
                decode(data)
            except WireError:
                pass


def test_big_endian_is_left_to_rclpy():
    """The encapsulation of big-endian CDR is not read as if it were little-endian."""
    with pytest.raises(WireError):
        decode_joint_state(b"\0\0\0\0" + bytes(40))


numbers = st.lists(st.floats(width=64), min_size=13, max_size=13)


def _vector(values) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])


@given(numbers, names, names, stamps)
def test_odometry_is_read_as_rclpy_wrote_it(values, frame, child, stamp):
    """Any frame names (each shifts the doubles), any numbers, NaN and infinity among them."""
    message = Odometry(child_frame_id=child)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y, place.z = values[:3]
    turn.x, turn.y, turn.z, turn.w = values[3:7]
    message.twist.twist.linear = _vector(values[7:10])
    message.twist.twist.angular = _vector(values[10:])
    message.pose.covariance[:] = np.resize(values, 36)
    read = decode_odometry(serialize_message(message))
    assert (read.frame_id, read.child_frame_id) == (frame, child)
    assert read.stamp_ns == stamp[0] * 10**9 + stamp[1]
    found = np.concatenate([read.translation, read.rotation, read.linear, read.angular])
    np.testing.assert_array_equal(found, values)
    np.testing.assert_array_equal(read.covariance, message.pose.covariance)


@given(numbers, names, stamps)
def test_twists_are_read_as_rclpy_wrote_them(values, frame, stamp):
    """With and without a header."""
    twist = Twist(linear=_vector(values), angular=_vector(values[3:]))
    stamped = TwistStamped(twist=twist)
    stamped.header.frame_id = frame
    stamped.header.stamp.sec, stamped.header.stamp.nanosec = stamp
    plain, full = decode_twist(serialize_message(twist)), serialize_message(stamped)
    for read in (plain, decode_twist_stamped(full)):
        np.testing.assert_array_equal(np.concatenate([read.linear, read.angular]), values[:6])
    assert plain.stamp_ns == 0
    assert decode_twist_stamped(full).stamp_ns == stamp[0] * 10**9 + stamp[1]


WHOLE = {
    decode_tf: TFMessage(transforms=[_stamped((3, 4), ("parent", "child", [0.5] * 7))] * 2),
    decode_joint_state: _joint_state((1, 2), "f", ["a", "bc"], [1.0, 2.0], [4.0], [3.0]),
    decode_odometry: Odometry(child_frame_id="child"),
    decode_twist: Twist(linear=Vector3(x=1.0)),
    decode_twist_stamped: TwistStamped(header=Header(frame_id="base")),
}
OF_ANY_ENCODING = {
    decode_tf: tf_arrays,
    decode_joint_state: one_joint_state,
    decode_odometry: odometry_sample,
    decode_twist: twist_sample,
    decode_twist_stamped: twist_stamped_sample,
}


@pytest.mark.parametrize("decode", WHOLE)
def test_what_is_cut_off_or_no_plain_cdr_is_refused(decode):
    """Every shorter message raises, and so does big-endian CDR."""
    data = serialize_message(WHOLE[decode])
    decode(data)
    for length in range(len(data)):
        with pytest.raises(WireError):
            decode(data[:length])
    with pytest.raises(WireError):
        decode(b"\0\0" + data[2:])


def _same(one, other):
    for first, second in zip(one, other, strict=True):
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second)
        else:
            assert first == second


# The sizes of the fields in order; lengths of strings and of sequences are 4.
def _big_endian(data, sizes):
    """The same message with each field's bytes the other way round."""
    swapped, at = bytearray(data), 4
    swapped[1] = 0
    for size in sizes:
        at += -(at - 4) % (size if size > 0 else 1)
        if size > 0:
            swapped[at : at + size] = swapped[at : at + size][::-1]
        at += abs(size)
    return bytes(swapped)


STAMP_SIZES = [4, 4]
SIZES = {
    # A negative one is of a string's bytes, which stay as they are.
    decode_tf: [4] + (STAMP_SIZES + [4, -7, 4, -6] + [8] * 7) * 2,
    decode_joint_state: [*STAMP_SIZES, 4, -2, 4, 4, -2, 4, -3, 4, 8, 8, 4, 8, 4, 8],
    decode_odometry: [*STAMP_SIZES, 4, -1, 4, -6, *[8] * 85],
    decode_twist: [8] * 6,
    decode_twist_stamped: [*STAMP_SIZES, 4, -5, *[8] * 6],
}


@pytest.mark.parametrize("decode", WHOLE)
def test_another_encoding_is_read_to_the_same_result(decode):
    """Big-endian CDR, by rclpy."""
    data = serialize_message(WHOLE[decode])
    other = _big_endian(data, SIZES[decode])
    with pytest.raises(WireError):
        decode(other)
    _same(OF_ANY_ENCODING[decode](other), decode(data))


def _tf_bytes(names, number=0.0, sec=1):
    edges = [(name, name + "x", [number] * 7) for name in names]
    return serialize_message(TFMessage(transforms=[_stamped((sec, 7), edge) for edge in edges]))


def test_names_that_repeat_are_the_same_objects():
    """So that whoever keeps them finds them at once; also of several publishers in turn."""
    first, other, second = (decode_tf(_tf_bytes(n)) for n in (["a", "b"], ["r", "s"], ["a", "b"]))
    assert second.children is first.children and second.parents is first.parents
    assert other.children == ["rx", "sx"]
    data = serialize_message(JointState(name=["a"], position=[1.0]))
    assert decode_joint_state(data).names is decode_joint_state(data).names


@pytest.mark.parametrize("text", [b"a\0b\0", b"abc", b"ab\0\0", b"\0a", b"\0", b"", b"a\xff"])
def test_strings_end_as_with_rclpy(text):
    """By the first NUL, or without any."""
    string = struct.pack("<I", len(text)) + text + bytes(-len(text) % 4)
    data = b"\0\1\0\0" + struct.pack("<iI", 1, 2) + string
    data += struct.pack("<I", 2) + 2 * string + bytes(12)
    theirs = deserialize_message(data, JointState)
    ours = one_joint_state(data)
    assert (ours.frame_id, ours.names) == (theirs.header.frame_id, tuple(theirs.name))


def test_padding_may_hold_anything():
    """Fast CDR leaves in it what was in the buffer."""
    data = bytearray(_tf_bytes(["a"], 0.5))
    expected = decode_tf(bytes(data))
    # After the stamp: 2 for "a" with its NUL, then two bytes of padding.
    assert data[16:22] == b"\x02\x00\x00\x00a\x00"
    data[22:24] = b"\xff\xff"
    found = decode_tf(bytes(data))
    _same(found, expected)
    assert found.children is expected.children
