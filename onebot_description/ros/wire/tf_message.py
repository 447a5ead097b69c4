"""``TFMessage``: the tf2_msgs/msg/TFMessage of an installed tf2_msgs, else our own.

Both are the same on the wire: the type's name, hash and description, and every field. Our own is a
message class like the one that rosidl generates from TFMessage.msg; its type support is compiled
(_tf_message.c) and connected with that of geometry_msgs.

rclpy loads the type support with the first publisher, subscription or conversion. Where it cannot
be loaded, that raises an ``OneBotError`` that is also an ``ImportError``.
"""

import ctypes
import logging
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from geometry_msgs.msg import TransformStamped
from rosidl_parser.definition import NamespacedType, UnboundedSequence

from onebot_description.errors import OneBotError
from onebot_description.ros.wire.library import load_library

# The ROS packages whose structures _tf_message.c repeats, and their versions in ROS 2 Jazzy.
_VERSIONS = {
    "rosidl_runtime_c": "4.6.",
    "rosidl_typesupport_introspection_c": "4.6.",
    "rosidl_typesupport_fastrtps_cpp": "3.6.",
}
# rosidl's switch: assigning to a field checks the value's type if it is set to 1.
_CHECK_FIELDS = os.getenv("ROS_PYTHON_CHECK_FIELDS", default="") == "1"


class TypeSupportError(OneBotError, ImportError):
    """TFMessage cannot be used; ``str(error)`` says what to do."""


class Metaclass_TFMessage(type):
    """Holds the type support of the message class, where rclpy looks for it."""

    _CREATE_ROS_MESSAGE: Any = None
    _CONVERT_FROM_PY: Any = None
    _CONVERT_TO_PY: Any = None
    _DESTROY_ROS_MESSAGE: Any = None
    _TYPE_SUPPORT: Any = None

    @classmethod
    def __import_type_support__(cls) -> None:
        """Load the type support, once."""
        if cls._TYPE_SUPPORT is not None:
            return
        library = load_type_support(_OWN)
        cls._CREATE_ROS_MESSAGE = _capsule(library.onebot_tf_create)
        cls._CONVERT_FROM_PY = _capsule(library.onebot_tf_convert_from_py)
        cls._CONVERT_TO_PY = _capsule(library.onebot_tf_convert_to_py)
        cls._DESTROY_ROS_MESSAGE = _capsule(library.onebot_tf_destroy)
        cls._TYPE_SUPPORT = _capsule(library.onebot_tf_handle)


class TFMessage(metaclass=Metaclass_TFMessage):
    """A tf2_msgs/msg/TFMessage: coordinate transforms, as on the topics /tf and /tf_static.

    Args:
        transforms: the transforms, a sequence of ``geometry_msgs.msg.TransformStamped``.
        check_fields: whether assigning to a field asserts that the type is right; by default
            only if the environment variable ``ROS_PYTHON_CHECK_FIELDS`` is 1.
    """

    __slots__ = ["_transforms", "_check_fields"]

    # Tools that show or log any message take its type's name from this.
    __module__ = "tf2_msgs.msg._tf_message"

    _fields_and_field_types: ClassVar[dict[str, str]] = {
        "transforms": "sequence<geometry_msgs/TransformStamped>",
    }
    SLOT_TYPES = (UnboundedSequence(NamespacedType(["geometry_msgs", "msg"], "TransformStamped")),)

    def __init__(self, **kwargs: Any) -> None:
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
        return cls._fields_and_field_types.copy()

    def __repr__(self) -> str:
        """Look like the message that tf2_msgs would provide."""
        return f"tf2_msgs.msg.TFMessage(transforms={self.transforms!r})"

    def __eq__(self, other: object) -> bool:
        """Compare all fields; a message of another class is never equal."""
        return isinstance(other, _OWN) and bool(self.transforms == other.transforms)

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by way of a function, because the module's name is not a real one."""
        return _restore, (self.transforms, self._check_fields)


def _restore(transforms: Sequence[Any], check_fields: bool) -> Any:
    # A genuine tf2_msgs may have come since.
    return TFMessage(transforms=transforms, check_fields=check_fields)


def load_type_support(message_class: type) -> ctypes.PyDLL:
    """Load the library and connect it to the type supports of geometry_msgs and std_msgs.

    ``message_class`` is what received messages become, called without arguments. Raises
    LibraryError if the library is missing or outdated, TypeSupportError if ROS is not Jazzy.
    """
    _check_versions()
    library = load_library()
    _configure(library, message_class)
    return library


def _check_versions() -> None:
    for package, expected in _VERSIONS.items():
        version = _find_version(package)
        if version is not None and not version.startswith(expected):
            raise _unfit(f"{package} is version {version} instead of {expected}x")


def _find_version(package: str) -> str | None:
    """Return the version in an installed package.xml; None if there is no such file.

    importlib.metadata has it as well, but for wheels only, and its import takes 15 ms.
    """
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        try:
            text = Path(prefix, "share", package, "package.xml").read_text(encoding="utf-8")
        except OSError:
            continue
        version = re.search(r"<version>\s*([^<\s]+)", text)
        return version[1] if version else None
    return None


def _unfit(detail: str) -> TypeSupportError:
    return TypeSupportError(
        f"TFMessage is made for ROS 2 Jazzy, and the installed ROS differs: {detail}. "
        "Install the ros-jazzy-* packages that onebot asks for, or the tf2_msgs of the other ROS."
    )


def _configure(library: ctypes.PyDLL, message_class: type) -> None:
    try:
        stamped, count = _import_ros_types()
    except Exception as error:  # rosidl raises bare Exceptions
        raise _unfit(str(error)) from error
    library.onebot_tf_configure.restype = ctypes.c_char_p
    problem = library.onebot_tf_configure(
        _pointer(stamped._TYPE_SUPPORT),
        _pointer(count._TYPE_SUPPORT),
        _pointer(stamped._CONVERT_FROM_PY),
        _pointer(stamped._CONVERT_TO_PY),
        ctypes.py_object(message_class),
    )
    if problem is not None:
        raise _unfit(problem.decode())


def _import_ros_types() -> tuple[Any, Any]:
    """Return the metaclasses of TransformStamped and UInt32, which hold their type supports."""
    from std_msgs.msg import UInt32

    for message_class in (TransformStamped, UInt32):
        if type(message_class)._TYPE_SUPPORT is None:
            type(message_class).__import_type_support__()
        if type(message_class)._TYPE_SUPPORT is None:
            raise ImportError(f"{message_class.__module__} has no type support")
    return type(TransformStamped), type(UInt32)


def _capsule(symbol: Any) -> Any:
    """Wrap the address of a C function or structure, the way rclpy expects it."""
    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p] * 3
    return new(ctypes.cast(symbol, ctypes.c_void_p), None, None)


def _pointer(capsule: Any) -> ctypes.c_void_p:
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return ctypes.c_void_p(get(capsule, None))


def _find_installed() -> Any:
    """Return the class of an installed tf2_msgs; None without one, or if it cannot be used."""
    try:
        from tf2_msgs.msg import TFMessage as Genuine

        if type(Genuine)._TYPE_SUPPORT is None:
            type(Genuine).__import_type_support__()
        return Genuine if type(Genuine)._TYPE_SUPPORT is not None else None
    except ModuleNotFoundError:
        return None
    except Exception as error:  # a failing type support raises bare Exceptions
        logging.getLogger(__name__).debug("tf2_msgs is installed but unusable: %s", error)
        return None


_OWN = TFMessage
if _installed := _find_installed():
    TFMessage = _installed  # type: ignore[misc]
