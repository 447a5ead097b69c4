"""ROS messages as arrays, and arrays as ROS messages.

Messages come as bytes. Plain CDR is read in place (see ``cdr``), without objects between; any other
encoding is deserialized by rclpy, to the same result.
"""

from collections.abc import Callable, Sequence
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
    DOUBLES_PER_TRANSFORM,
    NANO,
    Floats,
    Reader,
    WireError,
    nanoseconds,
)
from onebot_description.wire.remembered import Remembered, size_of_names
from onebot_description.wire.tf_message import TFMessage

T = TypeVar("T")

BAD_MESSAGE = (ValueError, IndexError)  # what is raised for bytes that are no such message

_COVARIANCE = 36
_UNKNOWN: Floats = np.zeros(_COVARIANCE)


class TfArrays(NamedTuple):
    """A TFMessage; one row a transform."""

    parents: list[str]  # header.frame_id of each transform, N of them
    children: list[str]  # child_frame_id of each
    stamps_ns: NDArray[np.int64]  # (N,) nanoseconds
    translations: Floats  # (N, 3) metres
    rotations: Floats  # (N, 4) quaternions x y z w


class JointStateArrays(NamedTuple):
    """A JointState; a field that was left empty has shape (0,)."""

    stamp_ns: int
    frame_id: str
    names: tuple[str, ...]
    positions: Floats  # radians or metres
    velocities: Floats  # radians or metres a second
    efforts: Floats  # newton metres or newtons


class TwistSample(NamedTuple):
    """A velocity."""

    stamp_ns: int  # 0 in a message without one
    linear: Floats  # (3,) metres a second
    angular: Floats  # (3,) radians a second


class OdometrySample(NamedTuple):
    """An Odometry message without the covariance of its velocities."""

    stamp_ns: int
    frame_id: str  # in which the pose is given
    child_frame_id: str  # the frame that moves, in which the velocities are given
    translation: Floats  # (3,) metres
    rotation: Floats  # (4,) quaternion x y z w
    linear: Floats  # (3,) metres a second
    angular: Floats  # (3,) radians a second
    # (36,) of the pose, row by row: x, y, z in m, the angles about x, y, z in rad
    covariance: Floats = _UNKNOWN


# From plain CDR. Each raises WireError where the bytes are no whole message in it; the arrays are
# views into the bytes where they can be.


def decode_tf(data: bytes) -> TfArrays:
    """Read a serialized tf2_msgs/msg/TFMessage. The lists of names may not be changed."""
    reader = Reader(data)
    names, stamps, values = reader.transforms(reader.count(4 * DOUBLES_PER_TRANSFORM))
    return TfArrays(*_parents_and_children(names), stamps, values[:, :3], values[:, 3:])


def _frames(names: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Return the parents and the children of names that alternate."""
    return list(names[::2]), list(names[1::2])


_parents_and_children = Remembered(_frames, size_of_names)


def decode_joint_state(data: bytes) -> JointStateArrays:
    """Read a serialized sensor_msgs/msg/JointState."""
    reader = Reader(data)
    stamp, frame_id = reader.stamp_ns(), reader.string()
    names = reader.strings(reader.count(4))
    fields = [reader.doubles(reader.count(8)) for _ in range(3)]
    return JointStateArrays(stamp, frame_id, names, *fields)


def decode_odometry(data: bytes) -> OdometrySample:
    """Read a serialized nav_msgs/msg/Odometry."""
    reader = Reader(data)
    stamp, frame, child = reader.stamp_ns(), reader.string(), reader.string()
    pose = reader.doubles(7 + _COVARIANCE)
    twist = reader.doubles(6 + _COVARIANCE)
    return OdometrySample(stamp, frame, child, pose[:3], pose[3:7], twist[:3], twist[3:6], pose[7:])


def decode_twist(data: bytes) -> TwistSample:
    """Read a serialized geometry_msgs/msg/Twist."""
    twist = Reader(data).doubles(6)
    return TwistSample(0, twist[:3], twist[3:])


def decode_twist_stamped(data: bytes) -> TwistSample:
    """Read a serialized geometry_msgs/msg/TwistStamped."""
    reader = Reader(data)
    stamp = reader.stamp_ns()
    reader.string()
    twist = reader.doubles(6)
    return TwistSample(stamp, twist[:3], twist[3:])


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


def joint_state_arrays(message: JointState) -> JointStateArrays:
    """Return a JointState as arrays."""
    fields = (message.position, message.velocity, message.effort)
    return JointStateArrays(
        nanoseconds(message.header.stamp),
        message.header.frame_id,
        tuple(message.name),
        *(np.array(field, float) for field in fields),
    )


def _tf_arrays(message: TFMessage) -> TfArrays:
    transforms = message.transforms
    shifts = [t.transform.translation for t in transforms]
    turns = [t.transform.rotation for t in transforms]
    return TfArrays(
        [t.header.frame_id for t in transforms],
        [t.child_frame_id for t in transforms],
        np.array([nanoseconds(t.header.stamp) for t in transforms], np.int64),
        np.array([(v.x, v.y, v.z) for v in shifts], float).reshape(-1, 3),
        np.array([(q.x, q.y, q.z, q.w) for q in turns], float).reshape(-1, 4),
    )


def _odometry_sample(message: Odometry) -> OdometrySample:
    pose, twist = message.pose.pose, message.twist.twist
    turn = pose.orientation
    return OdometrySample(
        nanoseconds(message.header.stamp),
        message.header.frame_id,
        message.child_frame_id,
        _vector(pose.position),
        np.array([turn.x, turn.y, turn.z, turn.w], float),
        _vector(twist.linear),
        _vector(twist.angular),
        np.array(message.pose.covariance, float),
    )


def _twist_sample(message: Twist, stamp_ns: int = 0) -> TwistSample:
    return TwistSample(stamp_ns, _vector(message.linear), _vector(message.angular))


def _twist_stamped_sample(message: TwistStamped) -> TwistSample:
    return _twist_sample(message.twist, nanoseconds(message.header.stamp))


def _vector(vector: Any) -> Floats:
    return np.array([vector.x, vector.y, vector.z], float)


def _read(data: bytes, decode: Callable[[bytes], T], kind: type, convert: Callable[[Any], T]) -> T:
    try:
        return decode(data)
    except WireError:
        return convert(deserialize_message(data, kind))


def tf_arrays(data: bytes) -> TfArrays:
    """Read a TFMessage; the lists of names may not be changed."""
    return _read(data, decode_tf, TFMessage, _tf_arrays)


def one_joint_state(data: bytes) -> JointStateArrays:
    """Read a JointState."""
    return _read(data, decode_joint_state, JointState, joint_state_arrays)


def odometry_sample(data: bytes) -> OdometrySample:
    """Read an Odometry."""
    return _read(data, decode_odometry, Odometry, _odometry_sample)


def twist_sample(data: bytes) -> TwistSample:
    """Read a Twist, which has no stamp: its time is 0."""
    return _read(data, decode_twist, Twist, _twist_sample)


def twist_stamped_sample(data: bytes) -> TwistSample:
    """Read a TwistStamped."""
    return _read(data, decode_twist_stamped, TwistStamped, _twist_stamped_sample)


def time_message(stamp_ns: int) -> Time:
    """Return nanoseconds as builtin_interfaces/Time."""
    sec, nanosec = divmod(stamp_ns, NANO)
    return Time(sec=sec, nanosec=nanosec)


def transforms_message(
    stamp: Time, parents: Sequence[str], children: Sequence[str], values: Floats
) -> TFMessage:
    """Return transforms as a TFMessage.

    Args:
        stamp: of all of them.
        parents: parent frame of each, N of them.
        children: child frame of each.
        values: (N, 7): translation x y z in metres, rotation x y z w.
    """
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
