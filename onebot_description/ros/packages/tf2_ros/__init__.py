"""Transforms between frames for nodes of rclpy, as in the package tf2_ros of Jazzy.

``Buffer`` looks up transforms, ``TransformListener`` fills it from /tf and /tf_static, and
broadcasters publish.
Like the genuine package, it also has the public names of its modules, such as ``TransformStamped``.
"""

# ruff: noqa: F401  (imports are exports)

from typing import Any

from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_ros import (
    buffer,
    buffer_interface,
    transform_broadcaster,
    transform_listener,
)
from tf2_ros.buffer import Buffer
from tf2_ros.buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    NotImplementedException,
    Stamped,
    TransformRegistration,
    TypeException,
    convert,
)
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf2_ros.transform_broadcaster import TransformBroadcaster
from tf2_ros.transform_listener import TransformListener

__all__ = [*(name for name in globals() if name[0].isupper()), "BufferClient"]

_MODULES = (buffer_interface, buffer, transform_listener, transform_broadcaster)


def __getattr__(name: str) -> Any:
    """Return a name of the modules, or the client, whose action is slow to import."""
    import importlib

    if not name.startswith("_"):
        client = importlib.import_module("tf2_ros.buffer_client")
        for module in (client, *_MODULES):
            if name in vars(module):
                return vars(module)[name]
        if name == client.__name__.rpartition(".")[2]:
            return client
    raise AttributeError(f"module 'tf2_ros' has no attribute '{name}'", name=name)
