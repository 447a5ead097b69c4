"""The wire format reads and writes what rclpy itself does."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.wire.cdr import (
    WireError,
    decode_joint_state,
    decode_tf,
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
