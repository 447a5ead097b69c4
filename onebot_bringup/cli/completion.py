"""``onebot completion SHELL``, and the answer to each press of Tab, by argcomplete.

Options are only defined in the commands: to complete, a command is run up to its argparse parser,
or with ``--show-args`` until it has listed its launch arguments.
"""

import argparse
import io
import os
from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from functools import partial
from importlib import import_module
from pathlib import PurePath
from typing import Any, NoReturn

from onebot_bringup.cli import main
from onebot_bringup.cli.options import Parser, positional
from onebot_bringup.cli.run import BRINGUPS, EXECUTABLES
from onebot_bringup.cli.running_controllers import running_controllers
from onebot_bringup.cli.session import Session
from onebot_bringup.launch.arguments import listed
from onebot_description.errors import OneBotError

_SHELLS = ("bash", "zsh", "fish")


def run(argv: Sequence[str]) -> int:
    """Print the code that the shell evaluates to complete our commands; return the exit code."""
    text = 'bash, zsh: eval "$(onebot completion bash)"; fish: onebot completion fish | source'
    shell = positional("SHELL", text, choices=_SHELLS)
    summary = "print the tab completion of a shell"
    args = Parser("onebot completion", summary, [shell]).parse(argv)
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError:
        raise OneBotError(
            "tab completion needs argcomplete: pip install 'onebot-robots[completion]'"
        ) from None
    print(shellcode(["onebot", *BRINGUPS], shell=args.shell))
    return 0


def complete() -> NoReturn:
    """Print the completions of the shell's command line, and end the process."""
    from argcomplete.lexers import split_line

    _, _, _, words, _ = split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))
    program, *arguments = words
    script = BRINGUPS.get(PurePath(program).name)
    with suppress(OneBotError), redirect_stdout(io.StringIO()):  # no such command
        if script:
            from onebot_bringup.launch.bringup import bring_up

            _complete_command(partial(bring_up, import_module(script).command()), arguments, 1)
        else:
            command = main.take_settings(list(arguments))
            _complete_verb(1 + len(arguments) - len(command), *command)
    os._exit(1)


def _complete_verb(position: int, verb: str = "", *rest: str) -> None:
    """Complete a verb, which follows the ``position``-th word of the line, or its arguments."""
    if not verb:
        _choose({name: verb.summary for name, verb in main.VERBS.items()}, position)
    if verb not in main.VERBS:
        return
    commands = {name: entry.summary for name, entry in main.subcommands(verb).items()}
    if commands and not rest:
        _choose(commands, position + 1)
    elif verb != "run":
        others = _OTHERS.get(verb, _files)
        _complete_command(main.run_verb, [verb, *rest], position + 1 + bool(commands), others)
    elif len(rest) < 2:
        names = EXECUTABLES.get(rest[0], ()) if rest else EXECUTABLES
        _choose(dict.fromkeys(names, ""), position + 1 + len(rest))


def _files(_: str, value: str) -> Iterable[str]:
    """Return the files whose path begins with an argument's value, or with a word."""
    from argcomplete.completers import FilesCompleter

    return FilesCompleter()(value)


def _of_trajectory(name: str, _: str) -> Iterable[str]:
    """Return the running controllers for the argument ``controller``, or else their joints."""
    if name not in ("", "controller"):
        return []
    with suppress(OneBotError), Session() as session:
        controllers = running_controllers(session)
        if name:
            return [controller.name for controller in controllers]
        return [f"{joint}=" for controller in controllers for joint in controller.joints]
    return []


def _complete_command(
    run: Callable[[list[str]], int],
    words: Sequence[str],
    position: int,
    others: Callable[[str, str], Iterable[str]] = _files,
) -> NoReturn:
    """Run a command only as far as completion needs.

    Args:
        run: the command.
        words: its words.
        position: the index of the last of these words in the line.
        others: returns completions besides ``name:=``: values of an argument, given its name and
            the text after ``:=``; or words without ``:=``, given "" and the word.
    """

    def complete_parser(parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        for action in parser._actions:
            if not action.option_strings and action.metavar in _COMPLETERS:
                action.completer = _COMPLETERS[action.metavar]  # type: ignore[attr-defined]
        _finish(parser, position)

    argparse.ArgumentParser.parse_args = complete_parser  # type: ignore[assignment,method-assign]
    run([*(word for word in words if not word.startswith("-")), "--show-args"])
    parser = argparse.ArgumentParser(add_help=False)
    action = parser.add_argument("words", nargs="*")
    action.completer = partial(_launch_words, others)  # type: ignore[attr-defined]
    _finish(parser, position)


def _finish(parser: argparse.ArgumentParser, position: int) -> NoReturn:
    """Complete with the parser of a command whose last word is the ``position``-th of the line."""
    import argcomplete

    os.environ["_ARGCOMPLETE"] = str(position)
    argcomplete.autocomplete(parser, always_complete_options=False)
    os._exit(1)


def _choose(choices: Mapping[str, str], position: int) -> NoReturn:
    """Offer these words, with explanations if the shell shows them."""
    parser = argparse.ArgumentParser(add_help=False)
    action = parser.add_argument("word")
    action.completer = lambda **_: dict(choices)  # type: ignore[attr-defined]
    _finish(parser, position)


def _launch_words(
    others: Callable[[str, str], Iterable[str]], prefix: str, **_: object
) -> dict[str, str]:
    """Return the arguments that a command has listed, with their choices, and the ``others``."""
    words = {f"{a.name}:={value}": a.help for a in listed for value in a.suggested}
    name, assigned, value = prefix.rpartition(":=")
    if not assigned or not any(word.startswith(prefix) and word != prefix for word in words):
        words.update({f"{name}{assigned}{other}": "" for other in others(name, value)})
    return words


def _discovered(names: Callable[[Session, Namespace], Iterable[str]]) -> Callable[..., list[str]]:
    """Return a completer of names in the ROS graph; ``names`` gets a session and earlier words."""

    def completer(*, parsed_args: Namespace, **_: object) -> list[str]:
        with suppress(OneBotError), Session() as session:
            return list(names(session, parsed_args))
        return []

    return completer


def _types(parser: argparse.ArgumentParser, **_: object) -> list[str]:
    from onebot_bringup.introspection.interfaces import installed

    return list(installed("srv" if parser.prog.startswith("onebot service") else "msg"))


def _discover(session: Session) -> Session:
    session.discover()
    return session


def _parameters(session: Session, given: Namespace) -> list[str]:
    from onebot_bringup.introspection.parameter_client import ParameterClient

    names = ParameterClient(session, session.find_node(given.node)).names()
    return [] if len(getattr(given, "pairs", None) or ()) % 2 else names  # the next word is a value


def _frames(session: Session, _: Namespace) -> Iterable[str]:
    from onebot_bringup.cli.tf import received_frames

    return received_frames(session)


# Completers by the metavar of an argument.
_COMPLETERS: Mapping[Any, Callable[..., list[str]]] = {
    "TOPIC": _discovered(lambda session, _: [name for name, _ in _discover(session).topics()]),
    "NODE": _discovered(lambda session, _: _discover(session).nodes()),
    "SERVICE": _discovered(lambda session, _: [name for name, _ in _discover(session).services()]),
    **dict.fromkeys(("PARAMETER", "PARAMETER VALUE"), _discovered(_parameters)),
    "TYPE": _types,
    **dict.fromkeys(("A", "B"), _discovered(_frames)),
}
# For each verb whose words besides name:=value are not files: a function that returns them.
_OTHERS: Mapping[str, Callable[[str, str], Iterable[str]]] = {"trajectory": _of_trajectory}
