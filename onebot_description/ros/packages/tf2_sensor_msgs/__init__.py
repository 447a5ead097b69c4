"""Transforms point clouds, and registers them with tf2_ros."""

from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud as do_transform_cloud
from tf2_sensor_msgs.tf2_sensor_msgs import transform_points as transform_points
