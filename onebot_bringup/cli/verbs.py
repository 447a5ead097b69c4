"""The verbs of ``onebot``; each is a module that is imported only when used."""

import importlib
import sys
from dataclasses import dataclass

from onebot_bringup.launcher.arguments import UsageError
from onebot_description.text import did_you_mean


@dataclass(frozen=True)
class Verb:
    """A subcommand.

    Attributes:
        summary: one line for ``onebot --help``.
        module: has ``run(argv) -> int``; ``argv`` holds what follows the verb, ``--help`` too.
        group: a second word follows, such as ``pub`` in ``onebot topic pub``; the module lists
            them as ``COMMANDS``.
    """

    summary: str
    module: str
    group: bool = False


_HERE = "onebot_bringup.cli"
VERBS: dict[str, Verb] = {
    "check": Verb("check a URDF or xacro file and show its tree", f"{_HERE}.check"),
    "view": Verb("bring up any robot from its file and move it", f"{_HERE}.view"),
    "topic": Verb("list, print, measure and publish topics", f"{_HERE}.topic", group=True),
    "node": Verb("list nodes and show what they do", f"{_HERE}.node", group=True),
    "param": Verb("list, get, set and dump parameters", f"{_HERE}.param", group=True),
    "service": Verb("list and call services", f"{_HERE}.service", group=True),
    "interface": Verb("list types of messages and show them", f"{_HERE}.interface", group=True),
    "snapshot": Verb("draw a robot into a picture file", f"{_HERE}.snapshot"),
    "replay": Verb("show a recording", f"{_HERE}.replay"),
    "accuracy": Verb("measure how true OneBot drives", f"{_HERE}.accuracy"),
    "bench": Verb("measure how fast all is, against floors", f"{_HERE}.bench"),
    "steer": Verb("drive from a page in the browser", f"{_HERE}.steer"),
    "teleop": Verb("drive from the keyboard", f"{_HERE}.teleop"),
}


def where_it_is_explained(words: list[str]) -> str:
    """Return the command that shows how the one in ``words`` is used."""
    verb = VERBS.get(words[0]) if words else None
    if verb is None:
        return "onebot --help"
    count = 1
    if verb.group and len(words) > 1:
        count += words[1] in importlib.import_module(verb.module).COMMANDS
    return f"onebot {' '.join(words[:count])} --help"


def run(words: list[str]) -> int:
    """Run ``onebot`` with these words and return its exit code.

    Raises:
        UsageError: they are not understood.
        OneBotError: the command fails for a reason that the user can mend.
    """
    if not words:
        print(usage(), file=sys.stderr)
        return 2
    first, *rest = words
    if first == "help" and rest:
        first, *rest = [*rest, "--help"]
    if first in ("-h", "--help", "help"):
        print(usage())
        return 0
    if first in ("-V", "--version"):
        print(f"onebot {version()}")
        return 0
    if first not in VERBS:
        raise UsageError(f'onebot has no command "{first}"{did_you_mean(first, VERBS, "commands")}')
    return int(importlib.import_module(VERBS[first].module).run(rest))


def usage() -> str:
    """Return what ``onebot --help`` prints."""
    width = max(map(len, VERBS))
    verbs = "\n".join(f"  {name:{width}}  {verb.summary}" for name, verb in VERBS.items())
    return (
        "usage: onebot COMMAND ...\n\nCommands:\n"
        f"{verbs}\n\n"
        "onebot COMMAND --help says more on each; onebot --version says which this is."
    )


def version() -> str:
    """Return the version that is installed."""
    from importlib import metadata  # slow to import

    try:
        return metadata.version("onebot")
    except metadata.PackageNotFoundError:
        return "(not installed: run from a checkout)"
