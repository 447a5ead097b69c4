"""``onebot topic ...``: lists, prints, measures and publishes topics, like ``ros2 topic``."""

import itertools
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn

from onebot_bringup.cli.names import TOPICS
from onebot_bringup.cli.options import (
    ALLOW_NON_FINITE,
    Option,
    Subcommand,
    count,
    flag,
    natural,
    option,
    positional,
    positive,
)
from onebot_bringup.cli.session import Session, await_acknowledgements, in_session
from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.introspection.rates import Arrivals
from onebot_description.errors import OneBotError

_NO_MESSAGE = 2.0  # s without a message after which a note is printed
_NO_SUBSCRIBER = 2.0  # s without a subscriber after which pub prints a note
_REPORT = 1.0  # s between reports of hz and bw
_SETTLE = 0.1  # s to discover further publishers
_KEEP_ALIVE = 0.1  # s before pub exits, for subscribers that acknowledge nothing

_TOPIC = positional("TOPIC", "such as /joint_states")
_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("transient_local", "volatile"),
}


def _qos_options(default: str) -> tuple[Option, ...]:
    """Return the options; ``default`` describes in the help which profile is used without them."""
    presets = ("default", "sensor_data")
    return (
        option("--qos-profile", None, f"a preset to start from ({default})", choices=presets),
        option("--qos-depth", "N", "queue size", natural),
        *(option(f"--qos-{name}", None, None, choices=_POLICIES[name]) for name in _POLICIES),
    )


def _profile(args: Namespace, preset: str) -> Any:
    """Return the profile that the options define, starting from a preset."""
    from rclpy import qos

    chosen = qos.QoSPresetProfiles.get_from_short_key(args.qos_profile or preset)
    for name in _POLICIES:
        if key := getattr(args, f"qos_{name}"):
            policy = getattr(qos, f"{name.capitalize()}Policy")
            setattr(chosen, name, policy.get_from_short_key(key))
    if args.qos_depth is not None:
        chosen.depth = args.qos_depth
    return chosen


def _matching(node: Any, topic: str, args: Namespace) -> Any:
    """Return the strictest profile that is compatible with all publishers of a topic.

    The options take precedence. Without publishers it is ``sensor_data``, compatible with any.
    """
    from onebot_description.ros.topic_qos import compatible_qos, is_transient_local

    chosen = _profile(args, "sensor_data")
    offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    is_given = any(value is not None for name, value in vars(args).items() if name[:4] == "qos_")
    if is_given or not offered:
        return chosen
    suited = compatible_qos(offered, chosen.depth)
    if is_transient_local(suited):  # receive everything that publishers of a latched topic keep
        suited.depth = max(suited.depth, 100)
    return suited


def _await_class(
    session: Session, name: str, type_name: str | None = None, timeout: float | None = None
) -> tuple[str, Any]:
    """Return a topic's full name and its message class; wait up to ``timeout`` (s) for the topic.

    Raises:
        OneBotError: its type is not installed, it has several types, or it does not come in time.
    """
    topic = session.full_name(name)
    if type_name is not None:
        kind = message_class(type_name)
        # The QoS depends on the publishers, so allow time to discover them.
        session.spin(lambda: session.node.count_publishers(topic), 1.0)
        session.spin_for(_SETTLE)
        return topic, kind
    if not session.await_or_report(
        lambda: TOPICS.types(session, topic),
        lambda: (
            f"WARNING: topic [{topic}] does not appear to be published yet; waiting for it"
            f"{TOPICS.question(session, topic)}"
        ),
        timeout,
    ):
        raise OneBotError(f"no topic {topic} within {timeout:g} s")
    # Further publishers may have another QoS or even another type.
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
    from onebot_bringup.introspection.message_text import is_message, pick
    from onebot_description.ros.packages.rosidl_runtime_py.convert import (
        message_to_csv,
        message_to_yaml,
    )

    longest = None if args.full_length else args.truncate_length
    options: dict[str, Any] = {"truncate_length": longest, "no_arr": args.no_arr}
    printed = 0

    def on_message(message: Any) -> None:
        nonlocal printed
        part = pick(message, args.field) if args.field else message
        if args.once and printed or not _passes(part, args.filter):
            return
        printed += 1
        if args.csv:
            print(message_to_csv(part, **options))
        elif is_message(part):
            text = message_to_yaml(part, flow_style=args.flow_style, **options)
            print(text, end="---\n")
        else:
            print(part, end="\n---\n")

    topic, kind = _await_class(session, args.topic, args.type, args.timeout)
    profile = _matching(session.node, topic, args)
    session.node.create_subscription(kind, topic, on_message, profile)
    message = "message that passes --filter" if args.filter else "message"
    notice = partial(_no_message, session, topic, message)
    if not session.await_or_report(lambda: printed, notice, args.timeout, _NO_MESSAGE):
        raise OneBotError(f"no {message} on {topic} within {args.timeout:g} s")
    session.spin(lambda: args.once)


def _passes(message: Any, condition: str | None) -> bool:
    """Whether the expression of ``--filter`` is true for a message, or a part of one."""
    try:
        return condition is None or bool(eval(condition, {"m": message}))
    except Exception as error:  # whatever the user's expression raises
        raise OneBotError(f"--filter: {type(error).__name__}: {error}") from None


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
    ),
    flag("--csv", "print values separated by commas"),
    flag("--flow-style", "one line per message"),
    flag("-f --full-length", "print lists and strings in full"),
    option("-l --truncate-length", "N", "cut lists and strings after N items (128)", natural, 128),
    flag("--no-arr", "print no list's items"),
    *_qos_options("compatible with the publishers"),
)


def _no_message(session: Session, topic: str, message: str = "message") -> str:
    publishers = session.node.count_publishers(topic)
    question = "" if publishers else TOPICS.question(session, topic)
    return f"note: no {message} on {topic} yet; {publishers} publisher(s){question}"


@in_session
def hz(session: Session, args: Namespace) -> NoReturn:
    """Print the rate of a topic each second."""
    _measure(session, args, Arrivals.rate_report)


@in_session
def bw(session: Session, args: Namespace) -> NoReturn:
    """Print the bandwidth of a topic each second."""
    _measure(session, args, lambda arrivals: arrivals.bandwidth_report(time.monotonic()))


def _measurement(window: int) -> tuple[Any, ...]:
    """Return the options of a command that measures over ``window`` messages."""
    text = f"measure over the last N messages ({window})"
    return (
        _TOPIC,
        option("-w --window", "N", text, count, window),
        *_qos_options("compatible with the publishers"),
    )


def _measure(
    session: Session, args: Namespace, report: Callable[[Arrivals], str | None]
) -> NoReturn:
    """Print a report each second, and a note if no message comes."""
    topic, kind = _await_class(session, args.topic)
    arrivals = Arrivals(args.window)

    def on_message(data: bytes) -> None:
        arrivals.add(time.monotonic(), len(data))

    profile = _matching(session.node, topic, args)
    session.node.create_subscription(kind, topic, on_message, profile, raw=True)
    notice = partial(_no_message, session, topic)
    session.await_or_report(lambda: arrivals.messages, notice, patience=_NO_MESSAGE)
    while True:
        session.spin_for(_REPORT)
        if (text := report(arrivals)) is not None:
            print(text)


@in_session
def info(session: Session, args: Namespace) -> None:
    """Show the publishers and subscribers of a topic."""
    TOPICS.find_types(session, args.topic)
    session.discover()  # all endpoints, not only the first
    topic, types = TOPICS.find_types(session, args.topic)
    end, node = "\n\n" if args.verbose else "\n", session.node
    print(f"Type: {types[0] if len(types) == 1 else types}", end=end)
    for title, number, endpoints in (
        ("Publisher", node.count_publishers(topic), node.get_publishers_info_by_topic),
        ("Subscription", node.count_subscribers(topic), node.get_subscriptions_info_by_topic),
    ):
        print(f"{title} count: {number}", end=end)
        for endpoint in endpoints(topic) if args.verbose else ():
            print(endpoint, end=end)


def pub(args: Namespace) -> None:
    """Publish messages given as YAML."""
    from onebot_bringup.introspection.message_text import fill

    kind = message_class(args.type)
    message = kind()
    times = fill(message, args.values, finite=not args.allow_non_finite)
    is_endless = not args.once and args.times is None
    wait = int(not is_endless) if args.wait is None else args.wait
    with Session(args.ros_args) as session:
        topic = session.full_name(args.topic)
        publisher = session.node.create_publisher(kind, topic, _profile(args, "default"))
        _await_subscribers(session, publisher, wait, args.max_wait_time_secs)
        print("publisher: beginning loop")
        _publish(session, publisher, message, times, args)
        await_acknowledgements(publisher)
        session.spin_for(_KEEP_ALIVE)


def _await_subscribers(
    session: Session, publisher: Any, number: int, timeout: float | None
) -> None:
    def waiting() -> str:
        mismatch = _other_subscribers(session, publisher)
        return f"Waiting for at least {number} matching subscription(s)...{mismatch}"

    if not session.await_or_report(
        lambda: publisher.get_subscription_count() >= number, waiting, timeout
    ):
        raise OneBotError(f"fewer than {number} matching subscription(s) within {timeout:g} s")


def _publish(
    session: Session, publisher: Any, message: Any, times: list[Any], args: Namespace
) -> None:
    """Publish at a rate; ``times`` are the parts of the message to set to the publish time."""
    from onebot_bringup.introspection.message_text import stamp

    period, began = 1.0 / args.rate, time.monotonic()
    due, total = began, 1 if args.once else args.times
    report = args.wait != 0 or total is None
    for number in itertools.count(1):
        stamp(times, session.node.get_clock().now().nanoseconds)
        if args.print and number % args.print == 0:
            print(f"publishing #{number}: {message!r}\n")
        publisher.publish(message)
        if number == total:
            return
        # After a suspend of the computer, continue without catching up.
        due = max(due + period, time.monotonic() - period)
        if report and time.monotonic() - began > _NO_SUBSCRIBER:
            report = False
            if not publisher.get_subscription_count():
                mismatch = _other_subscribers(session, publisher)
                print(f"note: no subscriber of {publisher.topic_name}{mismatch}", file=sys.stderr)
        session.spin_until(due)


def _other_subscribers(session: Session, publisher: Any) -> str:
    """Return the subscribers with another type or an incompatible QoS, as text."""
    types = session.subscribed_types(publisher.topic_name)
    if not types:
        return ""
    return f" (subscribers of {', '.join(types)} found; type and QoS have to match)"


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
    option("-r --rate", "HZ", "messages per second (1)", positive, 1.0),
    option("-p --print", "N", "print every N-th message (1)", natural, 1),
    flag("-1 --once", "publish one message and exit"),
    option("-t --times", "N", "publish N and exit", count),
    option(
        "-w --wait-matching-subscriptions",
        "N",
        "wait for N subscribers first (1 with --once or --times, else 0)",
        natural,
        dest="wait",
    ),
    option("--max-wait-time-secs", "S", "wait no longer than S seconds", positive),
    ALLOW_NON_FINITE,
    *_qos_options("default: reliable, volatile, depth 10"),
)


COMMANDS = {
    "pub": Subcommand(
        "publish messages", pub, *_PUB, endless=lambda args: not (args.once or args.times)
    ),
    "echo": Subcommand(
        "print messages as they are received", echo, *_ECHO, endless=lambda args: not args.once
    ),
    "list": TOPICS.listing(),
    "info": Subcommand(
        "show the publishers and subscribers",
        info,
        _TOPIC,
        flag("-v --verbose", "show each node and its quality of service"),
    ),
    "hz": Subcommand("measure the rate", hz, *_measurement(10000), endless=lambda _: True),
    "bw": Subcommand("measure the bandwidth", bw, *_measurement(100), endless=lambda _: True),
}
