"""Finds message, service and action types by name, and loads their Python classes.

Installed types are listed in the ament index. This project defines a few itself if no package has
them, see ``onebot_description.ros.wire.interface_text``.
"""

import importlib
import importlib.util
import os
from functools import cache
from pathlib import Path
from typing import Any

from onebot_description.elements.packages import use_environment_prefix
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.wire.interface_text import own_interfaces

_INDEX = "share/ament_index/resource_index/rosidl_interfaces"  # below a prefix
_KINDS = {"msg": "message", "srv": "service", "action": "action"}


def message_class(name: str) -> Any:
    """Return the class of a message type, by its full or short name, ready for rclpy."""
    return _load(full_name(name, "msg"))


def service_class(name: str) -> Any:
    """Return the class of a service type, with its ``Request`` and ``Response``."""
    return _load(full_name(name, "srv"))


def full_name(name: str, kind: str) -> str:
    """Return ``package/kind/Type`` for a full or short name of an installed msg, srv or action."""
    parts = name.split("/")
    full = f"{parts[0]}/{kind}/{parts[1]}" if len(parts) == 2 else name
    names = installed(kind)
    if full in names:
        return full
    end = full.rpartition("/")[2].lower()  # another package may have a type of this name
    namesakes = [full for full in names if full.rpartition("/")[2].lower() == end]
    hint = did_you_mean(full, namesakes or names, "installed")
    raise OneBotError(f'no {_KINDS[kind]} type "{name}"{hint}')


@cache
def installed(kind: str) -> tuple[str, ...]:
    """Return the full names of all types of a kind (msg, srv, action), sorted."""
    names = {*own_interfaces(kind)}
    for package, listed in _index():
        if importlib.util.find_spec(package) is None:
            continue  # such as rmw_dds_common, which is for C++ only
        for line in listed.split():
            folder, _, file = line.rpartition("/")
            if folder == kind:
                names.add(f"{package}/{kind}/{Path(file).stem}")
    return tuple(sorted(names))


def _index() -> list[tuple[str, str]]:
    """Return all packages with interfaces, each with its index entry."""
    use_environment_prefix()
    entries: dict[str, str] = {}
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep):
        folder = Path(prefix) / _INDEX
        if folder.is_dir():
            for entry in folder.iterdir():
                entries.setdefault(entry.name, entry.read_text(encoding="utf-8"))
    return sorted(entries.items())


def _load(full: str) -> Any:
    from onebot_description.ros.wire.interfaces import load_interface

    return load_interface(full)


def is_hidden(name: str) -> bool:
    """Whether a topic or service is hidden by its name, such as those that tools use internally."""
    return any(part.startswith("_") for part in name.split("/"))
