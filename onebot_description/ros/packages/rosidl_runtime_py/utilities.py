"""Classes of interfaces by their names, such as std_msgs/msg/String."""

from functools import partial
from typing import Any

from rosidl_parser.definition import NamespacedType
from rosidl_runtime_py.import_message import import_message_from_namespaced_type


def get_interface(identifier: str) -> Any:
    """Return the class of an interface by its full name."""
    return import_message_from_namespaced_type(get_namespaced_type(identifier))


def get_message(identifier: str) -> Any:
    """Return the class of a message; its name may leave out ``msg/``.

    Raises:
        ValueError: it is another kind of interface.
    """
    return _checked(identifier, get_message_namespaced_type(identifier), is_message, "a message")


def get_service(identifier: str) -> Any:
    """Return the class of a service; its name may leave out ``srv/``."""
    return _checked(identifier, get_service_namespaced_type(identifier), is_service, "a service")


def get_action(identifier: str) -> Any:
    """Return the class of an action; its name may leave out ``action/``."""
    return _checked(identifier, get_action_namespaced_type(identifier), is_action, "an action")


def get_namespaced_type(identifier: str, kind: str = "") -> NamespacedType:
    """Return a name as a type of rosidl_parser; ``kind`` is the folder that it may leave out."""
    *namespaces, name = identifier.split("/")
    left_out = [kind] if kind and len(namespaces) == 1 else []
    return NamespacedType([*namespaces, *left_out], name)


get_message_namespaced_type = partial(get_namespaced_type, kind="msg")
get_service_namespaced_type = partial(get_namespaced_type, kind="srv")
get_action_namespaced_type = partial(get_namespaced_type, kind="action")


def is_message(interface: Any) -> bool:
    """Return whether a class is a message."""
    return hasattr(interface, "SLOT_TYPES")


def is_service(interface: Any) -> bool:
    """Return whether a class is a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    """Return whether a class is an action."""
    return all(hasattr(interface, name) for name in ("Goal", "Result", "Feedback"))


def _checked(identifier: str, full: NamespacedType, is_kind: Any, kind: str) -> Any:
    interface = import_message_from_namespaced_type(full)
    if not is_kind(interface):
        raise ValueError(f"Expected the full name of {kind}, got '{identifier}'")
    return interface
