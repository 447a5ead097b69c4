"""Functions that transform stamped points, vectors, poses and polygons.

The header of a result is that of the transform.
"""

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


def to_msg_msg(msg: Any) -> Any:
    """Return the message unchanged."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Return the message unchanged."""
    return msg


def transform_covariance(cov_in: Any, transform: TransformStamped) -> NDArray[np.float64]:
    """Return the covariance (36,) of a pose in the axes of the transform's frame."""
    turn = np.array(_poses.rows_of(_rotation(transform.transform.rotation)))
    blocks = np.asarray(cov_in, float).reshape(2, 3, 2, 3).transpose(0, 2, 1, 3)
    turned = turn @ blocks @ turn.T
    covariance: NDArray[np.float64] = turned.transpose(0, 2, 1, 3).reshape(36)
    return covariance


def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """Return a point in the transform's frame."""
    x, y, z = _moved(point.point, transform)
    return PointStamped(header=transform.header, point=Point(x=x, y=y, z=z))


def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """Return a vector in the transform's axes; it is only rotated."""
    turn = _rotation(transform.transform.rotation)
    x, y, z = _poses.rotate(turn, _triple(vector3.vector))
    return Vector3Stamped(header=transform.header, vector=Vector3(x=x, y=y, z=z))


def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """Return a pose in the transform's frame; its quaternion has w >= 0."""
    x, y, z = _moved(pose.position, transform)
    turn = _poses.multiply(_rotation(transform.transform.rotation), _rotation(pose.orientation))
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
    result = PolygonStamped(header=transform.header)
    for point in polygon.polygon.points:
        x, y, z = _moved(point, transform)
        result.polygon.points.append(Point32(x=x, y=y, z=z))
    return result


def _triple(vector: Any) -> _poses.Triple:
    return vector.x, vector.y, vector.z


def _rotation(quaternion: Any) -> _poses.Quaternion:
    """Return a unit quaternion; the identity for a quaternion of length 0."""
    parts = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    squared = sum(part * part for part in parts)
    if squared < np.finfo(float).eps:
        return 0.0, 0.0, 0.0, 1.0
    x, y, z, w = parts if squared == 1.0 else (part / squared**0.5 for part in parts)
    return x, y, z, w


def _moved(point: Any, transform: TransformStamped) -> _poses.Triple:
    pose = transform.transform
    x, y, z = _poses.rotate(_rotation(pose.rotation), _triple(point))
    return x + pose.translation.x, y + pose.translation.y, z + pose.translation.z


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
