"""Serialized ROS messages as arrays, which ``Schema`` reads in place; no ROS is needed."""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interface_text import full_definition
from onebot_description.ros.wire.schema import Schema
from onebot_description.timing import NS_PER_S

BAD_MESSAGE = (ValueError, IndexError)  # raised for bytes that are no such message

# Bytes; nothing of a larger message is cached, as publishers decide how large they are.
LARGEST_KEPT = 2**19

_COVARIANCE = 36
_UNKNOWN: Floats = np.zeros(_COVARIANCE)


class TfArrays(NamedTuple):
    """A TFMessage, with one row per transform."""

    parents: tuple[str, ...]  # header.frame_id of each transform, N of them
    children: tuple[str, ...]  # child_frame_id of each
    stamps_ns: NDArray[np.int64]  # (N,) nanoseconds
    translations: Floats  # (N, 3) meters
    rotations: Floats  # (N, 4) quaternions x y z w


class JointStateArrays(NamedTuple):
    """A JointState; an empty field has shape (0,)."""

    stamp_ns: int
    frame_id: str
    names: tuple[str, ...]
    positions: Floats  # radians or meters
    velocities: Floats  # radians or meters a second
    efforts: Floats  # newton meters or newtons


class OdometrySample(NamedTuple):
    """An Odometry message without the covariance of its velocities."""

    stamp_ns: int
    frame_id: str  # the pose's frame
    child_frame_id: str  # the moving frame, in which the velocities are given
    translation: Floats  # (3,) meters
    rotation: Floats  # (4,) quaternion x y z w
    linear: Floats  # (3,) meters a second
    angular: Floats  # (3,) radians a second
    # (36,) of the pose, row by row: x, y, z in m, the angles about x, y, z in rad
    covariance: Floats = _UNKNOWN


@functools.cache
def known_schema(name: str) -> Schema:
    """Return the schema of a type that is always available, such as nav_msgs/msg/Odometry."""
    return Schema(name, full_definition(name))


# These raise WireError if the bytes are not a whole message of plain little-endian CDR. The arrays
# are views into the bytes where possible.


def tf_arrays(data: bytes) -> TfArrays:
    """Read a serialized tf2_msgs/msg/TFMessage; equal names are the same tuples.

    Leading slashes, which names had before tf2, are removed.
    """
    transforms = known_schema("tf2_msgs/msg/TFMessage").read(data).transforms
    header = transforms.header
    values = transforms.transform.array()
    stamps = header.stamp.sec.astype(np.int64) * NS_PER_S + header.stamp.nanosec
    bare = _bare if len(data) <= LARGEST_KEPT else _bare.__wrapped__
    names = bare(tuple(header.frame_id)), bare(tuple(transforms.child_frame_id))
    return TfArrays(*names, stamps, values[:, :3], values[:, 3:])


@functools.lru_cache(maxsize=128)
def _bare(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name.removeprefix("/") for name in names)


def one_joint_state(data: bytes) -> JointStateArrays:
    """Read a serialized sensor_msgs/msg/JointState."""
    state = known_schema("sensor_msgs/msg/JointState").read(data)
    fields = state.position, state.velocity, state.effort
    stamp_ns = nanoseconds(state.header.stamp)
    return JointStateArrays(stamp_ns, state.header.frame_id, tuple(state.name), *fields)


def odometry_sample(data: bytes) -> OdometrySample:
    """Read a serialized nav_msgs/msg/Odometry."""
    message = known_schema("nav_msgs/msg/Odometry").read(data)
    pose = message.pose.pose.array()
    twist = message.twist.twist
    return OdometrySample(
        stamp_ns=nanoseconds(message.header.stamp),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
        translation=pose[:3],
        rotation=pose[3:],
        linear=twist.linear.array(),
        angular=twist.angular.array(),
        covariance=message.pose.covariance,
    )
