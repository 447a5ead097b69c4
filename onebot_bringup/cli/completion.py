"""``onebot completion SHELL``, and what the shell asks for at every press of Tab, by argcomplete.

The parsers of the commands are the only list of their options: to complete, a command is run as far
as its parser. Launch arguments are those that ``--show-args`` prints.
"""

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import PurePath
from typing import NoReturn

from onebot_bringup.cli import main
from onebot_bringup.cli.options import Parser
from onebot_bringup.cli.run import EXECUTABLES
from onebot_description.errors import OneBotError, UsageError

_SHELLS = ("bash", "zsh", "fish")
_SCRIPTS = {
    "onebot_bringup": EXECUTABLES["onebot_bringup"]["onebot_bringup"],
    "mrm_bringup": EXECUTABLES["mrm_description"]["mrm_bringup"],
}
_LAUNCH = ("check", "view", "replay", "steer")  # which take name:=value
# whose ``run`` begins with a Parser
_PARSED = ("doctor", "soak", "snapshot", "teleop", "completion")
_ARGUMENT = re.compile(r"^  (\w+):=(\S*)(?:\n {4,}| *)(.*)$", re.MULTILINE)
_CHOICES = re.compile(r"\((\w+(?:, \w+)+)\)$")
_SWITCH = ("true", "false")


def run(argv: Sequence[str]) -> int:
    """Print what the shell evaluates to complete our commands; return the exit code.

    Raises:
        OneBotError: argcomplete is not installed.
    """
    parser = Parser("onebot completion", "print the tab completion of a shell")
    parser.add_argument(
        "shell", choices=_SHELLS, metavar="SHELL",
        help='bash, zsh: eval "$(onebot completion bash)"; fish: onebot completion fish | source',
    )  # fmt: skip
    args = parser.parse(argv)
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError:
        raise OneBotError(
            "tab completion needs argcomplete: pip install 'onebot-robots[completion]'"
        ) from None
    print(shellcode(["onebot", *_SCRIPTS], shell=args.shell))
    return 0


def complete() -> NoReturn:
    """Print what the line of the shell can go on with, and end the process."""
    from argcomplete.lexers import split_line

    _, _, _, words, _ = split_line(os.environ["COMP_LINE"], int(os.environ["COMP_POINT"]))
    program, *given = words
    program = PurePath(program).name
    try:
        if program in _SCRIPTS:
            _complete_launch([_SCRIPTS[program]], 1, given)
        elif not given:
            _choose(main.VERBS, 1)
        else:
            _complete_verb(*given)
    except UsageError:  # no such command: there is nothing to complete
        pass
    os._exit(1)


def _complete_verb(verb: str, *rest: str) -> None:
    if verb in main.GROUPS:
        commands = import_module(f"{main.PACKAGE}.{verb}").COMMANDS
        if not rest:
            _choose({name: command.summary for name, command in commands.items()}, 2)
        main.run_verb([verb, *rest])
    elif verb in _PARSED:
        main.run_verb([verb, *rest])
    elif verb in _LAUNCH:
        _complete_launch(["onebot_bringup.cli.main", verb], 2, rest)
    elif verb == "run" and not rest:
        _choose(dict.fromkeys(EXECUTABLES, ""), 2)
    elif verb == "run" and len(rest) == 1:
        _choose(dict.fromkeys(EXECUTABLES.get(rest[0], ()), ""), 3)


def complete_parser(parser: argparse.ArgumentParser) -> NoReturn:
    """Print what goes on with a command's options, and end the process."""
    for action in parser._actions:
        if action.dest in _COMPLETERS:
            action.completer = _COMPLETERS[action.dest]  # type: ignore[attr-defined]
    _finish(parser, len(parser.prog.split()))


def _finish(parser: argparse.ArgumentParser, position: int) -> NoReturn:
    """Complete with a parser whose command's last word is the ``position``-th of the line."""
    import argcomplete

    os.environ["_ARGCOMPLETE"] = str(position)
    argcomplete.autocomplete(parser, always_complete_options=False)
    os._exit(1)


def _choose(choices: Mapping[str, str], position: int) -> NoReturn:
    """Offer these words, with an explanation where the shell shows one."""
    parser = argparse.ArgumentParser(add_help=False)
    action = parser.add_argument("word")
    action.completer = lambda **_: dict(choices)  # type: ignore[attr-defined]
    _finish(parser, position)


def _complete_launch(module: Sequence[str], position: int, given: Sequence[str]) -> NoReturn:
    """Offer launch arguments, and files."""
    from argcomplete.completers import FilesCompleter

    words = [sys.executable, "-m", *module, *(w for w in given if not w.startswith("-"))]
    environment = {name: value for name, value in os.environ.items() if name != "_ARGCOMPLETE"}
    listed = subprocess.run(
        [*words, "--show-args"], env=environment, capture_output=True, text=True, check=False
    ).stdout
    known = launch_words(listed)
    parser = argparse.ArgumentParser(add_help=False)
    action = parser.add_argument("words", nargs="*")

    def candidates(prefix: str, **_: object) -> dict[str, str]:
        files = [] if ":=" in prefix else FilesCompleter()(prefix)
        return {**known, **dict.fromkeys(files, "")}

    action.completer = candidates  # type: ignore[attr-defined]
    _finish(parser, position)


def launch_words(listed: str) -> dict[str, str]:
    """Return each ``name:=``, or ``name:=choice``, of what --show-args prints; and its meaning."""
    found = {}
    for name, default, meaning in _ARGUMENT.findall(listed):
        choices: Iterable[str] = [""]
        if match := _CHOICES.search(meaning):
            choices = match[1].split(", ")
        elif default in _SWITCH:
            choices = _SWITCH
        found.update({f"{name}:={choice}": meaning for choice in choices})
    return found


def _discovered(names: Callable[..., Iterable[str]]) -> Callable[..., list[str]]:
    """A completer of what is running; ``names`` gets a session that has discovered it."""

    def completer(**_: object) -> list[str]:
        from onebot_bringup.cli.session import Session

        with Session() as session:
            session.discover()
            return list(names(session))

    return completer


def _types(parser: argparse.ArgumentParser, **_: object) -> list[str]:
    from onebot_bringup.introspection.interfaces import installed

    return list(installed("srv" if parser.prog.startswith("onebot service") else "msg"))


_TOPICS = _discovered(lambda session: [name for name, _ in session.topics()])
_COMPLETERS: Mapping[str, Callable[..., list[str]]] = {  # by the name of an argument
    **dict.fromkeys(("topic", "names"), _TOPICS),
    "node": _discovered(lambda session: session.nodes()),
    "service": _discovered(lambda session: [name for name, _ in session.services()]),
    "type": _types,
}
