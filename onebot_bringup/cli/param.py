"""``onebot param ...``: lists, gets, sets and dumps parameters, like ``ros2 param``."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from onebot_bringup.cli.options import Parser, Subcommand, dispatch
from onebot_bringup.cli.session import Session, add_spin_time
from onebot_bringup.introspection import parameter_values
from onebot_bringup.introspection.parameter_values import NOT_SET, parse_value
from onebot_bringup.launch.arguments import UsageError
from onebot_description.errors import OneBotError, did_you_mean

_REPEAT = 1.0  # s without a response until a request is sent again
_ATTEMPTS = 5
_ANSWER = _REPEAT * _ATTEMPTS  # s for a service to be discovered, and again for its response


class ParameterClient:
    """Calls the parameter services of one node.

    All methods raise an OneBotError if the node does not answer.
    """

    def __init__(self, session: Session, node: str) -> None:
        """Call the node of this full name."""
        self._session, self._node = session, node

    def _call(self, service: str, **fields: Any) -> Any:
        from rcl_interfaces import srv

        kind = getattr(srv, service)
        name = {
            "ListParameters": "list_parameters",
            "GetParameters": "get_parameters",
            "DescribeParameters": "describe_parameters",
            "SetParameters": "set_parameters",
        }[service]
        client = self._session.node.create_client(kind, f"{self._node}/{name}")
        try:
            return self._response(client, kind.Request(**fields))
        finally:
            self._session.node.destroy_client(client)

    def _response(self, client: Any, request: Any) -> Any:
        """Send a request until there is a response.

        A server drops its response if it has not discovered the client yet, as it may when the
        machine is busy. All these requests may be repeated.
        """
        session, name = self._session, client.srv_name
        if not session.spin(client.service_is_ready, _ANSWER):
            raise OneBotError(f"the service {name} is not available")
        futures = []
        for _ in range(_ATTEMPTS):
            futures.append(client.call_async(request))
            if answered := session.spin(lambda: [f for f in futures if f.done()], _REPEAT):
                return answered[0].result()
        raise OneBotError(f"the service {name} does not answer (waited {_ANSWER:g} s)")

    def names(self, prefixes: Sequence[str] = ()) -> list[str]:
        """Return the names of all parameters, or of those below the prefixes."""
        return list(self._call("ListParameters", prefixes=list(prefixes)).result.names)

    def values(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterValue for each name; its type is NOT_SET where there is no value."""
        from rcl_interfaces.msg import ParameterValue

        found = list(self._call("GetParameters", names=list(names)).values)
        if len(found) == len(names):
            return found
        # rclpy and rclcpp return no value at all when one parameter of the request has none.
        if len(names) == 1:
            return [ParameterValue()]
        return [value for name in names for value in self.values([name])]

    def describe(self, names: Sequence[str]) -> list[Any]:
        """Return a ParameterDescriptor for each name, if all exist."""
        return list(self._call("DescribeParameters", names=list(names)).descriptors)

    def get(self, name: str) -> Any:
        """Return one ParameterValue.

        Raises:
            OneBotError: the parameter does not exist; the message lists similar names.
        """
        [value] = self.values([name])
        if value.type == NOT_SET and name not in (known := self.names()):
            raise OneBotError(
                f'{self._node} has no parameter "{name}"{did_you_mean(name, known, "parameters")}'
            )
        return value

    def set(self, pairs: Sequence[tuple[str, str]]) -> list[Any]:
        """Set parameters to values in YAML; return a SetParametersResult each."""
        from rcl_interfaces.msg import Parameter, ParameterValue

        request = []
        for name, text in pairs:
            field, kind, value = parse_value(text, self._declared(name))
            request.append(Parameter(name=name, value=ParameterValue(type=kind, **{field: value})))
        return list(self._call("SetParameters", parameters=request).results)

    def _declared(self, name: str) -> int:
        """The type of a statically typed parameter; NOT_SET if it is dynamic or undeclared."""
        found = self.describe([name])
        return int(found[0].type) if found and not found[0].dynamic_typing else NOT_SET


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
    args = parser.parse(_guard_negative(argv))
    if len(args.pairs) % 2:
        raise UsageError(f"parameters come as name and value; {args.pairs[-1]} has no value")
    pairs = list(zip(args.pairs[::2], args.pairs[1::2], strict=True))
    with Session(args.ros_args) as session:
        client = ParameterClient(session, session.find_node(args.node))
        results = client.set(pairs)
    for (name, _), result in zip(pairs, results, strict=True):
        _print_result(f"{name}: " if len(pairs) > 1 else "", result)
    return 0 if all(result.successful for result in results) else 1


def _guard_negative(argv: Sequence[str]) -> list[str]:
    """Keep a value such as -1e-3 from being parsed as an option."""
    words = list(argv)
    options = [word for word in words if word in ("-h", "--help")]
    return words if options or "--" in words or "--ros-args" in words else ["--", *words]


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
