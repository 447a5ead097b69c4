"""``onebot interface ...``: lists the installed types, shows their fields, adds your own."""

import re
import shutil
import sysconfig
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from onebot_bringup.cli.options import Subcommand, flag, positional
from onebot_bringup.introspection.interfaces import full_name
from onebot_description.elements.packages import package_name
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.packages import origin
from onebot_description.ros.packages.stubs import write_stubs
from onebot_description.ros.wire.definition import fields
from onebot_description.ros.wire.interface_text import (
    ADDED,
    KINDS,
    definitions,
    installed_interfaces,
    interface_text,
    own_packages,
)

_TITLES = (("Messages", "msg"), ("Services", "srv"), ("Actions", "action"))
_SITE = Path(sysconfig.get_path("purelib"))  # editors look for stubs here
_SEPARATOR = "---"  # between request and response


def list_types(_: Namespace) -> None:
    """List the types."""
    for title, kind in _TITLES:
        print(f"{title}:")
        print("".join(f"    {name}\n" for name in installed_interfaces(kind)), end="")


def show(args: Namespace) -> None:
    """Show the fields of a type."""
    for line in _lines(_find(args.type), not args.no_comments, ""):
        print(line)


def _find(name: str) -> str:
    for _, kind in _TITLES:
        try:
            return full_name(name, kind)
        except OneBotError:
            continue
    types = [full for _, kind in _TITLES for full in installed_interfaces(kind)]
    raise OneBotError(f'no type "{name}"{did_you_mean(name, types, "installed")}')


def _lines(name: str, comments: bool, indent: str) -> Iterator[str]:
    for line in interface_text(name).splitlines():
        text = (line if comments else line.partition("#")[0]).rstrip()
        if text or comments:
            yield f"{indent}{text}" if text else ""
        for field in fields(name, text if text != _SEPARATOR else ""):
            if "/" in field.type:
                yield from _lines(field.type.replace("/", "/msg/"), False, f"{indent}\t")


# ---- The user's own packages ----


def list_packages(_: Namespace) -> None:
    """List the packages with interfaces, and the folders of those made from definitions."""
    names = {name.partition("/")[0] for kind in KINDS for name in installed_interfaces(kind)}
    own = own_packages()
    for name in sorted(names):
        print(f"{name} ({own[name]})" if name in own else name)


def add(args: Namespace) -> None:
    """Make the interfaces of a package folder importable in this environment."""
    from onebot_description.ros.wire.interfaces import own_interface

    folder = Path(args.folder).expanduser().resolve()
    if not any(definitions(folder)):
        raise OneBotError(f"{folder} has no file such as msg/Name.msg, srv/Name.srv")
    name = package_name(folder) or folder.name
    if not re.fullmatch("[a-z][a-z0-9]*(_[a-z0-9]+)*", name):
        raise OneBotError(f'"{name}" is not a package name such as my_msgs: add a package.xml')
    link = ADDED / name
    link.unlink(missing_ok=True)
    try:
        ADDED.mkdir(parents=True, exist_ok=True)
        link.symlink_to(folder)
    except OSError as error:
        text = f"{link}: {error.strerror}; or export ROS_PACKAGE_PATH={folder}"
        raise OneBotError(text) from error
    if (place := origin(name)) not in (str(folder.parent), str(folder)):  # the latter has its code
        link.unlink()
        raise OneBotError(f"{name} from {place or 'the sourced ROS'} takes precedence")
    types = [f"{name}/{file.parent.name}/{file.stem}" for file in definitions(folder)]
    try:
        for type_ in types:
            own_interface(type_)
    except OneBotError:
        link.unlink()
        raise
    write_stubs(name, folder, _SITE)
    print(f"added {name} from {folder}: {', '.join(types)}")


def remove(args: Namespace) -> None:
    """Undo ``add``."""
    link = ADDED / args.package
    if not link.is_symlink():
        added = sorted(folder.name for folder in ADDED.iterdir()) if ADDED.is_dir() else []
        hint = did_you_mean(args.package, added, "added")
        raise OneBotError(f'no package "{args.package}" was added{hint}')
    link.unlink()
    shutil.rmtree(_SITE / f"{args.package}-stubs", ignore_errors=True)
    print(f"removed {args.package}")


COMMANDS = {
    "show": Subcommand(
        "show the fields of a type",
        show,
        positional("TYPE", "such as geometry_msgs/msg/Twist"),
        flag("--no-comments", "fields only"),
    ),
    "list": Subcommand("list the installed types", list_types),
    "packages": Subcommand("list the packages that have types", list_packages),
    "add": Subcommand(
        "make the types of a package folder importable, without building it",
        add,
        positional("FOLDER", "a folder with msg/, srv/ or action/"),
    ),
    "remove": Subcommand("undo add", remove, positional("PACKAGE", "its name")),
}
