"""``onebot interface ...``: lists the installed types and shows their fields."""

import re
from argparse import Namespace
from collections.abc import Iterator

from onebot_bringup.cli.options import Subcommand, flag, positional
from onebot_bringup.introspection.interfaces import full_name, installed
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.wire.interface_text import interface_text

_TITLES = (("Messages", "msg"), ("Services", "srv"), ("Actions", "action"))
_FIELD = re.compile(r"^\s*([A-Za-z]\w*(?:/[A-Za-z]\w*)*)")


def list_types(_: Namespace) -> None:
    """List the types."""
    for title, kind in _TITLES:
        print(f"{title}:")
        print("".join(f"    {name}\n" for name in installed(kind)), end="")


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
    types = [full for _, kind in _TITLES for full in installed(kind)]
    raise OneBotError(f'no type "{name}"{did_you_mean(name, types, "installed")}')


def _lines(name: str, comments: bool, indent: str) -> Iterator[str]:
    package = name.partition("/")[0]
    for line in interface_text(name).splitlines():
        text = line.rstrip()
        if not comments:
            text = text.partition("#")[0].rstrip()
            if not text:
                continue
        yield f"{indent}{text}" if text else ""
        nested = _nested(text, package)
        if nested:
            yield from _lines(nested, False, f"{indent}\t")


def _nested(line: str, package: str) -> str | None:
    """Return the message type of a line's field; None for primitives, constants and comments."""
    match = _FIELD.match(line)
    if match is None:
        return None
    name = match.group(1)
    full = name if "/" in name else f"{package}/{name}"
    parts = full.split("/")
    full = f"{parts[0]}/msg/{parts[-1]}"
    return full if full in installed("msg") else None


COMMANDS = {
    "show": Subcommand(
        "show the fields of a type",
        show,
        positional("TYPE", "such as geometry_msgs/msg/Twist"),
        flag("--no-comments", "fields only"),
    ),
    "list": Subcommand(
        "list the installed types",
        list_types,
    ),
}
