"""``onebot topic ...``: lists, prints, measures and publishes topics, like ``ros2 topic``."""

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from onebot_bringup.cli import qos
from onebot_bringup.cli.options import (
    Parser,
    Subcommand,
    add_allow_non_finite,
    count,
    dispatch,
    expression,
    listed,
    natural,
    not_negative,
    positive,
    print_rows,
    read_stdin,
)
from onebot_bringup.cli.session import Session, add_spin_time, await_class, types_of
from onebot_bringup.introspection.rates import Bandwidth, Intervals
from onebot_description.errors import OneBotError

_NO_MESSAGE = 2.0  # s without a message until echo prints a note
_NO_SUBSCRIBER = 2.0  # s without a subscriber until pub prints a note
_REPORT = 1.0  # s between reports of hz and bw
_SILENT_REPORTS = 2  # reports without any message until a note is printed

_Row = tuple[str, list[str], int]


def echo(parser: Parser, argv: Sequence[str]) -> int:
    """Print the messages of a topic; return the exit code.

    Raises:
        OneBotError: the type is not installed, or the field does not exist.
    """
    _add_echo_arguments(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        return _Echo(session, args).run()


def _add_echo_arguments(parser: Parser) -> None:
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "type", nargs="?", metavar="TYPE", help="such as sensor_msgs/msg/JointState (discovered)"
    )
    parser.add_argument("--once", action="store_true", help="print one message and exit")
    parser.add_argument("--timeout", type=positive, metavar="S", help="give up after S seconds")
    parser.add_argument(
        "--field", metavar="FIELD", help="print only a part: pose.pose.position, position[0]"
    )
    parser.add_argument(
        "--filter", type=expression, metavar="EXPR",
        help="print only messages for which this Python expression of m, the message (or its "
        "FIELD), is true, such as 'm.linear.x > 0.1'",
    )  # fmt: skip
    parser.add_argument("--csv", action="store_true", help="print values separated by commas")
    parser.add_argument("--raw", action="store_true", help="print the bytes on the wire")
    parser.add_argument("--flow-style", action="store_true", help="one line per message")
    parser.add_argument(
        "-f", "--full-length", action="store_true", help="print lists and strings in full"
    )
    parser.add_argument(
        "-l",
        "--truncate-length",
        type=natural,
        default=128,
        metavar="N",
        help="cut lists and strings after N items (128)",
    )
    parser.add_argument("--no-arr", action="store_true", help="print no list's items")
    parser.add_argument("--no-str", action="store_true", help="print no strings")
    parser.add_argument(
        "--no-lost-messages", action="store_true", help="do not report lost messages"
    )
    add_spin_time(parser)
    qos.add_arguments(parser, "compatible with the publishers")


class _Echo:
    def __init__(self, session: Session, args: Namespace) -> None:
        from onebot_bringup.introspection.message_text import Style

        self._session, self._args = session, args
        self._style = Style(
            longest=None if args.full_length else args.truncate_length,
            arrays=not args.no_arr,
            strings=not args.no_str,
            flow=args.flow_style,
        )
        self._message = "message that passes --filter" if args.filter else "message"
        self._received = False  # such a message
        self._error: OneBotError | None = None

    def run(self) -> int:
        args = self._args
        began = time.monotonic()
        topic, kind = await_class(self._session, args.topic, args.type, args.timeout)
        self._session.node.create_subscription(
            kind,
            topic,
            self._on_message,
            qos.matching(self._session.node, topic, args),
            event_callbacks=self._events(),
            raw=args.raw,
        )
        # What it took to find the topic counts, too.
        left = args.timeout and max(0.0, args.timeout - (time.monotonic() - began))
        first = _NO_MESSAGE if left is None else min(_NO_MESSAGE, left)
        if not self._session.spin(self._first, first):
            if left is None or left > _NO_MESSAGE:
                self._report_no_message(topic)
            left = None if left is None else left - first
            if not self._session.spin(self._first, left):
                raise OneBotError(f"no {self._message} on {topic} within {args.timeout:g} s")
        if not args.once:
            self._session.spin(lambda: self._check() and False)
        return 0

    def _first(self) -> bool:
        self._check()
        return self._received

    def _check(self) -> bool:
        if self._error is not None:
            raise self._error
        return True

    def _events(self) -> Any:
        from rclpy.event_handler import SubscriptionEventCallbacks

        # The default callback that logs incompatible QoS stays.
        lost = None if self._args.no_lost_messages else _on_lost
        return SubscriptionEventCallbacks(message_lost=lost)

    def _report_no_message(self, topic: str) -> None:
        publishers = self._session.node.count_publishers(topic)
        who = f"{publishers} publisher(s)" if publishers else "no publisher"
        print(f"note: no {self._message} on {topic} yet; {who}", file=sys.stderr)

    def _on_message(self, message: Any) -> None:
        if self._error is not None or (self._received and self._args.once):
            return
        from onebot_bringup.introspection.message_text import pick

        try:
            part = pick(message, self._args.field) if self._args.field else message
            if self._passes(part):
                self._print(part)
                self._received = True
        except OneBotError as error:  # to be raised outside of the callback
            self._error = error

    def _passes(self, part: Any) -> bool:
        if self._args.filter is None:
            return True
        try:
            return bool(eval(self._args.filter, {"m": part}))
        except Exception as error:  # whatever the user's expression raises
            raise OneBotError(f"--filter: {type(error).__name__}: {error}") from None

    def _print(self, part: Any) -> None:
        from onebot_bringup.introspection.message_text import is_message, to_csv, to_yaml

        if self._args.csv and not self._args.raw:
            print(to_csv(part, self._style))
        elif is_message(part):
            print(to_yaml(part, self._style), end="---\n")
        else:
            print(part, end="\n---\n")


def _on_lost(status: Any) -> None:
    print(
        "A message was lost!!!\n"
        f"\ttotal count change:{status.total_count_change}\n"
        f"\ttotal count: {status.total_count}",
        file=sys.stderr,
    )


def hz(parser: Parser, argv: Sequence[str]) -> int:
    """Print the rate of a topic each second; return the exit code."""
    parser.add_argument(
        "--wall-time", action="store_true", help="by this computer's time, not a simulated one"
    )
    args = _parse_measurement(parser, argv, 10000)
    meter = Intervals(args.window)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        clock = session.node.get_clock()

        def now() -> float:
            return time.monotonic() if args.wall_time else clock.now().nanoseconds * 1e-9

        _measure(session, args, lambda _: meter.arrived(now()), meter.report)


def bw(parser: Parser, argv: Sequence[str]) -> int:
    """Print the bandwidth of a topic each second; return the exit code."""
    args = _parse_measurement(parser, argv, 100)
    meter = Bandwidth(args.window)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        _measure(
            session,
            args,
            lambda data: meter.arrived(time.monotonic(), len(data)),
            lambda: meter.report(time.monotonic()),
            announce=True,
        )


def _parse_measurement(parser: Parser, argv: Sequence[str], window: int) -> Namespace:
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "-w", "--window", type=count, default=window, metavar="N",
        help=f"measure over the last N messages ({window})",
    )  # fmt: skip
    add_spin_time(parser)
    qos.add_arguments(parser, "compatible with the publishers")
    return parser.parse(argv)


def _measure(
    session: Session,
    args: Namespace,
    arrived: Callable[[bytes], None],
    report: Callable[[], str | None],
    *,
    announce: bool = False,
) -> NoReturn:
    topic, kind = await_class(session, args.topic)
    received = 0

    def on_message(data: bytes) -> None:
        nonlocal received
        received += 1
        arrived(data)

    session.node.create_subscription(
        kind, topic, on_message, qos.matching(session.node, topic, args), raw=True
    )
    if announce:
        print(f"Subscribed to [{topic}]")
    due, rounds = time.monotonic() + _REPORT, 0
    while True:
        session.spin_until(due)
        due, rounds = due + _REPORT, rounds + 1
        text = report()
        if text is not None:
            print(text)
        elif rounds == _SILENT_REPORTS and not received:
            publishers = session.node.count_publishers(topic)
            print(f"note: no message on {topic} yet; publishers: {publishers}", file=sys.stderr)


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
        if args.verbose and not args.count_topics:
            node = session.node
            published = [(name, types, node.count_publishers(name)) for name, types in found]
            subscribed = [(name, types, node.count_subscribers(name)) for name, types in found]
            print(_verbose("Published", "publisher", published))
            print(_verbose("Subscribed", "subscriber", subscribed))
        else:
            print_rows(listed(found, args.show_types), count=args.count_topics)
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
    """Show the publishers and subscribers of a topic; return the exit code."""
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show each node and its quality of service"
    )
    add_spin_time(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        topic, _ = types_of(session, args.topic)
        session.discover()  # all endpoints, not only the first
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
    """Whether the node of each endpoint is known; it is discovered after the endpoint."""
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
        print_rows(names, count=args.count_topics)
    return 0


def pub(parser: Parser, argv: Sequence[str]) -> int:
    """Publish messages given as YAML; return the exit code.

    Raises:
        OneBotError: the type is not installed, or a value is wrong.
    """
    _add_pub_arguments(parser)
    args = parser.parse(argv)
    from onebot_bringup.introspection.interfaces import message_class
    from onebot_bringup.introspection.message_text import fill

    kind = message_class(args.type)
    message = kind()
    times = fill(message, _values(args), finite=not args.allow_non_finite)
    with Session(args.ros_args, args.node_name) as session:
        _Publisher(session, args, kind).run(message, times)
    return 0


def _add_pub_arguments(parser: Parser) -> None:
    parser.add_argument("topic", metavar="TOPIC", help="such as /velocity_controller/cmd_vel")
    parser.add_argument("type", metavar="TYPE", help="such as geometry_msgs/msg/Twist")
    parser.add_argument(
        "values",
        nargs="?",
        metavar="VALUES",
        help='in YAML, such as "{linear: {x: 0.2}}"; other fields keep their defaults. '
        "A header may be auto, a time now",
    )
    parser.add_argument("--stdin", action="store_true", help="read the values from stdin")
    parser.add_argument(
        "-r", "--rate", type=positive, default=1.0, metavar="HZ", help="messages per second (1)"
    )
    parser.add_argument(
        "-p", "--print", type=natural, default=1, metavar="N", help="print every N-th message (1)"
    )
    number = parser.add_mutually_exclusive_group()
    number.add_argument("-1", "--once", action="store_true", help="publish one message and exit")
    number.add_argument("-t", "--times", type=count, metavar="N", help="publish N and exit")
    parser.add_argument(
        "-w",
        "--wait-matching-subscriptions",
        dest="wait",
        type=natural,
        metavar="N",
        help="wait for N subscribers first (1 with --once or --times, else 0)",
    )
    parser.add_argument(
        "--max-wait-time-secs", type=positive, metavar="S", help="wait no longer than S seconds"
    )
    parser.add_argument(
        "--keep-alive",
        type=not_negative,
        default=0.1,
        metavar="S",
        help="wait before exit (0.1 s)",
    )
    parser.add_argument("-n", "--node-name", metavar="NAME", help="name of the publishing node")
    add_allow_non_finite(parser)
    qos.add_arguments(parser, "default (reliable, volatile, depth 10)")


def _values(args: Namespace) -> str:
    if args.stdin:
        return read_stdin()
    return args.values or ""


class _Publisher:
    def __init__(self, session: Session, args: Namespace, kind: Any) -> None:
        self._session, self._args = session, args
        self._topic = session.full_name(args.topic)
        self._publisher = session.node.create_publisher(
            kind, self._topic, qos.profile(args, "default")
        )
        self._number = 0

    def run(self, message: Any, times: list[Any]) -> None:
        most = 1 if self._args.once else self._args.times
        wait = self._args.wait if self._args.wait is not None else int(most is not None)
        self._await_subscribers(wait)
        print("publisher: beginning loop")
        self._loop(message, times, most)
        self._finish()

    def _await_subscribers(self, number: int) -> None:
        began = reported = time.monotonic() - 1.0
        limit = self._args.max_wait_time_secs
        while self._publisher.get_subscription_count() < number:
            now = time.monotonic()
            if limit is not None and now - began - 1.0 > limit:
                raise OneBotError(
                    f"timed out after {limit:g} s: fewer than {number} matching subscription(s) of "
                    f"{self._topic}{self._others()}"
                )
            if now - reported >= 1.0:
                print(f"Waiting for at least {number} matching subscription(s)...{self._others()}")
                reported = now
            self._session.spin_until(now + 0.05)

    def _loop(self, message: Any, times: list[Any], most: int | None) -> None:
        from onebot_bringup.introspection.message_text import stamp

        period, began = 1.0 / self._args.rate, time.monotonic()
        due, check = began, self._args.wait != 0 or most is None
        while True:
            stamp(times, self._session.node.get_clock().now().nanoseconds)
            self._number += 1
            if self._args.print and self._number % self._args.print == 0:
                print(f"publishing #{self._number}: {message!r}\n")
            self._publisher.publish(message)
            if self._number == most:
                return
            # After a suspend of the computer it continues without catching up.
            due = max(due + period, time.monotonic() - period)
            if check and time.monotonic() - began > _NO_SUBSCRIBER:
                check = False
                self._report_no_subscriber()
            self._session.spin_until(due)

    def _report_no_subscriber(self) -> None:
        if self._publisher.get_subscription_count() == 0:
            print(f"note: no subscriber of {self._topic}{self._others()}", file=sys.stderr)

    def _others(self) -> str:
        """The subscribers with another type or an incompatible QoS, as text."""
        found = self._session.node.get_subscriptions_info_by_topic(self._topic)
        types = sorted({info.topic_type for info in found})
        if not types:
            return ""
        return f" (subscribers of {', '.join(types)} found; type and QoS have to match)"

    def _finish(self) -> None:
        from rclpy.duration import Duration

        if self._publisher.get_subscription_count():
            self._publisher.wait_for_all_acked(Duration(seconds=1.0))
        self._session.spin_until(time.monotonic() + self._args.keep_alive)


COMMANDS = {
    "pub": Subcommand("publish messages", pub),
    "echo": Subcommand("print messages as they are received", echo),
    "list": Subcommand("list the topics", topics),
    "info": Subcommand("show the publishers and subscribers", info),
    "type": Subcommand("show a topic's type", type_of),
    "find": Subcommand("list the topics of a type", find),
    "hz": Subcommand("measure the rate of messages", hz),
    "bw": Subcommand("measure the bandwidth", bw),
}


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: a name or a value is wrong, or the command line is.
    """
    return dispatch("topic", COMMANDS, argv)
