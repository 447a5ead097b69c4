"""Transforms between frames for nodes of rclpy, as in the package tf2_ros of Jazzy.

``Buffer`` looks up transforms, ``TransformListener`` fills it from /tf and /tf_static, and
broadcasters publish.
Like the genuine package, it also has the public names of its modules, such as ``TransformStamped``.
"""

# ruff: noqa: F401, F403  (imports are exports)

import importlib
from typing import Any

from tf2_py import *
from tf2_ros.buffer import *
from tf2_ros.buffer_interface import *
from tf2_ros.static_transform_broadcaster import *
from tf2_ros.transform_broadcaster import *
from tf2_ros.transform_listener import *

from onebot_description.ros.packages.late_attributes import provide


def _client(name: str) -> Any:
    """Return the client of a buffer, whose action is slow to import."""
    module = importlib.import_module("tf2_ros.buffer_client")
    return getattr(module, name, module)


provide("tf2_ros", ["BufferClient", "buffer_client"], _client)
