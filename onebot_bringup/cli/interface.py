"""``onebot interface ...``: lists the installed types and shows their fields."""

import re
from collections.abc import Iterator, Sequence

from onebot_bringup.cli.options import Parser, Subcommand, dispatch
from onebot_bringup.introspection.interfaces import definition, full_name, installed
from onebot_description.errors import OneBotError, did_you_mean

_TITLES = (("Messages", "msg"), ("Services", "srv"), ("Actions", "action"))
_FIELD = re.compile(r"^\s*([A-Za-z]\w*(?:/[A-Za-z]\w*)*)")


def types(parser: Parser, argv: Sequence[str]) -> int:
    """List the types; return the exit code."""
    parser.add_argument("-m", "--only-msgs", dest="msg", action="store_true", help="messages only")
    parser.add_argument("-s", "--only-srvs", dest="srv", action="store_true", help="services only")
    args = parser.parse(argv)
    for title, kind in _TITLES:
        if (args.msg or args.srv) and not getattr(args, kind, False):
            continue
        print(f"{title}:")
        print("".join(f"    {name}\n" for name in installed(kind)), end="")
    return 0


def show(parser: Parser, argv: Sequence[str]) -> int:
    """Show the fields of a type; return the exit code."""
    parser.add_argument("type", metavar="TYPE", help="such as geometry_msgs/msg/Twist")
    comments = parser.add_mutually_exclusive_group()
    comments.add_argument("--all-comments", action="store_true", help="of nested types too")
    comments.add_argument("--no-comments", action="store_true", help="none at all")
    args = parser.parse(argv)
    for line in _lines(_find(args.type), not args.no_comments, args.all_comments, ""):
        print(line)
    return 0


def _find(name: str) -> str:
    for _, kind in _TITLES:
        try:
            return full_name(name, kind)
        except OneBotError:
            continue
    known = [full for _, kind in _TITLES for full in installed(kind)]
    raise OneBotError(f'no type "{name}"{did_you_mean(name, known, "installed")}')


def _lines(name: str, comments: bool, nested_comments: bool, indent: str) -> Iterator[str]:
    package = name.partition("/")[0]
    for line in definition(name).splitlines():
        text = line.rstrip()
        if not comments:
            text = text.partition("#")[0].rstrip()
            if not text:
                continue
        yield f"{indent}{text}" if text else ""
        nested = _nested(text, package)
        if nested:
            yield from _lines(nested, nested_comments, nested_comments, f"{indent}\t")


def _nested(line: str, package: str) -> str | None:
    """The message type of a line's field; None for primitive fields, constants and comments."""
    match = _FIELD.match(line)
    if match is None:
        return None
    name = match.group(1)
    full = name if "/" in name else f"{package}/{name}"
    parts = full.split("/")
    full = f"{parts[0]}/msg/{parts[-1]}"
    return full if full in installed("msg") else None


COMMANDS = {
    "show": Subcommand("show the fields of a type", show),
    "list": Subcommand("list the installed types", types),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the type is not installed, or the command line is wrong.
    """
    return dispatch("interface", COMMANDS, argv)
