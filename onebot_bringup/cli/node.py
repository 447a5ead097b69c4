"""``onebot node ...``: lists nodes and shows their interfaces, like ``ros2 node``."""

import sys
from collections.abc import Iterable, Sequence

from onebot_bringup.cli.options import Parser, Subcommand, dispatch, print_rows
from onebot_bringup.cli.session import Session, add_spin_time, is_hidden
from onebot_description.errors import OneBotError


def nodes(parser: Parser, argv: Sequence[str]) -> int:
    """List the nodes; return the exit code."""
    parser.add_argument("-a", "--all", action="store_true", help="hidden nodes too")
    parser.add_argument("-c", "--count-nodes", action="store_true", help="show their number only")
    add_spin_time(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        session.discover()
        found = session.nodes(args.all)
        print_rows(found, count=args.count_nodes)
        if len(set(found)) != len(found):
            _warn_of_duplicates(found)
    return 0


def _warn_of_duplicates(names: Sequence[str]) -> None:
    duplicates = ", ".join(sorted({name for name in names if names.count(name) > 1}))
    print(
        "WARNING: Be aware that there are nodes in the graph that share an exact name, which can "
        f"have unintended side effects: {duplicates}",
        file=sys.stderr,
    )


def info(parser: Parser, argv: Sequence[str]) -> int:
    """Show a node's topics, services and actions; return the exit code."""
    parser.add_argument("node", metavar="NODE", help="such as /robot_state_publisher")
    parser.add_argument("--include-hidden", action="store_true", help="hidden ones too")
    add_spin_time(parser)
    args = parser.parse(argv)
    from rclpy.action import (
        get_action_client_names_and_types_by_node,
        get_action_server_names_and_types_by_node,
    )
    from rclpy.node import NodeNameNonExistentError

    with Session(args.ros_args, spin_time=args.spin_time) as session:
        full = session.find_node(args.node)
        session.discover()
        space, _, name = full.rpartition("/")
        where = name, space or "/"
        node = session.node
        try:
            tables = (
                ("Subscribers", node.get_subscriber_names_and_types_by_node(*where)),
                ("Publishers", node.get_publisher_names_and_types_by_node(*where)),
                ("Service Servers", node.get_service_names_and_types_by_node(*where)),
                ("Service Clients", node.get_client_names_and_types_by_node(*where)),
                ("Action Servers", get_action_server_names_and_types_by_node(node, *where)),
                ("Action Clients", get_action_client_names_and_types_by_node(node, *where)),
            )
        except NodeNameNonExistentError:
            raise OneBotError(f'node "{full}" has just ended') from None
        print(full)
        for title, found in tables:
            print(f"  {title}:\n{_rows(found, args.include_hidden)}")
    return 0


def _rows(found: Iterable[tuple[str, list[str]]], hidden: bool) -> str:
    return "\n".join(
        f"    {name}: {', '.join(types)}"
        for name, types in sorted(found)
        if hidden or not is_hidden(name)
    )


COMMANDS = {
    "list": Subcommand("list the nodes", nodes),
    "info": Subcommand("show a node's topics and services", info),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the node does not exist, or the command line is wrong.
    """
    return dispatch("node", COMMANDS, argv)
