"""Finds the text that defines an interface, as ROS calls a message, service or action type.

An installed package has it in its share folder, as .msg, .srv or .action file. Those of tf2_msgs,
ackermann_msgs, control_msgs, map_msgs and simulation_interfaces, which no wheel has, are in the
folder ``definitions`` here; their names and types, which the type hash is made of, are those of ROS
2 Jazzy. ``common_definitions`` has those messages of installed packages that drawing a description
takes, for where there is no ROS.
"""

import functools
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from onebot_description.errors import OneBotError
from onebot_description.ros.wire.definition import NUMBERS, STRINGS, fields, section

_OWN = Path(__file__).parents[1] / "packages"
_COMMON = Path(__file__).with_name("common_definitions")


@functools.cache
def own_interfaces(kind: str) -> tuple[str, ...]:
    """List the full names of the interfaces of a kind (msg, srv, action) that are defined here."""
    paths = sorted(_OWN.glob(f"*/{kind}/*.{kind}"))
    return tuple(f"{path.parts[-3]}/{kind}/{path.stem}" for path in paths)


def interface_text(name: str) -> str:
    """Return the text of the file that defines an interface, such as ``std_srvs/srv/Trigger``.

    Raises:
        OneBotError: there is no such interface.
    """
    package, kind, type_name = name.split("/")
    for folder in (*share_folders(), _OWN, _COMMON):
        try:
            return (folder / package / kind / f"{type_name}.{kind}").read_text(encoding="utf-8")
        except (FileNotFoundError, NotADirectoryError):
            continue
    raise OneBotError(f"{name} is installed without its file {type_name}.{kind}")


def share_folders() -> Iterator[Path]:
    """List the share folders of installed ROS packages, the preferred one first."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    yield from (Path(prefix, "share") for prefix in filter(None, prefixes))


@functools.cache
def full_definition(name: str) -> str:
    """Return the definition of a message type as rosbag2 stores it with the messages.

    The .msg file comes first; those it refers to follow, each once and under a line of its own.
    """
    return _joined(name, set())


def _joined(name: str, seen: set[str]) -> str:
    text = interface_text(name)
    parts = [text]
    for kind in sorted({field.type for field in fields(name, text)} - {*NUMBERS, *STRINGS}):
        if kind not in seen:
            seen.add(kind)
            parts.append(section(kind, _joined(kind.replace("/", "/msg/"), seen)))
    return "".join(parts)
