"""Finds the text that defines an interface, as ROS calls a message, service or action type.

An installed package has it in its share folder, as a .msg, .srv or .action file. Packages without
wheels are folders of ``onebot_description/ros/packages``; their names and types, from which the
type hash is made, are those of ROS 2 Jazzy. A user's own packages are in ``ROS_PACKAGE_PATH``, or
were added by ``onebot interface add``. ``common_definitions`` has the messages of installed
packages that are needed to draw a description without ROS.
"""

import functools
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from onebot_description.elements.packages import packages_on_ros_path
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.definition import NUMBERS, STRINGS, fields, section

KINDS = ("msg", "srv", "action")  # folders of a package, and their files' suffixes
ADDED = Path(sys.prefix, "share/onebot_interfaces")  # has a link to each package that was added
_HERE = Path(__file__).parents[1] / "packages"
_INDEX = "ament_index/resource_index/rosidl_interfaces"  # below a share folder
_COMMON = Path(__file__).with_name("common_definitions")


def own_packages() -> dict[str, Path]:
    """Return the folders of the packages that are made from definitions, by name."""
    rooms = [room for room in (ADDED, _HERE) if room.is_dir()]
    names = {*packages_on_ros_path(), *(folder.name for room in rooms for folder in room.iterdir())}
    return {name: folder for name in sorted(names) if (folder := own_package(name))}


def own_package(name: str) -> Path | None:
    """Return the folder of a package of definitions; None if there is none.

    A user's own package takes precedence.
    """
    folders = (packages_on_ros_path().get(name), ADDED / name, _HERE / name)
    return next((folder for folder in folders if folder and any(definitions(folder))), None)


def definitions(folder: Path, kinds: Sequence[str] = KINDS) -> Iterator[Path]:
    """Yield the files of a package that define interfaces."""
    for kind in kinds:
        if (inner := folder / kind).is_dir():
            yield from sorted(inner.glob(f"*.{kind}"))


@functools.cache
def own_interfaces(kind: str) -> tuple[str, ...]:
    """Return the full names of our own interfaces of a kind (msg, srv, action)."""
    return tuple(
        f"{package}/{kind}/{file.stem}"
        for package, folder in own_packages().items()
        for file in definitions(folder, [kind])
    )


@functools.cache
def installed_interfaces(kind: str) -> tuple[str, ...]:
    """Return the full names of all interfaces of a kind (msg, srv, action), sorted."""
    entries = [file for share in share_folders() for file in (share / _INDEX).glob("*")]
    packages = {file.name: file for file in reversed(entries)}
    names = {*own_interfaces(kind)}
    for package, file in packages.items():
        if importlib.util.find_spec(package):  # some are for C++ only
            lines = map(Path, file.read_text(encoding="utf-8").split())
            names |= {f"{package}/{kind}/{line.stem}" for line in lines if line.parts[0] == kind}
    return tuple(sorted(names))


def interface_text(name: str) -> str:
    """Return the text of the file that defines an interface, such as ``std_srvs/srv/Trigger``.

    Raises:
        OneBotError: there is no such interface.
    """
    return interface_file(name).read_text(encoding="utf-8")


def interface_file(name: str) -> Path:
    """Return the file that defines an interface.

    Raises:
        OneBotError: there is no such interface.
    """
    package, kind, type_name = name.split("/")
    inner = f"{kind}/{type_name}.{kind}"
    for folder in (*(share / package for share in share_folders()), _COMMON / package):
        if (folder / inner).is_file():
            return folder / inner
    if own_definition := own_file(name):
        return own_definition
    raise OneBotError(f"{name} is installed without its file {type_name}.{kind}")


def own_file(name: str) -> Path | None:
    """Return the file of an interface of a package that is made from definitions."""
    package, kind, type_name = name.split("/")
    folder = own_package(package)
    file = folder and folder / kind / f"{type_name}.{kind}"
    return file.resolve() if file and file.is_file() else None


def share_folders() -> Iterator[Path]:
    """Yield the share folders of installed ROS packages, the preferred one first."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    yield from (Path(prefix, "share") for prefix in filter(None, prefixes))


@functools.cache
def full_definition(name: str) -> str:
    """Return the definition of a message type as rosbag2 stores it with the messages.

    The .msg file comes first; the files it refers to follow, each once and after its own header.
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
