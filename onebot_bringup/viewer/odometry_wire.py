"""CDR bytes to numbers, for what drives: Odometry, Twist and TwistStamped.

The layout, and what WireError means, are those of ``onebot_description.tf.wire``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.tf.wire import Reader

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
