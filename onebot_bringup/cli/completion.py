"""``onebot completion SHELL``, and the completion of the words of ``onebot``."""

import argparse
from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from onebot_bringup.cli import verbs
from onebot_bringup.cli.options import Parser, positional
from onebot_bringup.cli.run import EXECUTABLES
from onebot_bringup.cli.running_controllers import running_controllers
from onebot_bringup.cli.session import Session
from onebot_bringup.cli.tf import received_frames
from onebot_bringup.introspection.parameter_client import ParameterClient
from onebot_bringup.launch.completion import choose, complete_command, files
from onebot_bringup.launch.nodes import BRINGUPS
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interface_text import installed_interfaces

_SHELLS = ("bash", "zsh", "fish")


def run(argv: Sequence[str]) -> int:
    """Print the code that the shell evaluates to complete our commands; return the exit code."""
    text = 'bash, zsh: eval "$(onebot completion bash)"; fish: onebot completion fish | source'
    shell = positional("SHELL", text, choices=_SHELLS)
    summary = "print the code for a shell's tab completion"
    args = Parser("onebot completion", summary, [shell]).parse(argv)
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError:
        raise OneBotError(
            "tab completion needs argcomplete: pip install 'onebot-robots[completion]'"
        ) from None
    print(shellcode(["onebot", *BRINGUPS], shell=args.shell))
    return 0


def complete(words: list[str]) -> None:
    """Print the completions of the words after ``onebot``, and end the process if there are any."""
    command = verbs.take_settings(words)
    _complete_verb(1 + len(words) - len(command), *command)


def _complete_verb(position: int, verb: str = "", *rest: str) -> None:
    """Complete a verb, which follows the ``position``-th word of the line, or its arguments."""
    if not verb:
        choose({name: verb.summary for name, verb in verbs.VERBS.items()}, position)
    if verb not in verbs.VERBS:
        return
    commands = {name: entry.summary for name, entry in verbs.subcommands(verb).items()}
    if commands and not rest:
        choose(commands, position + 1)
    elif verb != "run":
        completer = _of_trajectory if verb == "trajectory" else files
        complete_command(
            verbs.run_verb,
            [verb, *rest],
            position + 1 + bool(commands),
            others=completer,
            completers=_COMPLETERS,
        )
    elif len(rest) < 2:
        names = EXECUTABLES.get(rest[0], ()) if rest else EXECUTABLES
        choose(dict.fromkeys(names, ""), position + 1 + len(rest))


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


def _discovered(names: Callable[[Session, Namespace], Iterable[str]]) -> Callable[..., list[str]]:
    """Return a completer of names in the ROS graph; ``names`` gets a session and earlier words."""

    def completer(*, parsed_args: Namespace, **_: object) -> list[str]:
        with suppress(OneBotError), Session() as session:
            return list(names(session, parsed_args))
        return []

    return completer


def _types(parser: argparse.ArgumentParser, **_: object) -> list[str]:
    return list(installed_interfaces("srv" if parser.prog.startswith("onebot service") else "msg"))


def _discover(session: Session) -> Session:
    session.discover()
    return session


def _parameters(session: Session, given: Namespace) -> list[str]:
    return ParameterClient(session, session.find_node(given.node)).names()


# Completers by the metavar of an argument.
_COMPLETERS: Mapping[Any, Callable[..., list[str]]] = {
    "TOPIC": _discovered(lambda session, _: dict(_discover(session).topics())),
    "NODE": _discovered(lambda session, _: _discover(session).nodes()),
    "SERVICE": _discovered(lambda session, _: dict(_discover(session).services())),
    "PARAMETER": _discovered(_parameters),
    "TYPE": _types,
    **dict.fromkeys(("A", "B"), _discovered(lambda session, _: received_frames(session))),
}
