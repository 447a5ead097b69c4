"""Transforms messages of geometry_msgs, and registers them with tf2_ros.

Like the genuine package, it also has the names of these messages.
"""

from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403
