"""Raw CDR messages into arrays, quickly; whatever is not plain CDR, as rclpy does it.

Bytes that are no such message are a ValueError or an IndexError, whoever finds out.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy import serialization
from sensor_msgs.msg import JointState

from onebot_bringup.viewer.odometry_wire import (
    OdometrySample,
    TwistSample,
    decode_odometry,
    decode_twist,
    decode_twist_stamped,
)
from onebot_description.stamps import nanoseconds
from onebot_description.tf import messages
from onebot_description.tf.repeated import JointStateReader, TfReader
from onebot_description.tf.tf_message import TFMessage
from onebot_description.tf.wire import JointStateArrays, TfArrays, WireError

T = TypeVar("T")
Complain = Callable[[Exception], object]
BAD_MESSAGE = (ValueError, IndexError)  # what is raised for bytes that are no such message

# They remember the names of messages that come again and again.
_TF, _JOINT_STATES = TfReader(), JointStateReader()


def deserialize_message(data: bytes, kind: type) -> Any:
    """Decode a message of the class ``kind`` as rclpy does.

    Raises:
        ValueError: the bytes are no such message; rclpy's own errors are of many kinds.
    """
    try:
        return serialization.deserialize_message(data, kind)
    except Exception as error:
        reason = " ".join(str(error).split()).partition("., at /")[0]  # of rclpy's source code
        raise ValueError(f"it is no {kind.__name__}: {reason}") from error


def tf_arrays(data: bytes) -> TfArrays:
    """Decode a TFMessage."""
    try:
        return _TF.read(data)
    except WireError:
        transforms = deserialize_message(data, TFMessage).transforms
    stamps = [nanoseconds(t.header.stamp) for t in transforms]
    shifts = [t.transform.translation for t in transforms]
    turns = [t.transform.rotation for t in transforms]
    return TfArrays(
        [t.header.frame_id for t in transforms],
        [t.child_frame_id for t in transforms],
        np.array(stamps, np.int64),
        np.array([(v.x, v.y, v.z) for v in shifts], float).reshape(-1, 3),
        np.array([(q.x, q.y, q.z, q.w) for q in turns], float).reshape(-1, 4),
    )


def joint_state_arrays(data: bytes) -> JointStateArrays:
    """Decode a JointState."""
    try:
        return _JOINT_STATES.read(data)
    except WireError:
        return messages.joint_state_arrays(deserialize_message(data, JointState))


def tf_batch(messages: Sequence[bytes], complain: Complain) -> list[TfArrays | None]:
    """Decode TFMessages, for hardly more than one takes, if they repeat.

    Args:
        messages: in the order they came.
        complain: is told why a message is none.

    Returns:
        The message for each; None for one that is none.
    """
    return _filled(_TF.read_known(messages), messages, tf_arrays, complain)


def joint_state_batch(
    messages: Sequence[bytes], complain: Complain
) -> list[JointStateArrays | None]:
    """Decode JointStates; see ``tf_batch``."""
    return _filled(_JOINT_STATES.read_known(messages), messages, joint_state_arrays, complain)


def _filled(
    known: Iterable[T | None],
    messages: Iterable[bytes],
    read: Callable[[bytes], T],
    complain: Complain,
) -> list[T | None]:
    """Read on their own what was not known."""
    found = list(known)
    for at, data in enumerate(messages):
        if found[at] is None:
            try:
                found[at] = read(data)
            except BAD_MESSAGE as error:
                complain(error)
    return found


def odometry_sample(data: bytes) -> OdometrySample:
    """Decode an Odometry."""
    try:
        return decode_odometry(data)
    except WireError:
        message = deserialize_message(data, Odometry)
    pose, twist = message.pose.pose, message.twist.twist
    return OdometrySample(
        nanoseconds(message.header.stamp),
        message.header.frame_id,
        message.child_frame_id,
        _array(pose.position),
        np.array([pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w]),
        _array(twist.linear),
        _array(twist.angular),
        np.array(message.pose.covariance, float),
    )


def twist_sample(data: bytes) -> TwistSample:
    """Decode a Twist, which has no stamp: its time is 0."""
    try:
        return decode_twist(data)
    except WireError:
        message = deserialize_message(data, Twist)
    return TwistSample(0, _array(message.linear), _array(message.angular))


def twist_stamped_sample(data: bytes) -> TwistSample:
    """Decode a TwistStamped."""
    try:
        return decode_twist_stamped(data)
    except WireError:
        message = deserialize_message(data, TwistStamped)
    return TwistSample(
        nanoseconds(message.header.stamp),
        _array(message.twist.linear),
        _array(message.twist.angular),
    )


def _array(vector: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([vector.x, vector.y, vector.z], float)
