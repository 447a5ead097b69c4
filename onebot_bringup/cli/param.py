"""``onebot param ...``: shows, sets, saves and loads parameters, like ``ros2 param``.

``describe`` and ``delete`` are left to ros2cli.
"""

import sys
from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from onebot_bringup.cli.options import ALLOW_NON_FINITE, Subcommand, flag, positional
from onebot_bringup.cli.session import Session, in_session
from onebot_bringup.introspection import parameter_values
from onebot_bringup.introspection.parameter_client import ParameterClient
from onebot_bringup.introspection.parameter_values import NOT_SET
from onebot_description.errors import OneBotError
from onebot_description.parameters.files import no_section, read_parameters, read_text


def _client(session: Session, args: Namespace) -> ParameterClient:
    return ParameterClient(session, session.find_node(args.node))


@in_session
def list_parameters(session: Session, args: Namespace) -> int:
    """List parameters; return 1 if a node does not answer."""
    failed = 0
    for node in _nodes_to_list(session, args):
        try:
            names = sorted(ParameterClient(session, node).names())
        except OneBotError as error:
            if args.node:
                raise
            print(f"error: {error}", file=sys.stderr)
            failed = 1
            continue
        if not args.node:
            print(f"{node}:")
        print("".join(f"  {name}\n" for name in names), end="")
    return failed


def _nodes_to_list(session: Session, args: Namespace) -> list[str]:
    if args.node:
        return [session.find_node(args.node)]
    session.discover()
    services = {name for name, _ in session.services(hidden=True)}
    nodes = sorted(set(session.nodes()))
    return [node for node in nodes if f"{node}/list_parameters" in services]


@in_session
def get(session: Session, args: Namespace) -> None:
    """Show a parameter."""
    value = _client(session, args).get(args.parameter)
    if value.type == NOT_SET:
        print("None" if args.hide_type else "Parameter not set.")
    elif args.hide_type:
        print(parameter_values.value_of(value))
    else:
        print(parameter_values.label(value), parameter_values.value_of(value))


@in_session
def set_value(session: Session, args: Namespace) -> int:
    """Set a parameter; return 1 if the node rejected it."""
    pair = args.parameter, args.value
    results = _client(session, args).set([pair], finite=not args.allow_non_finite)
    done, failed = "Set parameter successful", "Setting parameter failed"
    return _exit_code([args.parameter], results, done, failed)


def _exit_code(names: Iterable[str], results: Iterable[Any], done: str, failed: str) -> int:
    """Print what became of each parameter; return 1 if any was not accepted."""
    code = 0
    for name, result in zip(names, results, strict=True):
        reason = f": {result.reason}" if result.reason else ""
        if result.successful:
            print(f"{done.format(name)}{reason}")
        else:
            print(f"{failed.format(name)}{reason}", file=sys.stderr)
            code = 1
    return code


@in_session
def load(session: Session, args: Namespace) -> int:
    """Set the parameters that a file has for a node; return 1 if the node rejected any."""
    text = read_text(args.file)
    node = session.find_node(args.node)
    written = read_parameters(text, str(args.file), node)
    if problem := no_section(written, [args.file], node):
        raise OneBotError(problem)
    pairs = [(name, parameter_values.quoted(value)) for name, value in written.values.items()]
    results = ParameterClient(session, node).set(pairs, finite=not args.allow_non_finite)
    done, failed = "Set parameter {} successful", "Set parameter {} failed"
    return _exit_code(written.values, results, done, failed)


@in_session
def dump(session: Session, args: Namespace) -> None:
    """Print all parameters of a node as YAML."""
    node = session.find_node(args.node)
    client = ParameterClient(session, node)
    parameters = sorted(client.names())
    print(parameter_values.dump(node, parameters, client.values(parameters)))


_EXAMPLE = "such as /robot_state_publisher"
_NODE = positional("NODE", _EXAMPLE)
_PARAMETER = positional("PARAMETER")

COMMANDS = {
    "list": Subcommand(
        "list the parameters of a node, or of all",
        list_parameters,
        positional("NODE", f"{_EXAMPLE} (all nodes)", nargs="?"),
    ),
    "get": Subcommand(
        "show a parameter", get, _NODE, _PARAMETER, flag("--hide-type", "print the value only")
    ),
    "set": Subcommand(
        "set a parameter",
        set_value,
        _NODE,
        _PARAMETER,
        positional("VALUE", "in YAML: 0.5, true, [a, b]"),
        ALLOW_NON_FINITE,
    ),
    "load": Subcommand(
        "set the parameters that a file has for a node",
        load,
        _NODE,
        positional("FILE", "such as param dump prints", type=Path),
        ALLOW_NON_FINITE,
    ),
    "dump": Subcommand("print all parameters of a node as a parameter file", dump, _NODE),
}
