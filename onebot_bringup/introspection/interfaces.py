"""The installed message and service types, their definitions and Python classes.

The types are listed in the ament index; ``tf2_msgs/msg/TFMessage`` is this project's own where
tf2_msgs is not installed.
"""

import importlib
import importlib.util
import os
import re
from functools import cache
from pathlib import Path
from typing import Any

from onebot_description.description.packages import use_environment_prefix
from onebot_description.errors import OneBotError, did_you_mean

_INDEX = "share/ament_index/resource_index/rosidl_interfaces"  # below a prefix
_TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_DELIMITER = "=" * 80  # rosbag2's, between the definitions of types
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z0-9_/]+)(?:<=\d+)?(?:\[[^]]*\])?\s", re.MULTILINE)
_PRIMITIVE = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 string "
    "wstring".split()
)
_KINDS = {"msg": "message", "srv": "service", "action": "action"}


def message_class(name: str) -> Any:
    """Return the class of a message type, by its full or short name, ready for rclpy."""
    full = full_name(name, "msg")
    if full == _TF_MESSAGE:
        from onebot_description.ros.wire.tf_message import TFMessage

        return TFMessage
    return _import(full)


def service_class(name: str) -> Any:
    """Return the class of a service type, with its ``Request`` and ``Response``."""
    return _import(full_name(name, "srv"))


def full_name(name: str, kind: str) -> str:
    """Return ``package/kind/Type`` for a full or short name of an installed msg, srv or action."""
    parts = name.split("/")
    full = f"{parts[0]}/{kind}/{parts[1]}" if len(parts) == 2 else name
    names = installed(kind)
    if full in names:
        return full
    raise OneBotError(f'no {_KINDS[kind]} type "{name}"{_suggestion(full, names)}')


def _suggestion(name: str, types: tuple[str, ...]) -> str:
    """A hint on similar types, also with the same name in another package."""
    package, _, kind = name.rpartition("/")
    package = package.partition("/")[0]
    namesakes = [full for full in types if full.rpartition("/")[2].lower() == kind.lower()]
    if namesakes:
        return f" (did you mean {' or '.join(namesakes)}?)"
    siblings = [full for full in types if full.startswith(f"{package}/")]
    if siblings:
        return did_you_mean(name, siblings, f"in {package}")
    return did_you_mean(name, types, "installed")


@cache
def installed(kind: str) -> tuple[str, ...]:
    """Return the full names of all installed types of a kind (msg, srv, action), sorted."""
    names = {_TF_MESSAGE} if kind == "msg" else set()
    for package, listed in _index():
        if importlib.util.find_spec(package) is None:
            continue  # such as rmw_dds_common: for C++ only
        for line in listed.split():
            folder, _, file = line.rpartition("/")
            if folder == kind:
                names.add(f"{package}/{kind}/{Path(file).stem}")
    return tuple(sorted(names))


def _index() -> list[tuple[str, str]]:
    """Return (package, its index entry) of all packages with interfaces."""
    use_environment_prefix()
    entries: dict[str, str] = {}
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep):
        folder = Path(prefix) / _INDEX
        if folder.is_dir():
            for entry in folder.iterdir():
                entries.setdefault(entry.name, entry.read_text(encoding="utf-8"))
    return sorted(entries.items())


def definition(name: str) -> str:
    """Return the text of the .msg, .srv or .action file that defines a type."""
    package, kind, type_name = name.split("/")
    use_environment_prefix()
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep):
        path = Path(prefix) / "share" / package / kind / f"{type_name}.{kind}"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    if name == _TF_MESSAGE:  # this project has it where tf2_msgs is not installed
        return "geometry_msgs/TransformStamped[] transforms\n"
    raise OneBotError(f"{name} is installed without its file {type_name}.{kind}")


@cache
def full_definition(name: str) -> str:
    """Return the definition of a message type as rosbag2 stores it with the messages.

    The .msg file comes first; those it refers to follow, each once and under a line of its own.
    """
    return _joined(name, set())


def _joined(name: str, seen: set[str]) -> str:
    text = definition(name)
    package = name.partition("/")[0]
    parts = [text]
    for kind in sorted({*_FIELD_TYPE.findall(text)} - _PRIMITIVE):
        full = kind if "/" in kind else f"{package}/{kind}"
        if full not in seen:
            seen.add(full)
            home, _, short = full.rpartition("/")
            nested = _joined(f"{home.partition('/')[0]}/msg/{short}", seen)
            parts.append(f"\n{_DELIMITER}\nMSG: {full}\n{nested}")
    return "".join(parts)


def _import(full: str) -> Any:
    package, kind, name = full.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise OneBotError(f"{full} is installed but cannot be used: {error}") from error


def nested_class(slot: Any) -> Any:
    """Return the class for a ``NamespacedType`` of rosidl, as fields of messages have."""
    return getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)


def is_hidden(name: str) -> bool:
    """Whether a topic or service is hidden by ROS's rule, as what tools use among themselves."""
    return any(part.startswith("_") for part in name.split("/"))
