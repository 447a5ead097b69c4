"""ROS messages <-> arrays, for what does not take the raw way."""

from __future__ import annotations

import array
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Twist, TwistStamped, Vector3
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy import serialization
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.wire.cdr import (
    NANO,
    JointStateArrays,
    Reader,
    TfArrays,
    WireError,
    nanoseconds,
)
from onebot_description.wire.repeated import JointStateReader, TfReader
from onebot_description.wire.tf_message import TFMessage

# CDR bytes to numbers, for what drives: Odometry, Twist and TwistStamped.

_COVARIANCE = 36

Floats = NDArray[np.float64]

_UNKNOWN: Floats = np.zeros(_COVARIANCE)


class TwistSample(NamedTuple):
    """A velocity.

    Attributes:
        stamp_ns: header.stamp, nanoseconds; 0 in a message without one.
        linear: (3,) metres a second.
        angular: (3,) radians a second.
    """

    stamp_ns: int
    linear: Floats
    angular: Floats


class OdometrySample(NamedTuple):
    """An Odometry message without the covariance of its velocities.

    Attributes:
        stamp_ns: header.stamp, nanoseconds.
        frame_id: header.frame_id, in which the pose is given.
        child_frame_id: the frame that moves, in which the velocities are given.
        translation: (3,) metres.
        rotation: (4,) quaternion x y z w.
        linear: (3,) metres a second.
        angular: (3,) radians a second.
        covariance: (36,) of the pose, row by row: x, y, z in m, the angles about x, y, z in rad.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    translation: Floats
    rotation: Floats
    linear: Floats
    angular: Floats
    covariance: Floats = _UNKNOWN


def decode_odometry(data: bytes) -> OdometrySample:
    """Read a serialized nav_msgs/msg/Odometry; the arrays are views into ``data``.

    Raises:
        WireError: the bytes are not a whole message in plain little-endian CDR.
    """
    reader = Reader(data)
    stamp, frame, child = reader.stamp_ns(), reader.string(), reader.string()
    pose = reader.doubles(7 + _COVARIANCE)
    twist = reader.doubles(6 + _COVARIANCE)
    return OdometrySample(stamp, frame, child, pose[:3], pose[3:7], twist[:3], twist[3:6], pose[7:])


def decode_twist(data: bytes) -> TwistSample:
    """Read a serialized geometry_msgs/msg/Twist.

    Raises:
        WireError: as ``decode_odometry``.
    """
    twist = Reader(data).doubles(6)
    return TwistSample(0, twist[:3], twist[3:])


def decode_twist_stamped(data: bytes) -> TwistSample:
    """Read a serialized geometry_msgs/msg/TwistStamped.

    Raises:
        WireError: as ``decode_odometry``.
    """
    reader = Reader(data)
    stamp = reader.stamp_ns()
    reader.string()
    twist = reader.doubles(6)
    return TwistSample(stamp, twist[:3], twist[3:])


def time_message(stamp_ns: int) -> Time:
    """Return nanoseconds as builtin_interfaces/Time."""
    sec, nanosec = divmod(stamp_ns, NANO)
    return Time(sec=sec, nanosec=nanosec)


def joint_state_arrays(message: JointState) -> JointStateArrays:
    """Return a JointState as arrays."""
    fields: tuple[array.array[float], ...] = (message.position, message.velocity, message.effort)
    position, velocity, effort = (np.array(field, float) for field in fields)
    return JointStateArrays(
        nanoseconds(message.header.stamp),
        message.header.frame_id,
        tuple(message.name),
        position,
        velocity,
        effort,
    )


def transforms_message(
    stamp_ns: int, parents: Sequence[str], children: Sequence[str], values: Floats
) -> TFMessage:
    """Return transforms as a TFMessage.

    Args:
        stamp_ns: of all of them.
        parents: parent frame of each, N of them.
        children: child frame of each.
        values: (N, 7): translation x y z in metres, rotation x y z w.
    """
    stamp = time_message(stamp_ns)
    return TFMessage(
        transforms=[
            TransformStamped(
                header=Header(stamp=stamp, frame_id=parent),
                child_frame_id=child,
                transform=Transform(
                    translation=Vector3(x=x, y=y, z=z),
                    rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
                ),
            )
            for parent, child, (x, y, z, qx, qy, qz, qw) in zip(
                parents, children, values.tolist(), strict=True
            )
        ]
    )


# Raw CDR messages into arrays, quickly; whatever is not plain CDR, as rclpy does it.

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


def one_joint_state(data: bytes) -> JointStateArrays:
    """Decode a JointState."""
    try:
        return _JOINT_STATES.read(data)
    except WireError:
        return one_joint_state(deserialize_message(data, JointState))


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
    return _filled(_JOINT_STATES.read_known(messages), messages, one_joint_state, complain)


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
