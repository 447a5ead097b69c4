import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from onebot_description.wire.cdr import WireError
from onebot_description.wire.messages import (
    decode_odometry,
    decode_twist,
    decode_twist_stamped,
)

numbers = st.lists(st.floats(width=64), min_size=13, max_size=13)
names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))


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


@pytest.mark.parametrize(
    ("decode", "message"),
    [
        (decode_odometry, Odometry()),
        (decode_twist, Twist()),
        (decode_twist_stamped, TwistStamped()),
    ],
)
def test_what_is_cut_off_or_no_plain_cdr_is_refused(decode, message):
    """Every shorter message raises, and so does big-endian CDR."""
    data = serialize_message(message)
    decode(data)
    # rclpy may pad the end, which nothing tells from the message.
    for length in range(0, len(data) - 8, 4):
        with pytest.raises(WireError):
            decode(data[:length])
    with pytest.raises(WireError):
        decode(b"\0\0" + data[2:])
