"""``onebot service ...``: lists services and calls them, like ``ros2 service``."""

from argparse import Namespace

from onebot_bringup.cli.names import SERVICES
from onebot_bringup.cli.options import ALLOW_NON_FINITE, Subcommand, positional
from onebot_bringup.cli.session import Session
from onebot_description.errors import OneBotError

_SLOW = 2.0  # s without a response after which a note is printed


def call_service(args: Namespace) -> None:
    """Call a service."""
    from onebot_bringup.introspection.interfaces import full_name, service_class
    from onebot_bringup.introspection.message_text import fill, stamp

    kind = service_class(args.type)
    request = kind.Request()
    times = fill(request, args.values, finite=not args.allow_non_finite)
    with Session(args.ros_args) as session:
        name = session.full_name(args.service)
        _await_service(session, name, full_name(args.type, "srv"))
        client = session.node.create_client(kind, name)
        session.spin(client.service_is_ready)
        stamp(times, session.node.get_clock().now().nanoseconds)
        print(f"requester: making request: {request!r}\n")
        future = client.call_async(request)
        notice = f"note: {name} has not answered yet"
        session.await_or_report(future.done, lambda: notice, patience=_SLOW)
        print(f"response:\n{future.result()!r}\n")


def _await_service(session: Session, name: str, kind: str) -> None:
    """Wait for a server; without a client of this process, which would count as an endpoint."""
    print("waiting for service to become available...")
    types = session.await_or_report(
        lambda: SERVICES.types(session, name),
        lambda: f"note: no server of {name} yet{SERVICES.question(session, name)}",
    )
    if kind not in types:
        raise OneBotError(f"the service {name} is a {', '.join(types)}, not a {kind}")


COMMANDS = {
    "call": Subcommand(
        "call a service",
        call_service,
        positional("SERVICE", "such as /reset"),
        positional("TYPE", "such as std_srvs/srv/Trigger"),
        positional("VALUES", 'in YAML, such as "{data: true}"', nargs="?", default=""),
        ALLOW_NON_FINITE,
    ),
    "list": SERVICES.listing(),
}
