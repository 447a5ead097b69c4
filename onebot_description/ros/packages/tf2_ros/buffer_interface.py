"""The interface of transform buffers, and how types of data are transformed and converted.

A package such as tf2_geometry_msgs registers its types with ``TransformRegistration``.
"""

from collections.abc import Callable
from copy import deepcopy
from typing import Any, ClassVar

from geometry_msgs.msg import (  # noqa: F401  (tf2_ros has these names)
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
)
from rclpy.duration import Duration
from rclpy.time import Time  # noqa: F401
from std_msgs.msg import Header

NO_TIMEOUT = Duration()


class TypeException(Exception):
    """A type is not registered."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A subclass of ``BufferInterface`` lacks a method."""

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


class BufferInterface:
    """A source of transforms, which also transforms data of registered types.

    Subclasses have ``lookup_transform``, ``can_transform``, and both with ``_full``.
    """

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(self, object_stamped, target_frame, timeout=NO_TIMEOUT, new_type=None) -> Any:
        """Return data with a header in another frame, at its own time.

        Args:
            object_stamped: data of a registered type.
            target_frame: the frame to transform into.
            timeout: how long to wait for the transform.
            new_type: the type to convert the result to.

        Raises:
            TypeException: no package has registered the type.
            TransformException: there is no such transform.
        """
        header, do_transform = object_stamped.header, self.registration.get(type(object_stamped))
        transform = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def transform_full(
        self,
        object_stamped,
        target_frame,
        target_time,
        fixed_frame,
        timeout=NO_TIMEOUT,
        new_type=None,
    ) -> Any:
        """Return data with a header in another frame at another time.

        ``fixed_frame`` does not move between the two times; see ``transform``.
        """
        header, do_transform = object_stamped.header, self.registration.get(type(object_stamped))
        transform = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        )
        result = do_transform(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def lookup_transform(self, *args: Any, **kwargs: Any) -> TransformStamped:
        """Return the transform from one frame to another; the subclass has its arguments."""
        raise NotImplementedException()

    lookup_transform_full = can_transform = can_transform_full = lookup_transform


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:  # noqa: N802
    """Give an object a header, and return it."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


class _Functions(dict[Any, Callable[..., Any]]):
    """Functions by the types of data that they are for."""

    def __missing__(self, key: Any) -> Any:
        raise TypeException(f"Type {key} is not loaded or supported")


class TransformRegistration:
    """The functions that transform data, by its type; one table for all instances."""

    _functions: ClassVar = _Functions()

    def print_me(self) -> None:
        """Print the table."""
        print(self._functions)

    def add(self, key: Any, callback: Callable[..., Any]) -> None:
        """Register the function for a type."""
        self._functions[key] = callback

    def get(self, key: Any) -> Callable[..., Any]:
        """Return the function for a type.

        Raises:
            TypeException: there is none.
        """
        return self._functions[key]


class ConvertRegistration:
    """The functions that convert data, by types; one table for all instances."""

    _to_msg, _from_msg, _convert = _Functions(), _Functions(), _Functions()

    def add_from_msg(self, key: Any, callback: Callable[..., Any]) -> None:
        """Register the function that converts a message to a type."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: Any, callback: Callable[..., Any]) -> None:
        """Register the function that converts a type to a message."""
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[Any, Any], callback: Callable[..., Any]) -> None:
        """Register the function that converts the first type to the second."""
        self._convert[key] = callback

    def get_from_msg(self, key: Any) -> Callable[..., Any]:
        """Return the function that converts a message to a type."""
        return self._from_msg[key]

    def get_to_msg(self, key: Any) -> Callable[..., Any]:
        """Return the function that converts a type to a message."""
        return self._to_msg[key]

    def get_convert(self, key: tuple[Any, Any]) -> Callable[..., Any]:
        """Return the function that converts the first type to the second."""
        return self._convert[key]


def convert(a: Any, b_type: Any) -> Any:
    """Convert an object to another type, through a message if there is no direct conversion."""
    registration = ConvertRegistration()
    try:
        return registration.get_convert((type(a), b_type))(a)
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
    return registration.get_from_msg(b_type)(registration.get_to_msg(type(a))(a))
