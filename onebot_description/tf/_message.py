"""The message class, which is like the one that rosidl generates from TFMessage.msg."""

import os
from collections.abc import Sequence
from typing import Any, ClassVar

from geometry_msgs.msg import TransformStamped
from rosidl_parser.definition import NamespacedType, UnboundedSequence

from onebot_description.tf import _type_support

# rosidl's switch: assigning to a field checks the value's type if it is set to 1.
_CHECK_FIELDS = os.getenv("ROS_PYTHON_CHECK_FIELDS", default="") == "1"


class Metaclass_TFMessage(type):
    """Where rclpy looks for the type support of a message class, under these names."""

    _CREATE_ROS_MESSAGE: Any = None
    _CONVERT_FROM_PY: Any = None
    _CONVERT_TO_PY: Any = None
    _DESTROY_ROS_MESSAGE: Any = None
    _TYPE_SUPPORT: Any = None

    @classmethod
    def __import_type_support__(cls) -> None:
        """Load the type support, once.

        Raises:
            TypeSupportError: it is not built, or the installed ROS is not the one it is made for.
        """
        if cls._TYPE_SUPPORT is not None:
            return
        support = _type_support.load(TFMessage)
        cls._CREATE_ROS_MESSAGE = support.create_ros_message
        cls._CONVERT_FROM_PY = support.convert_from_py
        cls._CONVERT_TO_PY = support.convert_to_py
        cls._DESTROY_ROS_MESSAGE = support.destroy_ros_message
        cls._TYPE_SUPPORT = support.type_support
        try:
            _type_support.check(TFMessage)
        except BaseException:
            cls._TYPE_SUPPORT = None
            raise


class TFMessage(metaclass=Metaclass_TFMessage):
    """A tf2_msgs/msg/TFMessage: coordinate transforms, as on the topics /tf and /tf_static.

    Args:
        transforms: the transforms, a sequence of ``geometry_msgs.msg.TransformStamped``.
        check_fields: whether assigning to a field asserts that the type is right; by default
            only if the environment variable ``ROS_PYTHON_CHECK_FIELDS`` is 1.
    """

    __slots__ = ["_transforms", "_check_fields"]

    # Tools that show or log any message take its type's name from the module's name.
    __module__ = "tf2_msgs.msg._tf_message"

    _fields_and_field_types: ClassVar[dict[str, str]] = {
        "transforms": "sequence<geometry_msgs/TransformStamped>",
    }
    SLOT_TYPES = (UnboundedSequence(NamespacedType(["geometry_msgs", "msg"], "TransformStamped")),)

    def __init__(self, **kwargs: Any) -> None:
        """Take the fields' values, as keyword arguments; a field left out is empty."""
        self._check_fields = kwargs.get("check_fields", _CHECK_FIELDS)
        if self._check_fields:
            unknown = [key for key in kwargs if f"_{key}" not in self.__slots__]
            assert not unknown, (
                f"Invalid arguments passed to constructor: {', '.join(sorted(unknown))}"
            )
        self.transforms = kwargs.get("transforms", [])

    @property
    def transforms(self) -> Sequence[Any]:
        """Message field 'transforms'."""
        return self._transforms

    @transforms.setter
    def transforms(self, value: Sequence[Any]) -> None:
        if self._check_fields:
            assert (
                not isinstance(value, str)
                and hasattr(value, "__len__")
                and hasattr(value, "__iter__")
                and all(isinstance(item, TransformStamped) for item in value)
            ), (
                "The 'transforms' field must be a set or sequence and each value of type "
                "'TransformStamped'"
            )
        self._transforms = value

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the name and the type of each field."""
        return cls._fields_and_field_types.copy()

    def __repr__(self) -> str:
        """Look like the message that tf2_msgs would provide."""
        return f"tf2_msgs.msg.TFMessage(transforms={self.transforms!r})"

    def __eq__(self, other: object) -> bool:
        """Compare all fields; a message of another class is never equal."""
        return isinstance(other, TFMessage) and bool(self.transforms == other.transforms)

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by way of a function, because the module's name is not a real one."""
        return _restore, (self.transforms, self._check_fields)


def _restore(transforms: Sequence[Any], check_fields: bool) -> Any:
    # A genuine tf2_msgs may have come since.
    from onebot_description.tf import tf_message

    return tf_message.TFMessage(transforms=transforms, check_fields=check_fields)
