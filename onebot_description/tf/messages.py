"""ROS messages <-> arrays, for what does not take the raw way."""

import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from onebot_description.tf.state_converter import Transforms
from onebot_description.tf.tf_message import TFMessage
from onebot_description.tf.wire import JointStateArrays, unpack_stamp

_NANO = 1_000_000_000


def joint_state_arrays(message: JointState) -> JointStateArrays:
    """Return a JointState as arrays."""
    stamp = message.header.stamp
    fields: tuple[array.array[float], ...] = (message.position, message.velocity, message.effort)
    position, velocity, effort = (np.array(field, float) for field in fields)
    return JointStateArrays(
        stamp.sec * _NANO + stamp.nanosec,
        message.header.frame_id,
        tuple(message.name),
        position,
        velocity,
        effort,
    )


def to_message(transforms: Transforms) -> TFMessage:
    """Return transforms as a TFMessage of ordinary objects."""
    sec, nanosec = divmod(unpack_stamp(transforms.stamp), _NANO)
    template = transforms.plan.template
    return TFMessage(
        transforms=[
            TransformStamped(
                header=Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=parent),
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
