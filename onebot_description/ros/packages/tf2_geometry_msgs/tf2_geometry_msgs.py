"""Functions that transform stamped points, vectors, poses and polygons.

The header of a result is that of the transform.
"""

import math
from typing import Any

import numpy as np
import tf2_ros
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from numpy.typing import NDArray

from onebot_description.geometry import poses as _poses
from onebot_description.geometry import quaternions as _quaternions


def to_msg_msg(msg: Any) -> Any:
    """Return the message unchanged."""
    return msg


from_msg_msg = to_msg_msg


def transform_covariance(cov_in: Any, transform: TransformStamped) -> NDArray[np.float64]:
    """Return the covariance (36,) of a pose in the axes of the transform's frame."""
    turn = _quaternions.to_matrix(_pose(transform).rotation)
    blocks = np.asarray(cov_in, float).reshape(2, 3, 2, 3).transpose(0, 2, 1, 3)
    turned = turn @ blocks @ turn.T
    covariance: NDArray[np.float64] = turned.transpose(0, 2, 1, 3).reshape(36)
    return covariance


def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """Return a point in the transform's frame."""
    x, y, z = _pose(transform).at(_triple(point.point))
    return PointStamped(header=transform.header, point=Point(x=x, y=y, z=z))


def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """Return a vector in the transform's axes; it is only rotated."""
    x, y, z = _poses.rotate(_pose(transform).rotation, _triple(vector3.vector))
    return Vector3Stamped(header=transform.header, vector=Vector3(x=x, y=y, z=z))


def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """Return a pose in the transform's frame; its quaternion has w >= 0."""
    inner = _poses.Transform(_triple(pose.position), _rotation(pose.orientation))
    (x, y, z), turn = _poses.compose(_pose(transform), inner)
    a, b, c, w = turn if turn[3] >= 0.0 else (-part for part in turn)
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=w))


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Return a stamped pose in the transform's frame."""
    return PoseStamped(header=transform.header, pose=do_transform_pose(pose.pose, transform))


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """Return a pose and its covariance in the transform's frame."""
    result = PoseWithCovarianceStamped(header=transform.header)
    result.pose.pose = do_transform_pose(pose.pose.pose, transform)
    result.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    return result


def do_transform_polygon_stamped(
    polygon: PolygonStamped, transform: TransformStamped
) -> PolygonStamped:
    """Return a polygon in the transform's frame."""
    result, pose = PolygonStamped(header=transform.header), _pose(transform)
    for point in polygon.polygon.points:
        x, y, z = pose.at(_triple(point))
        result.polygon.points.append(Point32(x=x, y=y, z=z))
    return result


def _triple(vector: Any) -> _poses.Triple:
    return vector.x, vector.y, vector.z


def _rotation(quaternion: Any) -> _poses.Quaternion:
    """Return a unit quaternion; the identity for a quaternion of length 0."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    length = math.hypot(x, y, z, w)
    return (x / length, y / length, z / length, w / length) if length else (0.0, 0.0, 0.0, 1.0)


def _pose(stamped: TransformStamped) -> _poses.Transform:
    transform = stamped.transform
    return _poses.Transform(_triple(transform.translation), _rotation(transform.rotation))


for _type in (Vector3Stamped, PoseStamped, PointStamped):
    tf2_ros.ConvertRegistration().add_to_msg(_type, to_msg_msg)
    tf2_ros.ConvertRegistration().add_from_msg(_type, from_msg_msg)
for _type, _function in (
    (PointStamped, do_transform_point),
    (Vector3Stamped, do_transform_vector3),
    (PoseStamped, do_transform_pose_stamped),
    (PoseWithCovarianceStamped, do_transform_pose_with_covariance_stamped),
    (PolygonStamped, do_transform_polygon_stamped),
):
    tf2_ros.TransformRegistration().add(_type, _function)
