"""Classes of interfaces by their parsed names."""

from importlib import import_module
from typing import Any

from rosidl_parser.definition import NamespacedType


def import_message_from_namespaced_type(message_type: NamespacedType) -> Any:
    """Return the class of an interface.

    Raises:
        ImportError: there is no such package.
        AttributeError: the package has no such interface.
    """
    return getattr(import_module(".".join(message_type.namespaces)), message_type.name)
