"""``onebot param ...``: lists, gets, sets and dumps parameters, like ``ros2 param``."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from onebot_bringup.cli.options import Parser, Subcommand, add_allow_non_finite, dispatch
from onebot_bringup.cli.session import Session, add_spin_time
from onebot_bringup.introspection import parameter_values
from onebot_bringup.introspection.parameter_client import ParameterClient
from onebot_bringup.introspection.parameter_values import NOT_SET
from onebot_bringup.launch.arguments import UsageError
from onebot_description.errors import OneBotError


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
    parser.add_argument("name", metavar="PARAMETER")
    parser.add_argument("--hide-type", action="store_true", help="print the value only")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        client = ParameterClient(session, session.find_node(args.node))
        value = client.get(args.name)
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
        _print_result(f"{name}: " if len(pairs) > 1 else "", result)
    return 0 if all(result.successful for result in results) else 1


def _guard_negative(argv: Sequence[str]) -> list[str]:
    """Keep a value such as -1e-3 from being parsed as an option."""
    words = list(argv)
    if {"-h", "--help", "--", "--ros-args"} & set(words):
        return words
    options = [word for word in words if word == "--allow-non-finite"]
    return [*options, "--", *(word for word in words if word not in options)]


def _print_result(prefix: str, result: Any) -> None:
    reason = f": {result.reason}" if result.reason else ""
    if result.successful:
        print(f"{prefix}Set parameter successful{reason}")
    else:
        print(f"{prefix}Setting parameter failed{reason}", file=sys.stderr)


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
    "dump": Subcommand("print all parameters of a node as a parameter file", dump),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the node or parameter does not exist, or the command line is wrong.
    """
    return dispatch("param", COMMANDS, argv)
