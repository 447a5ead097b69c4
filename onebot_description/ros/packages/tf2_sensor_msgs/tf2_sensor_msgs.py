"""Functions that transform the points of a cloud."""

from copy import deepcopy
from typing import Any

import numpy as np
import tf2_ros
from geometry_msgs.msg import Transform, TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from sensor_msgs_py.point_cloud2 import dtype_from_fields

from onebot_description.geometry import matrices, poses


def to_msg_msg(msg: Any) -> Any:
    """Return the message unchanged."""
    return msg


from_msg_msg = to_msg_msg


def transform_points(point_cloud: NDArray[Any], transform: Transform) -> NDArray[np.float64]:
    """Return points (N, 3) in the transform's frame."""
    at, turn = transform.translation, transform.rotation
    pose = poses.Transform((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w))
    return matrices.transformed(point_cloud, matrices.of_transform(pose))


def do_transform_cloud(cloud: PointCloud2, transform: Transform | TransformStamped) -> PointCloud2:
    """Return a cloud in the transform's frame; fields other than x, y and z are unchanged."""
    assert {"x", "y", "z"} <= {field.name for field in cloud.fields}, (
        "Point cloud needs the fields x, y, and z for the transformation"
    )
    result = deepcopy(cloud)
    if isinstance(transform, TransformStamped):
        result.header.frame_id, transform = transform.header.frame_id, transform.transform
    dtype = dtype_from_fields(cloud.fields, cloud.point_step)
    dtype = dtype.newbyteorder(">" if cloud.is_bigendian else "<")
    points: NDArray[Any] = np.ndarray(cloud.width * cloud.height, dtype, result.data)
    places = np.stack([points[axis] for axis in "xyz"], axis=1)
    for axis, column in zip("xyz", transform_points(places, transform).T, strict=True):
        points[axis] = column
    return result


tf2_ros.ConvertRegistration().add_to_msg(PointCloud2, to_msg_msg)
tf2_ros.ConvertRegistration().add_from_msg(PointCloud2, from_msg_msg)
tf2_ros.TransformRegistration().add(PointCloud2, do_transform_cloud)
