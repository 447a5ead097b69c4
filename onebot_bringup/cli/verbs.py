"""The table of the verbs of ``onebot``, and how the words of a command line choose one."""

import os
import sys
from collections import namedtuple
from collections.abc import Mapping

from onebot_bringup.launch.program import INTERRUPTED, USAGE, VERSION, print_version
from onebot_description.errors import UsageError, did_you_mean

TYPE_CHECKING = False  # typing's constant; typing is slow to import
if TYPE_CHECKING:
    from onebot_bringup.cli.options import Subcommand

# A line for ``onebot --help``, and the exit code after Ctrl-C, 0 if that is always the normal end.
Verb = namedtuple("Verb", ["summary", "interrupted"], defaults=[INTERRUPTED])  # noqa: PYI024

# Each verb is a module of this package, imported only when it is used. It has either a table
# ``COMMANDS`` of ``Subcommand``, or ``run(argv) -> int``; ``argv`` are the words after the verb.
PACKAGE = "onebot_bringup.cli"
VERBS = {
    "check": Verb("check a URDF or xacro file and show its tree"),
    "view": Verb("bring up any robot from its file and move it", 0),
    "topic": Verb("list, print, measure and publish topics"),
    "node": Verb("list nodes and show what they do"),
    "param": Verb("list, get, set, save and load parameters"),
    "service": Verb("list and call services"),
    "interface": Verb("list types of messages and show them"),
    "tf": Verb("show the tree of frames, and transforms between frames"),
    "snapshot": Verb("draw a robot into a picture file"),
    "run": Verb("run a node by its package and name, or from its file", 0),
    "evaluate": Verb("run an episode for many cases, and write a table of the results"),
    "bag": Verb("record topics, play a recording, show what it holds"),
    "replay": Verb("show a recording"),
    "doctor": Verb("check what is wrong on this computer"),
    "completion": Verb("print the code for a shell's tab completion"),
    "steer": Verb("drive from a page in the browser", 0),
    "teleop": Verb("drive from the keyboard", 0),
    "navigate": Verb("drive a robot to a place in its map"),
    "map": Verb("save the map of a robot"),
    "trajectory": Verb("move joints to positions, and list those that can be moved"),
}


def help_command(words: list[str]) -> str:
    """Return the command that prints the help of the command in ``words``."""
    if not words or words[0] not in VERBS:
        return "onebot --help"
    count = 2 if len(words) > 1 and words[1] in subcommands(words[0]) else 1
    return f"onebot {' '.join(words[:count])} --help"


def subcommands(verb: str) -> "Mapping[str, Subcommand]":
    """Return the subcommands of a verb; empty for most verbs."""
    from importlib import import_module

    return getattr(import_module(f"{PACKAGE}.{verb}"), "COMMANDS", {})


def run_verb(words: list[str]) -> int:
    """Run ``onebot`` with these words and return its exit code."""
    words = take_settings(words)
    if not words:
        print(usage(), file=sys.stderr)
        return USAGE
    first, *arguments = words
    if first == "help" and arguments:
        first, *arguments = [*arguments, "--help"]
    if first in ("-h", "--help", "help"):
        print(usage())
        return 0
    if first in VERSION:
        return print_version("onebot")
    if first not in VERBS:
        raise UsageError(f'onebot has no command "{first}"{did_you_mean(first, VERBS, "commands")}')
    if table := subcommands(first):
        from onebot_bringup.cli.options import dispatch

        return dispatch(first, table, arguments)
    from importlib import import_module

    return int(import_module(f"{PACKAGE}.{first}").run(arguments))


def take_settings(words: list[str]) -> list[str]:
    """Apply ``discovery:=`` and ``domain_id:=`` before the verb; return the other words."""
    count = next((n for n, word in enumerate(words) if ":=" not in word), len(words))
    if count:
        from onebot_bringup.launch.arguments import DiscoverySettings, split

        os.environ.update(DiscoverySettings.read(split(words[:count]).given).variables())
    return words[count:]


def usage() -> str:
    """Return the text of ``onebot --help``."""
    from onebot_bringup.cli.options import commands_text

    text = commands_text("onebot", VERBS, "[discovery:=WHERE] [domain_id:=N] ")
    return f"{text}; onebot --version shows the version."
