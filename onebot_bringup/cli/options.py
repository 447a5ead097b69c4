"""Command line options, and commands with subcommands such as ``onebot topic pub``."""

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NoReturn, TypeVar

from onebot_bringup.launch.arguments import split_ros_args
from onebot_description.errors import UsageError, did_you_mean

_Number = TypeVar("_Number", int, float)

Option = Callable[[Any], object]
"""Adds an option or a positional argument to an argparse parser."""


def option(
    names: str,
    metavar: str | None,
    help: str | None,
    type: Callable[[str], Any] = str,
    default: Any = None,
    **settings: Any,
) -> Option:
    """Return an option with a value.

    Args:
        names: its names, such as "-r --rate".
        metavar: what the help calls the value.
        help: the help.
        type: parses the value.
        default: the default value.
        settings: further arguments of argparse's ``add_argument``.
    """
    common = {"metavar": metavar, "help": help, "type": type, "default": default}
    return lambda parser: parser.add_argument(*names.split(), **common, **settings)


def flag(names: str, help: str, **settings: Any) -> Option:
    """Return an option without a value."""
    return lambda parser: parser.add_argument(
        *names.split(), action="store_true", help=help, **settings
    )


def positional(metavar: str, help: str | None = None, **settings: Any) -> Option:
    """Return a positional argument, whose attribute is ``metavar`` in lower case."""
    return lambda parser: parser.add_argument(
        metavar.lower(), metavar=metavar, help=help, **settings
    )


# Matches words that are values, not options; argparse itself does not recognize -1e-3.
_NEGATIVE = re.compile(r"-(\d|\.|inf|nan)")

ALLOW_NON_FINITE = flag("--allow-non-finite", "accept .nan and .inf")


class Subcommand:
    """The second word of a command, such as ``pub`` in ``onebot topic pub``."""

    def __init__(
        self,
        summary: str,
        run: Callable[[argparse.Namespace], int | None],
        *options: Option,
        endless: Callable[[argparse.Namespace], bool] = lambda _: False,
    ) -> None:
        """Declare the command.

        Args:
            summary: a line for ``--help``.
            run: the command; it may return an exit code.
            options: its options.
            endless: whether Ctrl-C is its normal end, with exit code 0.
        """
        self.summary, self.run, self.options, self.endless = summary, run, options, endless


def dispatch(group: str, table: Mapping[str, Subcommand], argv: Sequence[str]) -> int:
    """Run the subcommand ``argv[0]`` of a group such as ``topic``; return the exit code."""
    if argv and argv[0] in ("-h", "--help", "help"):
        print(f"{commands_text(f'onebot {group}', table)}.")
        return 0
    if not argv:
        raise UsageError(f"onebot {group} what? ({', '.join(table)})")
    name, *words = argv
    if name not in table:
        hint = did_you_mean(name, table, "commands")
        raise UsageError(f'onebot {group} has no command "{name}"{hint}')
    subcommand = table[name]
    parser = Parser(f"onebot {group} {name}", subcommand.summary, subcommand.options)
    args = parser.parse(words)
    try:
        return subcommand.run(args) or 0
    except KeyboardInterrupt:
        if subcommand.endless(args):
            return 0
        raise


def commands_text(program: str, table: Mapping[str, Any], settings: str = "") -> str:
    """Return the help of a command with subcommands, each of which has a ``summary``."""
    width = max(map(len, table))
    rows = "\n".join(f"  {name:{width}}  {entry.summary}" for name, entry in table.items())
    return (
        f"usage: {program} {settings}COMMAND ...\n\nCommands:\n{rows}\n\n"
        f"{program} COMMAND --help shows the options of each"
    )


class Parser(argparse.ArgumentParser):
    """An argparse parser whose errors are ``UsageError``."""

    def __init__(self, program: str, summary: str, options: Iterable[Option] = ()) -> None:
        """Make the parser of a command such as ``onebot topic pub``."""
        super().__init__(
            prog=program,
            description=f"{summary[:1].upper()}{summary[1:]}.",
            epilog="--ros-args and what follows is passed to ROS, as with every node.",
        )
        self._negative_number_matcher = _NEGATIVE
        for add_option in options:
            add_option(self)

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{self.prog}: {message}")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Return the parsed options, with the words after ``--ros-args`` as ``ros_args``."""
        words, ros_args = split_ros_args(argv)
        return self.parse_args(words, argparse.Namespace(ros_args=ros_args))


def warn(text: str) -> None:
    """Print a warning."""
    print(f"warning: {text}", file=sys.stderr, flush=True)


def numbers(
    kind: type[_Number], is_allowed: Callable[[_Number], bool], wanted: str
) -> Callable[[str], _Number]:
    """Return a function for ``type=`` that parses the numbers that are allowed."""

    def number(text: str) -> _Number:
        value = kind(text)
        if not is_allowed(value):
            raise argparse.ArgumentTypeError(f"{text} is not {wanted}")
        return value

    return number


positive = numbers(float, lambda value: 0.0 < value < math.inf, "above zero")
not_negative = numbers(float, lambda value: 0.0 <= value < math.inf, "zero or more")
finite = numbers(float, math.isfinite, "a finite number")
count = numbers(int, lambda value: value > 0, "above zero")
natural = numbers(int, lambda value: value >= 0, "zero or more")


class WordError(UsageError, argparse.ArgumentTypeError):
    """A word of the command line is wrong; argparse adds the option whose value it is."""


def assignment(text: str) -> tuple[str, float]:
    """Parse a word such as ``elbow=0.5``; return the name and the number.

    Raises:
        WordError: the word has another form, or the number is not finite.
    """
    name, _, number = text.rpartition("=")
    with suppress(ValueError):
        if name and math.isfinite(float(number)):
            return name, float(number)
    raise WordError(f'"{text}" is not NAME=NUMBER, such as elbow=0.5')
