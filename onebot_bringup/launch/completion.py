"""Completes a command line when Tab is pressed, with argcomplete.

Options are only defined in the commands: to complete, a command is run up to its argparse parser,
or with ``--show-args`` until it has listed its launch arguments.
"""

import argparse
import io
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from functools import partial
from types import MappingProxyType
from typing import Any, NoReturn

from onebot_bringup.launch.arguments import listed
from onebot_description.errors import OneBotError

Completer = Callable[..., Iterable[str]]
"""A completer of argcomplete, called with keyword arguments."""


def complete_line(complete: Callable[[list[str]], object]) -> NoReturn:
    """Print the completions of the shell's command line, and end the process.

    Args:
        complete: completes the words that follow the program's name.
    """
    from argcomplete.lexers import split_line

    _, _, _, words, _ = split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))
    with suppress(OneBotError), redirect_stdout(io.StringIO()):  # no such command
        complete(words[1:])
    os._exit(1)


def files(_: str, value: str) -> Iterable[str]:
    """Return the files whose path begins with an argument's value, or with a word."""
    from argcomplete.completers import FilesCompleter

    return FilesCompleter()(value)


def complete_command(
    run: Callable[[list[str]], int],
    words: Sequence[str],
    position: int,
    *,
    others: Callable[[str, str], Iterable[str]] = files,
    completers: Mapping[Any, Completer] = MappingProxyType({}),
) -> NoReturn:
    """Run a command only as far as completion needs.

    Args:
        run: the command.
        words: its words.
        position: the index of the last of these words in the line.
        others: returns completions besides ``name:=``: values of an argument, given its name and
            the text after ``:=``; or words without ``:=``, given "" and the word.
        completers: completers of positional arguments, by their metavar.
    """

    def complete_parser(parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        for action in parser._actions:
            if not action.option_strings and action.metavar in completers:
                action.completer = completers[action.metavar]  # type: ignore[attr-defined]
        finish(parser, position)

    argparse.ArgumentParser.parse_args = complete_parser  # type: ignore[assignment,method-assign]
    run([*(word for word in words if not word.startswith("-")), "--show-args"])
    _finish_words(partial(_launch_words, others), position)


def finish(parser: argparse.ArgumentParser, position: int) -> NoReturn:
    """Complete with the parser of a command whose last word is the ``position``-th of the line."""
    import argcomplete

    os.environ["_ARGCOMPLETE"] = str(position)
    argcomplete.autocomplete(parser, always_complete_options=False)
    os._exit(1)


def choose(choices: Mapping[str, str], position: int) -> NoReturn:
    """Offer these words, with explanations if the shell shows them."""
    _finish_words(lambda **_: dict(choices), position)


def _finish_words(completer: Completer, position: int) -> NoReturn:
    """Complete a word with ``completer``."""
    parser = argparse.ArgumentParser(add_help=False)
    action = parser.add_argument("words", nargs="*")
    action.completer = completer  # type: ignore[attr-defined]
    finish(parser, position)


def _launch_words(
    others: Callable[[str, str], Iterable[str]], prefix: str, **_: object
) -> dict[str, str]:
    """Return the arguments that a command has listed, with their choices, and the ``others``."""
    words = {f"{a.name}:={value}": a.help for a in listed for value in a.suggested}
    name, assigned, value = prefix.rpartition(":=")
    if not assigned or not any(word.startswith(prefix) and word != prefix for word in words):
        words.update({f"{name}{assigned}{word}": "" for word in others(name, value)})
    return words
