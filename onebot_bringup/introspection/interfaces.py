"""Finds message, service and action types by name, and loads their Python classes."""

from typing import Any

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.wire.interface_text import installed_interfaces

_KINDS = {"msg": "message", "srv": "service", "action": "action"}


def message_class(name: str) -> Any:
    """Return the class of a message type, by its full or short name, ready for rclpy."""
    from onebot_description.ros.wire.interfaces import load_interface

    return load_interface(full_name(name, "msg"))


def service_class(name: str) -> Any:
    """Return the class of a service type, with its ``Request`` and ``Response``."""
    from onebot_description.ros.wire.interfaces import load_interface

    return load_interface(full_name(name, "srv"))


def full_name(name: str, kind: str) -> str:
    """Return ``package/kind/Type`` for a full or short name of an installed msg, srv or action."""
    parts = name.split("/")
    full = f"{parts[0]}/{kind}/{parts[1]}" if len(parts) == 2 else name
    names = installed_interfaces(kind)
    if full in names:
        return full
    end = full.rpartition("/")[2].lower()  # another package may have a type of this name
    namesakes = [full for full in names if full.rpartition("/")[2].lower() == end]
    hint = did_you_mean(full, namesakes or names, "installed")
    raise OneBotError(f'no {_KINDS[kind]} type "{name}"{hint}')


def is_hidden(name: str) -> bool:
    """Whether a topic or service is hidden by its name, such as those that tools use internally."""
    return any(part.startswith("_") for part in name.split("/"))
