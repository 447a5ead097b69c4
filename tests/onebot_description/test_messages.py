"""Messages are read as rclpy wrote them."""

import numpy as np
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import odometry_sample, one_joint_state, tf_arrays
from tests.any_message import messages, serialized


def _numbers(*parts):
    """The numbers of vectors and quaternions, in order."""
    return [getattr(part, name) for part in parts for name in part.get_fields_and_field_types()]


@given(messages(JointState))
def test_joint_state_reads_as_rclpy_wrote_it(message):
    state = one_joint_state(serialized(message))
    assert state.stamp_ns == nanoseconds(message.header.stamp)
    assert (state.frame_id, state.names) == (message.header.frame_id, tuple(message.name))
    for ours, theirs in zip(
        state[3:], (message.position, message.velocity, message.effort), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


@given(messages(TFMessage))
def test_tf_reads_as_rclpy_wrote_it(message):
    tf = tf_arrays(serialized(message))
    edges = message.transforms
    assert tf.parents == tuple(edge.header.frame_id.removeprefix("/") for edge in edges)
    assert tf.children == tuple(edge.child_frame_id.removeprefix("/") for edge in edges)
    assert tf.stamps_ns.tolist() == [nanoseconds(edge.header.stamp) for edge in edges]
    moves = [_numbers(edge.transform.translation, edge.transform.rotation) for edge in edges]
    found = np.hstack((tf.translations, tf.rotations))
    np.testing.assert_array_equal(found, np.reshape(moves, (-1, 7)))


@given(messages(Odometry))
def test_odometry_is_read_as_rclpy_wrote_it(message):
    read = odometry_sample(serialized(message))
    assert (read.frame_id, read.child_frame_id) == (
        message.header.frame_id,
        message.child_frame_id,
    )
    assert read.stamp_ns == nanoseconds(message.header.stamp)
    pose, twist = message.pose.pose, message.twist.twist
    found = np.concatenate([read.translation, read.rotation, read.linear, read.angular])
    parts = pose.position, pose.orientation, twist.linear, twist.angular
    np.testing.assert_array_equal(found, _numbers(*parts))
    np.testing.assert_array_equal(read.covariance, message.pose.covariance)


def _tf_of(*names):
    edges = [TransformStamped(child_frame_id=f"{name}x") for name in names]
    for edge, name in zip(edges, names, strict=True):
        edge.header.frame_id = name
    return tf_arrays(serialized(TFMessage(transforms=edges)))


def test_frames_are_without_the_slash_of_ros_1():
    """As tf2 strips it; the slashes of a frame prefix stay."""
    tf = _tf_of("/odom", "base", "/robot/base")
    assert tf.parents == ("odom", "base", "robot/base")
    assert tf.children == ("odomx", "basex", "robot/basex")


def test_names_that_repeat_are_the_same_tuples():
    first, other, second = _tf_of("a", "b"), _tf_of("r", "s"), _tf_of("a", "b")
    assert second.children is first.children and second.parents is first.parents
    assert other.children == ("rx", "sx")
