"""``onebot service ...``: lists services and calls them, like ``ros2 service``."""

import sys
import time
from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli.options import (
    Parser,
    Subcommand,
    add_allow_non_finite,
    dispatch,
    listed,
    positive,
    print_rows,
    read_stdin,
)
from onebot_bringup.cli.session import Session, add_spin_time
from onebot_description.errors import OneBotError, did_you_mean, nearest

_SLOW = 2.0  # s without a response until a note is printed


def services(parser: Parser, argv: Sequence[str]) -> int:
    """List the services; return the exit code."""
    parser.add_argument("-t", "--show-types", action="store_true", help="show the types too")
    _add_listing(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        session.discover()
        found = session.services(args.hidden)
    print_rows(listed(found, args.show_types), count=args.count_services)
    return 0


def _add_listing(parser: Parser) -> None:
    parser.add_argument("-c", "--count-services", action="store_true", help="only their number")
    parser.add_argument(
        "-a", "--all", "--include-hidden-services",
        dest="hidden", action="store_true", help="hidden services too",
    )  # fmt: skip
    add_spin_time(parser)


def find(parser: Parser, argv: Sequence[str]) -> int:
    """List the services of a type; return the exit code."""
    parser.add_argument("type", metavar="TYPE", help="such as std_srvs/srv/Trigger")
    _add_listing(parser)
    args = parser.parse(argv)
    from onebot_bringup.introspection.interfaces import full_name

    wanted = full_name(args.type, "srv")
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        session.discover()
        names = [name for name, types in session.services(args.hidden) if wanted in types]
    print_rows(names, count=args.count_services)
    return 0


def type_of(parser: Parser, argv: Sequence[str]) -> int:
    """Show a service's type; return the exit code."""
    parser.add_argument("service", metavar="SERVICE")
    args = parser.parse(argv)
    with Session(args.ros_args) as session:
        name = session.full_name(args.service)
        types = session.look_for(lambda: _types(session, name), f"the service {name}")
        if not types:
            known = [known for known, _ in session.services()]
            raise OneBotError(f"Unknown service '{name}'{did_you_mean(name, known, 'services')}")
        print("\n".join(types))
    return 0


def call_service(parser: Parser, argv: Sequence[str]) -> int:
    """Call a service; return the exit code."""
    parser.add_argument("service", metavar="SERVICE", help="such as /reset")
    parser.add_argument("type", metavar="TYPE", help="such as std_srvs/srv/Trigger")
    parser.add_argument(
        "values", nargs="?", default="", metavar="VALUES", help='in YAML, such as "{data: true}"'
    )
    parser.add_argument("--stdin", action="store_true", help="read the values from stdin")
    parser.add_argument("-r", "--rate", type=positive, metavar="HZ", help="call again and again")
    add_allow_non_finite(parser)
    args = parser.parse(argv)
    from onebot_bringup.introspection.interfaces import full_name, service_class
    from onebot_bringup.introspection.message_text import fill, stamp

    kind = service_class(args.type)
    request = kind.Request()
    values = read_stdin() if args.stdin else args.values
    times = fill(request, values, finite=not args.allow_non_finite)
    with Session(args.ros_args) as session:
        name = session.full_name(args.service)
        client = session.node.create_client(kind, name)
        _await_service(session, client, name, full_name(args.type, "srv"))
        while True:
            began = time.monotonic()
            stamp(times, session.node.get_clock().now().nanoseconds)
            print(f"requester: making request: {request!r}\n")
            print(f"response:\n{_answer(session, client, name, request)!r}\n")
            if args.rate is None:
                return 0
            session.spin_until(began + 1.0 / args.rate)


def _await_service(session: Session, client: Any, name: str, wanted: str) -> None:
    if client.service_is_ready():
        return
    print("waiting for service to become available...")

    def ready() -> bool:
        if client.service_is_ready():
            return True
        types = _offered(session, name)
        if types and wanted not in types:
            raise OneBotError(f"the service {name} is a {', '.join(sorted(types))}, not a {wanted}")
        return False

    session.await_or_report(ready, lambda: _missing(session, name))


def _offered(session: Session, name: str) -> set[str]:
    """The types of a service's servers; the graph would include clients, such as this one."""
    from rclpy.node import NodeNameNonExistentError

    types: set[str] = set()
    for node, space in session.node.get_node_names_and_namespaces():
        try:
            found = session.node.get_service_names_and_types_by_node(node, space)
        except NodeNameNonExistentError:  # it has just ended, or its name is not known yet
            continue
        types.update(kind for known, kinds in found if known == name for kind in kinds)
    return types


def _missing(session: Session, name: str) -> str:
    guess = nearest(name, (known for known, _ in session.services() if known != name))
    meant = f' (did you mean "{guess}"?)' if guess else ""
    return f"note: no server of {name} yet{meant}"


def _answer(session: Session, client: Any, name: str, request: Any) -> Any:
    future = client.call_async(request)
    if not session.spin(future.done, _SLOW):
        print(f"note: {name} has not answered yet", file=sys.stderr)
        session.spin(future.done)
    return future.result()


def _types(session: Session, name: str) -> list[str]:
    return list(dict(session.node.get_service_names_and_types()).get(name, []))


COMMANDS = {
    "call": Subcommand("call a service", call_service),
    "find": Subcommand("list the services of a type", find),
    "list": Subcommand("list the services", services),
    "type": Subcommand("show a service's type", type_of),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: a type, value or name is wrong, or the command line is.
    """
    return dispatch("service", COMMANDS, argv)
