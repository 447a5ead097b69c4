"""``onebot <verb> ...``: finds the verb's module, reads options, reports errors and exit codes.

Exit codes: 0 success, or stopped by the user; 1 a mistake in the user's files, or a node failed;
2 a wrong command line; 130 a plain command was interrupted; 141 the reader of its output left.

Nothing slow is imported here: until ``run_command`` runs, Ctrl-C gives Python's traceback.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

from onebot_description.errors import DescriptionError, OneBotError, UsageError, did_you_mean

USAGE = 2
INTERRUPTED = 128 + 2  # as shells report SIGINT
READER_LEFT = 128 + 13  # as shells report SIGPIPE


def run_command(
    body: Callable[[], int], see: str | Callable[[], str], interrupted: int = INTERRUPTED
) -> int:
    """Run ``body`` and return its exit code; a user's mistake is shown without a traceback.

    Args:
        body: the command.
        see: the command that prints its help, named in errors of usage; or a function for it.
        interrupted: the exit code after Ctrl-C.
    """
    try:
        code = body()
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except UsageError as error:
        _print_problems(error)
        print(f"see: {see if isinstance(see, str) else see()}", file=sys.stderr)
        return USAGE
    except OneBotError as error:
        _print_problems(error)
        return 1
    except KeyboardInterrupt:
        return interrupted
    except BrokenPipeError:
        # Python would try to flush again on its way out.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return READER_LEFT


def _print_problems(error: OneBotError) -> None:
    problems = error.problems if isinstance(error, DescriptionError) else str(error).splitlines()
    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)


@dataclass(frozen=True)
class Verb:
    """The first word of a command; its module is imported only when it is used."""

    summary: str  # one line for ``onebot --help``
    module: str  # has ``run(argv) -> int``; argv is what follows the verb, ``--help`` too
    group: bool = False  # a second word follows, one of the module's ``COMMANDS``


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
    "accuracy": Verb("measure how accurately OneBot drives", f"{_HERE}.accuracy"),
    "bench": Verb("measure performance as ratios to floors", f"{_HERE}.bench"),
    "steer": Verb("drive from a page in the browser", f"{_HERE}.steer"),
    "teleop": Verb("drive from the keyboard", f"{_HERE}.teleop"),
}


def help_command(words: list[str]) -> str:
    """Return the command that prints the help of the one in ``words``."""
    verb = VERBS.get(words[0]) if words else None
    if verb is None:
        return "onebot --help"
    count = 1
    if verb.group and len(words) > 1:
        count += words[1] in importlib.import_module(verb.module).COMMANDS
    return f"onebot {' '.join(words[:count])} --help"


def run_verb(words: list[str]) -> int:
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


@dataclass(frozen=True)
class Subcommand:
    """The second word of a command, such as ``pub`` in ``onebot topic pub``."""

    summary: str  # one line for the group's ``--help``
    # Adds its options to the parser, reads the words that follow, and returns the exit code.
    run: "Callable[[Parser, Sequence[str]], int]"


def dispatch(group: str, table: Mapping[str, Subcommand], argv: Sequence[str]) -> int:
    """Run the subcommand that the first word of ``argv`` names.

    Args:
        group: the first word of the command, such as ``topic``.
        table: the second words.
        argv: what follows the first word.

    Raises:
        UsageError: there is no such subcommand, or none is named.
    """
    if argv and argv[0] in ("-h", "--help", "help"):
        print(_usage(group, table))
        return 0
    if not argv or argv[0] not in table:
        names = ", ".join(table)
        if not argv:
            raise UsageError(f"onebot {group} what? ({names})")
        raise UsageError(
            f'onebot {group} has no command "{argv[0]}"{did_you_mean(argv[0], table, "commands")}'
        )
    subcommand = table[argv[0]]
    return subcommand.run(Parser(f"onebot {group} {argv[0]}", subcommand.summary), argv[1:])


def _usage(group: str, table: Mapping[str, Subcommand]) -> str:
    width = max(map(len, table))
    rows = "\n".join(f"  {name:{width}}  {entry.summary}" for name, entry in table.items())
    return (
        f"usage: onebot {group} COMMAND ...\n\nCommands:\n{rows}\n\n"
        f"onebot {group} COMMAND --help says more on each."
    )


class Parser(argparse.ArgumentParser):
    """argparse's parser, whose errors are ``UsageError``."""

    def __init__(self, program: str, summary: str) -> None:
        """Make a parser without arguments.

        Args:
            program: the command, such as ``onebot topic pub``.
            summary: what it does, for ``--help``.
        """
        super().__init__(
            prog=program,
            description=f"{summary[:1].upper()}{summary[1:]}.",
            epilog="--ros-args and what follows goes to ROS, as with every node.",
        )

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{self.prog}: {message}")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Return the options, and what follows ``--ros-args`` as ``ros_args``.

        Raises:
            UsageError: the command line is not understood.
        """
        words = list(argv)
        start = words.index("--ros-args") if "--ros-args" in words else len(words)
        parsed = self.parse_args(words[:start])
        parsed.ros_args = words[start:]
        return parsed


def positive(text: str) -> float:
    """Read a number above zero, for ``type=``."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def not_negative(text: str) -> float:
    """Read a number that is zero or more, for ``type=``."""
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is less than zero, or no number")
    return value


def count(text: str) -> int:
    """Read a whole number above zero, for ``type=``."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def natural(text: str) -> int:
    """Read a whole number that is zero or more, for ``type=``."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is less than zero")
    return value


# These run until Ctrl-C, which is a success then.
_UNTIL_CTRL_C = ("view", "topic", "replay", "steer", "teleop")


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``onebot`` with ``argv`` (default: the command line's) and return the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)

    until_interrupted = bool(words) and words[0] in _UNTIL_CTRL_C
    return run_command(
        lambda: run_verb(words),
        lambda: help_command(words),
        0 if until_interrupted else INTERRUPTED,
    )


if __name__ == "__main__":
    sys.exit(main())
