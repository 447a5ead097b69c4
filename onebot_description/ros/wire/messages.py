"""Converts arrays and times to ROS messages, and bytes to messages of rclpy's classes."""

from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy import serialization
from std_msgs.msg import Header

from onebot_description.arrays import Floats
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.timing import NS_PER_S


def deserialize_message(data: bytes, kind: type) -> Any:
    """Decode a message of the class ``kind`` with rclpy; raise ValueError for all its errors."""
    try:
        return serialization.deserialize_message(data, kind)
    except Exception as error:
        # A place in rclpy's sources follows the reason.
        reason, _, _ = " ".join(str(error).split()).partition("., at /")
        raise ValueError(f"it is not a {kind.__name__}: {reason}") from error


def time_message(stamp_ns: int) -> Time:
    """Return nanoseconds as builtin_interfaces/Time."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return Time(sec=sec, nanosec=nanosec)


def transforms_message(
    stamp: Time, parents: Sequence[str], children: Sequence[str], values: Floats
) -> TFMessage:
    """Return transforms (N, 7) as a TFMessage: x y z in meters, then a quaternion x y z w.

    ``parents`` and ``children`` are the frames of each.
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


def fill_diagonal(covariance: Floats, variances: Sequence[float]) -> None:
    """Write the variances of x, y, z, roll, pitch and yaw into a message's covariance, (36,)."""
    covariance[::7] = variances
