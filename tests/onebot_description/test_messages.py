"""Messages are read as rclpy wrote them."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import (
    odometry_sample,
    one_joint_state,
    tf_arrays,
)

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
    data = serialize_message(TFMessage(transforms=[_stamped(stamp, edge) for edge in edges]))
    tf = tf_arrays(data)
    assert tf.parents == tuple(edge[0].removeprefix("/") for edge in edges)
    assert tf.children == tuple(edge[1].removeprefix("/") for edge in edges)
    assert tf.stamps_ns.tolist() == [stamp[0] * 10**9 + stamp[1]] * len(edges)
    numbers = np.array([edge[2] for edge in edges]).reshape(-1, 7)
    np.testing.assert_array_equal(np.hstack((tf.translations, tf.rotations)), numbers)


numbers = st.lists(st.floats(width=64), min_size=13, max_size=13)


def _vector(values) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])


@given(numbers, names, names, stamps)
def test_odometry_is_read_as_rclpy_wrote_it(values, frame, child, stamp):
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


def _tf_bytes(names, number=0.0, sec=1):
    edges = [(name, name + "x", [number] * 7) for name in names]
    return serialize_message(TFMessage(transforms=[_stamped((sec, 7), edge) for edge in edges]))


def test_frames_are_without_the_slash_of_ros_1():
    """As tf2 strips it; the slashes of a frame prefix stay."""
    tf = tf_arrays(_tf_bytes(["/odom", "base", "/robot/base"]))
    assert tf.parents == ("odom", "base", "robot/base")
    assert tf.children == ("odomx", "basex", "robot/basex")


def test_names_that_repeat_are_the_same_tuples():
    first, other, second = (tf_arrays(_tf_bytes(n)) for n in (["a", "b"], ["r", "s"], ["a", "b"]))
    assert second.children is first.children and second.parents is first.parents
    assert other.children == ("rx", "sx")
