"""``onebot topic ...``: lists, prints, measures and publishes topics, like ``ros2 topic``."""

import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn

from onebot_bringup.cli import qos
from onebot_bringup.cli.names import TOPICS
from onebot_bringup.cli.options import (
    ALLOW_NON_FINITE,
    Group,
    Subcommand,
    count,
    expression,
    flag,
    natural,
    not_negative,
    option,
    positional,
    positive,
)
from onebot_bringup.cli.session import SPIN_TIME, Session, await_acknowledgements, in_session
from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.introspection.rates import Bandwidth, Intervals
from onebot_description.errors import OneBotError

_NO_MESSAGE = 2.0  # s without a message until echo prints a note
_NO_SUBSCRIBER = 2.0  # s without a subscriber until pub prints a note
_REPORT = 1.0  # s between reports of hz and bw
_SILENT_REPORTS = 2  # reports without any message until a note is printed
_SETTLE = 0.1  # s for further publishers to be discovered

_TOPIC = positional("TOPIC", "such as /joint_states")


def _await_class(
    session: Session, name: str, type_name: str | None = None, timeout: float | None = None
) -> tuple[str, Any]:
    """Return a topic's full name and its message class; wait until the topic exists.

    Args:
        session: its node discovers the topic.
        name: of the topic, absolute or relative.
        type_name: of the messages; None for the type of the topic.
        timeout: seconds; None for no end.

    Raises:
        OneBotError: the type is not installed, or the topic has several, or does not come in time.
    """
    topic = session.full_name(name)
    if type_name is not None:
        kind = message_class(type_name)
        # The QoS depends on the publishers: give them time to be discovered.
        session.spin(lambda: session.node.count_publishers(topic), 1.0)
        session.spin_for(_SETTLE)
        return topic, kind

    def notice() -> str:
        text = f"WARNING: topic [{topic}] does not appear to be published yet"
        return f"{text}{TOPICS.question(session, topic)}; waiting for it"

    if not session.await_or_report(lambda: TOPICS.types(session, topic), notice, timeout):
        raise OneBotError(f"no topic {topic} within {timeout:g} s")
    # Other publishers may have another QoS or even another type.
    session.spin_for(_SETTLE)
    _, types = TOPICS.find_types(session, topic)
    if len(types) > 1:
        raise OneBotError(
            f"Cannot echo topic '{topic}', as it contains more than one type: "
            f"[{', '.join(types)}]; name the one you want"
        )
    return topic, message_class(types[0])


@in_session
def echo(session: Session, args: Namespace) -> None:
    """Print the messages of a topic."""
    _Echo(session, args).run()


_ECHO = (
    _TOPIC,
    positional("TYPE", "such as sensor_msgs/msg/JointState (discovered)", nargs="?"),
    flag("--once", "print one message and exit"),
    option("--timeout", "S", "give up after S seconds", positive),
    option("--field", "FIELD", "print only a part: pose.pose.position, position[0]"),
    option(
        "--filter",
        "EXPR",
        "print only messages for which this Python expression of m, the message (or its FIELD), "
        "is true, such as 'm.linear.x > 0.1'",
        expression,
    ),
    flag("--csv", "print values separated by commas"),
    flag("--raw", "print the bytes on the wire"),
    flag("--flow-style", "one line per message"),
    flag("-f --full-length", "print lists and strings in full"),
    option("-l --truncate-length", "N", "cut lists and strings after N items (128)", natural, 128),
    flag("--no-arr", "print no list's items"),
    flag("--no-str", "print no strings"),
    flag("--no-lost-messages", "do not report lost messages"),
    SPIN_TIME,
    qos.options("compatible with the publishers"),
)


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

    def run(self) -> None:
        args = self._args
        began = time.monotonic()
        topic, kind = _await_class(self._session, args.topic, args.type, args.timeout)
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
        notice = partial(_no_message, self._session, topic, self._message)
        if not self._session.await_or_report(self._first, notice, left, _NO_MESSAGE):
            raise OneBotError(f"no {self._message} on {topic} within {args.timeout:g} s")
        while not args.once:
            self._session.spin(lambda: self._error is not None)
            self._first()

    def _first(self) -> bool:
        if self._error is not None:
            raise self._error
        return self._received

    def _events(self) -> Any:
        from rclpy.event_handler import SubscriptionEventCallbacks

        # The default callback that logs incompatible QoS stays.
        lost = None if self._args.no_lost_messages else _on_lost
        return SubscriptionEventCallbacks(message_lost=lost)

    def _on_message(self, message: Any) -> None:
        if self._error is not None or (self._received and self._args.once):
            return
        from onebot_bringup.introspection.message_text import pick

        try:
            part = pick(message, self._args.field) if self._args.field else message
            if self._passes(part):
                self._print(part)
                self._received = True
        except OneBotError as error:  # it is raised outside of the callback
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


def _no_message(session: Session, topic: str, message: str = "message") -> str:
    publishers = session.node.count_publishers(topic)
    who = f"{publishers} publisher(s)" if publishers else "no publisher"
    return f"note: no {message} on {topic} yet; {who}"


@in_session
def hz(session: Session, args: Namespace) -> NoReturn:
    """Print the rate of a topic each second."""
    meter, clock = Intervals(args.window), session.node.get_clock()

    def now() -> float:
        return time.monotonic() if args.wall_time else float(clock.now().nanoseconds * 1e-9)

    _measure(session, args, lambda _: meter.arrived(now()), meter.report)


@in_session
def bw(session: Session, args: Namespace) -> NoReturn:
    """Print the bandwidth of a topic each second."""
    meter = Bandwidth(args.window)
    _measure(
        session,
        args,
        lambda data: meter.arrived(time.monotonic(), len(data)),
        lambda: meter.report(time.monotonic()),
        announce=True,
    )


def _measurement(window: int) -> tuple[Any, ...]:
    """Return the options of a command that measures over so many messages."""
    text = f"measure over the last N messages ({window})"
    return (
        _TOPIC,
        option("-w --window", "N", text, count, window),
        SPIN_TIME,
        qos.options("compatible with the publishers"),
    )


def _measure(
    session: Session,
    args: Namespace,
    arrived: Callable[[bytes], None],
    report: Callable[[], str | None],
    *,
    announce: bool = False,
) -> NoReturn:
    topic, kind = _await_class(session, args.topic)
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
            print(_no_message(session, topic), file=sys.stderr)


@in_session
def topics(session: Session, args: Namespace) -> None:
    """List the topics."""
    if not args.verbose or args.count:
        TOPICS.print_names(session, args)
        return
    session.discover()
    for title, role, number_of in (
        ("Published", "publisher", session.node.count_publishers),
        ("Subscribed", "subscriber", session.node.count_subscribers),
    ):
        print(f"{title} topics:")
        for name, types in session.topics(args.hidden):
            if number := number_of(name):
                plural = "s" if number > 1 else ""
                print(f" * {name} [{', '.join(types)}] {number} {role}{plural}")
        print()


@in_session
def info(session: Session, args: Namespace) -> None:
    """Show the publishers and subscribers of a topic."""
    TOPICS.find_types(session, args.topic)
    session.discover()  # all endpoints, not only the first
    topic, types = TOPICS.find_types(session, args.topic)
    end, node = "\n\n" if args.verbose else "\n", session.node
    if args.verbose:
        session.spin(lambda: _all_named(node, topic), 1.0)
    print(f"Type: {types[0] if len(types) == 1 else types}", end=end)
    for title, number, endpoints in (
        ("Publisher", node.count_publishers(topic), node.get_publishers_info_by_topic),
        ("Subscription", node.count_subscribers(topic), node.get_subscriptions_info_by_topic),
    ):
        print(f"{title} count: {number}", end=end)
        for endpoint in endpoints(topic) if args.verbose else ():
            print(endpoint, end=end)


def _all_named(node: Any, topic: str) -> bool:
    """Whether the node of each endpoint is known; it is discovered after the endpoint."""
    ends = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
    return all("UNKNOWN" not in endpoint.node_name for endpoint in ends)


def pub(args: Namespace) -> None:
    """Publish messages given as YAML."""
    from onebot_bringup.introspection.message_text import fill

    kind = message_class(args.type)
    message = kind()
    values = sys.stdin.read() if args.stdin else args.values
    times = fill(message, values, finite=not args.allow_non_finite)
    with Session(args.ros_args, args.node_name) as session:
        _Publisher(session, args, kind).run(message, times)


_PUB = (
    positional("TOPIC", "such as /velocity_controller/cmd_vel"),
    positional("TYPE", "such as geometry_msgs/msg/Twist"),
    positional(
        "VALUES",
        'in YAML, such as "{linear: {x: 0.2}}"; other fields keep their defaults. '
        "A header may be auto, a time now",
        nargs="?",
        default="",
    ),
    flag("--stdin", "read the values from stdin"),
    option("-r --rate", "HZ", "messages per second (1)", positive, 1.0),
    option("-p --print", "N", "print every N-th message (1)", natural, 1),
    Group(
        (
            flag("-1 --once", "publish one message and exit"),
            option("-t --times", "N", "publish N and exit", count),
        )
    ),
    option(
        "-w --wait-matching-subscriptions",
        "N",
        "wait for N subscribers first (1 with --once or --times, else 0)",
        natural,
        dest="wait",
    ),
    option("--max-wait-time-secs", "S", "wait no longer than S seconds", positive),
    option("--keep-alive", "S", "wait before exit (0.1 s)", not_negative, 0.1),
    option("-n --node-name", "NAME", "name of the publishing node"),
    ALLOW_NON_FINITE,
    qos.options("default (reliable, volatile, depth 10)"),
)


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
        await_acknowledgements(self._publisher)
        self._session.spin_for(self._args.keep_alive)

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
        ends = self._session.node.get_subscriptions_info_by_topic(self._topic)
        types = sorted({end.topic_type for end in ends})
        if not types:
            return ""
        return f" (subscribers of {', '.join(types)} found; type and QoS have to match)"


_NAMES = TOPICS.commands()
_VERBOSE = "-v --verbose"

COMMANDS = {
    "pub": Subcommand("publish messages", pub, *_PUB),
    "echo": Subcommand("print messages as they are received", echo, *_ECHO),
    "list": Subcommand(
        "list the topics",
        topics,
        flag(_VERBOSE, "show the number of publishers and subscribers"),
        *_NAMES["list"].options,
    ),
    "info": Subcommand(
        "show the publishers and subscribers",
        info,
        _TOPIC,
        flag(_VERBOSE, "show each node and its quality of service"),
        SPIN_TIME,
    ),
    "type": _NAMES["type"],
    "find": _NAMES["find"],
    "hz": Subcommand(
        "measure the rate of messages",
        hz,
        flag("--wall-time", "by this computer's time, not a simulated one"),
        *_measurement(10000),
    ),
    "bw": Subcommand("measure the bandwidth", bw, *_measurement(100)),
}
