"""Messages are read as rclpy wrote them."""

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
    state = one_joint_state(data)
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
    tf = tf_arrays(data)
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
        for decode in (one_joint_state, tf_arrays):
            try:
                decode(data)
            except WireError:
                pass


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
    read = odometry_sample(serialize_message(message))
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
    plain, full = twist_sample(serialize_message(twist)), serialize_message(stamped)
    for read in (plain, twist_stamped_sample(full)):
        np.testing.assert_array_equal(np.concatenate([read.linear, read.angular]), values[:6])
    assert plain.stamp_ns == 0
    assert twist_stamped_sample(full).stamp_ns == stamp[0] * 10**9 + stamp[1]


WHOLE = {
    tf_arrays: TFMessage(transforms=[_stamped((3, 4), ("parent", "child", [0.5] * 7))] * 2),
    one_joint_state: _joint_state((1, 2), "f", ["a", "bc"], [1.0, 2.0], [4.0], [3.0]),
    odometry_sample: Odometry(child_frame_id="child"),
    twist_sample: Twist(linear=Vector3(x=1.0)),
    twist_stamped_sample: TwistStamped(header=Header(frame_id="base")),
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


def _tf_bytes(names, number=0.0, sec=1):
    edges = [(name, name + "x", [number] * 7) for name in names]
    return serialize_message(TFMessage(transforms=[_stamped((sec, 7), edge) for edge in edges]))


def test_names_that_repeat_are_the_same_lists():
    """The viewer finds what it made of them at once; also of several publishers in turn."""
    first, other, second = (tf_arrays(_tf_bytes(n)) for n in (["a", "b"], ["r", "s"], ["a", "b"]))
    assert second.children is first.children and second.parents is first.parents
    assert other.children == ["rx", "sx"]


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
    expected = tf_arrays(bytes(data))
    # After the stamp: 2 for "a" with its NUL, then two bytes of padding.
    assert data[16:22] == b"\x02\x00\x00\x00a\x00"
    data[22:24] = b"\xff\xff"
    found = tf_arrays(bytes(data))
    _same(found, expected)
