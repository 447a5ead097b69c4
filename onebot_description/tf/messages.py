"""ROS messages <-> arrays, for what does not take the raw way."""

from __future__ import annotations

import array
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.stamps import NANO, nanoseconds
from onebot_description.tf.tf_message import TFMessage
from onebot_description.tf.wire import JointStateArrays, unpack_stamp

if TYPE_CHECKING:
    # Who only sends messages needs no model of the robot.
    from onebot_description.tf.state_converter import Transforms


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


def to_message(transforms: Transforms) -> TFMessage:
    """Return transforms as a TFMessage of ordinary objects."""
    stamp = time_message(unpack_stamp(transforms.stamp))
    template = transforms.plan.template
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
                template.parents, template.children, transforms.values.tolist(), strict=True
            )
        ]
    )
