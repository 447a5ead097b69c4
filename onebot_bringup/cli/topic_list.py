"""``onebot topic list, info, type, find``: which topics there are."""

from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli.ros_session import Session, add_spin_time
from onebot_bringup.cli.subcommands import Parser
from onebot_bringup.cli.topic_types import types_of

_Row = tuple[str, list[str], int]


def topics(parser: Parser, argv: Sequence[str]) -> int:
    """List the topics; return the exit code."""
    parser.add_argument("-t", "--show-types", action="store_true", help="show the types too")
    parser.add_argument(
        "-c", "--count-topics", "--count", action="store_true", help="show their number only"
    )
    _add_hidden(parser)
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show the number of publishers and subscribers"
    )
    add_spin_time(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        session.discover()
        found = session.topics(args.include_hidden_topics)
        if args.count_topics:
            print(len(found))
        elif args.verbose:
            node = session.node
            published = [(name, types, node.count_publishers(name)) for name, types in found]
            subscribed = [(name, types, node.count_subscribers(name)) for name, types in found]
            print(_verbose("Published", "publisher", published))
            print(_verbose("Subscribed", "subscriber", subscribed))
        else:
            for name, types in found:
                print(f"{name} [{', '.join(types)}]" if args.show_types else name)
    return 0


def _add_hidden(parser: Parser) -> None:
    parser.add_argument(
        "-a", "--all", "--include-hidden-topics",
        dest="include_hidden_topics", action="store_true", help="hidden topics too",
    )  # fmt: skip


def _verbose(title: str, role: str, rows: list[_Row]) -> str:
    text = f"{title} topics:\n"
    for name, types, number in rows:
        if number:
            plural = "s" if number > 1 else ""
            text += f" * {name} [{', '.join(types)}] {number} {role}{plural}\n"
    return text


def info(parser: Parser, argv: Sequence[str]) -> int:
    """Show who publishes a topic and who listens; return the exit code."""
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show each node and its quality of service"
    )
    add_spin_time(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        topic, _ = types_of(session, args.topic)
        session.discover()  # all who take part, not just the first
        topic, types = types_of(session, args.topic)
        end = "\n\n" if args.verbose else "\n"
        node = session.node
        if args.verbose:
            session.spin(lambda: _all_named(node, topic), 1.0)
        print(f"Type: {types[0] if len(types) == 1 else types}", end=end)
        print(f"Publisher count: {node.count_publishers(topic)}", end=end)
        if args.verbose:
            for endpoint in node.get_publishers_info_by_topic(topic):
                print(endpoint, end=end)
        print(f"Subscription count: {node.count_subscribers(topic)}", end=end)
        if args.verbose:
            for endpoint in node.get_subscriptions_info_by_topic(topic):
                print(endpoint, end=end)
    return 0


def _all_named(node: Any, topic: str) -> bool:
    """Say if it is known of all endpoints whose they are; that comes a little later."""
    found = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
    return all("UNKNOWN" not in endpoint.node_name for endpoint in found)


def type_of(parser: Parser, argv: Sequence[str]) -> int:
    """Show a topic's type; return the exit code."""
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        print("\n".join(types_of(session, args.topic)[1]))
    return 0


def find(parser: Parser, argv: Sequence[str]) -> int:
    """List the topics of a type; return the exit code."""
    parser.add_argument("type", metavar="TYPE", help="such as geometry_msgs/msg/Twist")
    parser.add_argument("-c", "--count-topics", action="store_true", help="show their number only")
    _add_hidden(parser)
    add_spin_time(parser)
    args = parser.parse(argv)
    from onebot_bringup.introspection.interfaces import full_name

    wanted = full_name(args.type, "msg")
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        session.discover()
        rows = session.topics(args.include_hidden_topics)
        names = [name for name, types in rows if wanted in types]
        print(len(names) if args.count_topics else "\n".join(names), end="\n" if names else "")
    return 0
