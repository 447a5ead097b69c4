"""Command line options, and commands with subcommands such as ``onebot topic pub``."""

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import CodeType
from typing import NoReturn

from onebot_description.errors import OneBotError, UsageError, did_you_mean


@dataclass(frozen=True)
class Subcommand:
    """The second word of a command, such as ``pub`` in ``onebot topic pub``."""

    summary: str  # one line for the group's ``--help``
    # Adds its options to the parser, parses ``argv``, runs and returns the exit code.
    run: "Callable[[Parser, Sequence[str]], int]"


def dispatch(group: str, table: Mapping[str, Subcommand], argv: Sequence[str]) -> int:
    """Run the subcommand ``argv[0]``.

    Args:
        group: the first word of the command, such as ``topic``.
        table: the subcommands by name.
        argv: the subcommand and its arguments.

    Raises:
        UsageError: the subcommand is missing or unknown.
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
        f"onebot {group} COMMAND --help shows the options of each."
    )


class Parser(argparse.ArgumentParser):
    """argparse's parser, whose errors are ``UsageError``."""

    def __init__(self, program: str, summary: str) -> None:
        """Make a parser without arguments.

        Args:
            program: the command, such as ``onebot topic pub``.
            summary: one line for ``--help``.
        """
        super().__init__(
            prog=program,
            description=f"{summary[:1].upper()}{summary[1:]}.",
            epilog="--ros-args and what follows is passed to ROS, as with every node.",
        )

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{self.prog}: {message}")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Return the parsed options, with everything from ``--ros-args`` on as ``ros_args``.

        Raises:
            UsageError: the command line is wrong.
        """
        words = list(argv)
        for word in words:
            if not _is_unicode(word):
                self.error(f"{str(os.fsencode(word))[1:]} is not UTF-8")
        start = words.index("--ros-args") if "--ros-args" in words else len(words)
        parsed = self.parse_args(words[:start])
        parsed.ros_args = words[start:]
        return parsed


def _is_unicode(word: str) -> bool:
    """Whether an argument of the command line was UTF-8, the only encoding of ROS."""
    return not any("\ud800" <= character <= "\udfff" for character in word)


def add_allow_non_finite(parser: Parser) -> None:
    """Add the option that infinities and NaN are advised to be given with."""
    parser.add_argument("--allow-non-finite", action="store_true", help="accept .nan and .inf")


def listed(found: Iterable[tuple[str, Sequence[str]]], types: bool) -> list[str]:
    """Return the names of topics or services, with their types if asked for."""
    return [f"{name} [{', '.join(kinds)}]" if types else name for name, kinds in found]


def print_rows(rows: Sequence[str], *, count: bool) -> None:
    """Print these lines, or only their number."""
    print(len(rows) if count else "\n".join(rows), end="\n" if count or rows else "")


def read_stdin() -> str:
    """Return what stdin has.

    Raises:
        OneBotError: it is not UTF-8.
    """
    try:
        return sys.stdin.read()
    except UnicodeDecodeError:
        raise OneBotError("standard input is not UTF-8") from None


def positive(text: str) -> float:
    """Parse a number above zero, for ``type=``."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def not_negative(text: str) -> float:
    """Parse a number that is zero or more, for ``type=``."""
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is less than zero, or no number")
    return value


def count(text: str) -> int:
    """Parse an integer above zero, for ``type=``."""
    value = natural(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return value


def natural(text: str, most: int = 2**31 - 1) -> int:
    """Parse an integer that is zero or more, for ``type=``; by default one that C can take."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is less than zero")
    if value > most:
        raise argparse.ArgumentTypeError(f"{text} is above {most}")
    return value


def expression(text: str) -> CodeType:
    """Compile a Python expression, for ``type=``."""
    try:
        return compile(text, "--filter", "eval")
    except (SyntaxError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text} is no Python expression: {error}") from None
