"""``onebot param ...``: shows, sets, saves and loads parameters, like ``ros2 param``."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from onebot_bringup.cli.options import Parser, Subcommand, add_allow_non_finite, dispatch
from onebot_bringup.cli.session import Session, add_spin_time
from onebot_bringup.introspection import parameter_values
from onebot_bringup.introspection.parameter_client import ParameterClient
from onebot_bringup.introspection.parameter_values import NOT_SET
from onebot_bringup.launch.arguments import UsageError
from onebot_description.errors import OneBotError
from onebot_description.parameters.files import no_section, read_parameters, read_text


def frame_prefix(session: Session, nodes: Iterable[str]) -> str | None:
    """Return the parameter frame_prefix of the first of these nodes that has one."""
    for name in nodes:
        with suppress(OneBotError):  # it has no parameters
            [value] = ParameterClient(session, name).values(["frame_prefix"])
            if value.type != NOT_SET:
                return str(value.string_value)
    return None


_NODE = "such as /robot_state_publisher"


def names(parser: Parser, argv: Sequence[str]) -> int:
    """List parameters; return the exit code."""
    parser.add_argument("node", nargs="?", metavar="NODE", help=f"{_NODE} (all nodes)")
    parser.add_argument("--include-hidden-nodes", action="store_true", help="hidden nodes too")
    parser.add_argument(
        "--param-prefixes",
        nargs="+",
        default=[],
        metavar="PREFIX",
        help="only below these",
    )
    parser.add_argument("--param-type", action="store_true", help="show the types too")
    add_spin_time(parser)
    args = parser.parse(argv)
    failed = 0
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        for node in _nodes_to_list(session, args.node, args.include_hidden_nodes):
            try:
                rows = _rows(ParameterClient(session, node), args.param_prefixes, args.param_type)
            except OneBotError as error:
                if args.node:
                    raise
                print(f"error: {error}", file=sys.stderr)
                failed = 1
                continue
            if not args.node:
                print(f"{node}:")
            print("".join(f"  {row}\n" for row in rows), end="")
    return failed


def _nodes_to_list(session: Session, node: str | None, hidden: bool) -> list[str]:
    if node:
        return [session.find_node(node)]
    session.discover()
    served = {name for name, _ in session.services(hidden=True)}
    return [n for n in sorted(set(session.nodes(hidden))) if f"{n}/list_parameters" in served]


def _rows(client: ParameterClient, prefixes: Sequence[str], types: bool) -> list[str]:
    found = sorted(client.names(prefixes))
    if not types:
        return found
    kinds = client.describe(found)
    return [
        f"{name} (type: {parameter_values.type_label(kind.type)})"
        for name, kind in zip(found, kinds, strict=True)
    ]


def get(parser: Parser, argv: Sequence[str]) -> int:
    """Show a parameter; return the exit code."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    parser.add_argument("parameter", metavar="PARAMETER")
    parser.add_argument("--hide-type", action="store_true", help="print the value only")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        client = ParameterClient(session, session.find_node(args.node))
        value = client.get(args.parameter)
    if value.type == parameter_values.NOT_SET:
        print("None" if args.hide_type else "Parameter not set.")
    elif args.hide_type:
        print(parameter_values.value_of(value))
    else:
        print(parameter_values.label(value), parameter_values.value_of(value))
    return 0


def set_values(parser: Parser, argv: Sequence[str]) -> int:
    """Set parameters; return the exit code: 1 if the node rejected any."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    parser.add_argument(
        "pairs", nargs="+", metavar="PARAMETER VALUE", help="the value in YAML: 0.5, true, [a, b]"
    )
    add_allow_non_finite(parser)
    args = parser.parse(_guard_negative(argv))
    if len(args.pairs) % 2:
        raise UsageError(f"parameters come as name and value; {args.pairs[-1]} has no value")
    pairs = list(zip(args.pairs[::2], args.pairs[1::2], strict=True))
    with Session(args.ros_args) as session:
        client = ParameterClient(session, session.find_node(args.node))
        results = client.set(pairs, finite=not args.allow_non_finite)
    for (name, _), result in zip(pairs, results, strict=True):
        prefix = f"{name}: " if len(pairs) > 1 else ""
        _print_result(
            result, f"{prefix}Set parameter successful", f"{prefix}Setting parameter failed"
        )
    return 0 if all(result.successful for result in results) else 1


def _guard_negative(argv: Sequence[str]) -> list[str]:
    """Keep a value such as -1e-3 from being parsed as an option."""
    words = list(argv)
    if {"-h", "--help", "--", "--ros-args"} & set(words):
        return words
    options = [word for word in words if word == "--allow-non-finite"]
    return [*options, "--", *(word for word in words if word not in options)]


def _print_result(result: Any, done: str, failed: str) -> None:
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"{done}{reason}")
    else:
        print(f"{failed}{reason}", file=sys.stderr)


def load(parser: Parser, argv: Sequence[str]) -> int:
    """Set the parameters that a file has for a node; return 1 if the node rejected any."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    parser.add_argument("file", type=Path, metavar="FILE", help="such as param dump prints")
    parser.add_argument(
        "--no-use-wildcard", action="store_true", help="not what is for several nodes, as in /**"
    )
    add_allow_non_finite(parser)
    args = parser.parse(argv)
    text = read_text(args.file)
    with Session(args.ros_args) as session:
        node = session.find_node(args.node)
        found = read_parameters(text, str(args.file), node)
        if problem := no_section(found, [args.file], node):
            raise OneBotError(problem)
        pairs = [
            (name, parameter_values.quoted(value))
            for name, value in found.values.items()
            if not (args.no_use_wildcard and name in found.shared)
        ]
        client = ParameterClient(session, node)
        results = client.set(pairs, finite=not args.allow_non_finite)
    for (name, _), result in zip(pairs, results, strict=True):
        _print_result(result, f"Set parameter {name} successful", f"Set parameter {name} failed")
    return 0 if all(result.successful for result in results) else 1


def delete(parser: Parser, argv: Sequence[str]) -> int:
    """Unset a parameter; return the exit code: 1 if the node rejected it."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    parser.add_argument("parameter", metavar="PARAMETER")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        result = ParameterClient(session, session.find_node(args.node)).delete(args.parameter)
    _print_result(result, "Deleted parameter successfully", "Deleting parameter failed")
    return 0 if result.successful else 1


def describe(parser: Parser, argv: Sequence[str]) -> int:
    """Show what parameters are and may be; return the exit code."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    parser.add_argument("parameter", nargs="+", metavar="PARAMETER")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        client = ParameterClient(session, session.find_node(args.node))
        client.require(args.parameter)
        found = client.describe(args.parameter)
    for descriptor in found:
        print("\n".join(_described(descriptor)))
    return 0


def _described(descriptor: Any) -> Iterator[str]:
    yield f"Parameter name: {descriptor.name}"
    yield f"  Type: {parameter_values.type_label(descriptor.type)}"
    if descriptor.description:
        yield f"  Description: {descriptor.description}"
    yield "  Constraints:"
    if descriptor.read_only:
        yield "    Read only: true"
    for limits in (*descriptor.floating_point_range, *descriptor.integer_range):
        yield f"    Min value: {limits.from_value}"
        yield f"    Max value: {limits.to_value}"
        if limits.step:
            yield f"    Step: {limits.step}"
    if descriptor.additional_constraints:
        yield f"    Additional constraints: {descriptor.additional_constraints}"


def dump(parser: Parser, argv: Sequence[str]) -> int:
    """Print all parameters of a node as YAML; return the exit code."""
    parser.add_argument("node", metavar="NODE", help=_NODE)
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        node = session.find_node(args.node)
        client = ParameterClient(session, node)
        found = sorted(client.names())
        print(parameter_values.dump(node, found, client.values(found)))
    return 0


COMMANDS = {
    "list": Subcommand("list the parameters of a node, or of all", names),
    "get": Subcommand("show a parameter", get),
    "set": Subcommand("set a parameter", set_values),
    "delete": Subcommand("unset a parameter", delete),
    "describe": Subcommand("show what parameters are and may be", describe),
    "load": Subcommand("set the parameters that a file has for a node", load),
    "dump": Subcommand("print all parameters of a node as a parameter file", dump),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the node or parameter does not exist, or the command line is wrong.
    """
    return dispatch("param", COMMANDS, argv)
