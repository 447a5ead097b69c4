"""``onebot node ...``: lists nodes and shows their interfaces, like ``ros2 node``."""

import sys
from argparse import Namespace

from onebot_bringup.cli.options import Subcommand, flag, positional
from onebot_bringup.cli.session import Session, in_session
from onebot_bringup.introspection.interfaces import is_hidden


@in_session
def nodes(session: Session, args: Namespace) -> None:
    """List the nodes."""
    session.discover()
    names = session.nodes(args.all)
    for name in names:
        print(name)
    if duplicates := sorted({name for name in names if names.count(name) > 1}):
        print(
            "WARNING: Be aware that there are nodes in the graph that share an exact name, which "
            f"can have unintended side effects: {', '.join(duplicates)}",
            file=sys.stderr,
        )


@in_session
def info(session: Session, args: Namespace) -> None:
    """Show a node's topics, services and actions."""
    from rclpy.action import (
        get_action_client_names_and_types_by_node,
        get_action_server_names_and_types_by_node,
    )

    full = session.find_node(args.node)
    session.discover()
    space, _, name = full.rpartition("/")
    where = name, space or "/"
    node = session.node
    tables = {
        "Subscribers": node.get_subscriber_names_and_types_by_node(*where),
        "Publishers": node.get_publisher_names_and_types_by_node(*where),
        "Service Servers": node.get_service_names_and_types_by_node(*where),
        "Service Clients": node.get_client_names_and_types_by_node(*where),
        "Action Servers": get_action_server_names_and_types_by_node(node, *where),
        "Action Clients": get_action_client_names_and_types_by_node(node, *where),
    }
    print(full)
    for title, entries in tables.items():
        rows = [
            f"    {name}: {', '.join(types)}"
            for name, types in sorted(entries)
            if args.include_hidden or not is_hidden(name)
        ]
        print(f"  {title}:", "\n".join(rows), sep="\n")


COMMANDS = {
    "list": Subcommand("list the nodes", nodes, flag("-a --all", "hidden nodes too")),
    "info": Subcommand(
        "show a node's topics and services",
        info,
        positional("NODE", "such as /robot_state_publisher"),
        flag("--include-hidden", "hidden ones too"),
    ),
}
