"""``onebot topic hz, bw, delay``: how often messages come, how large and how old they are."""

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from onebot_bringup.cli import qos
from onebot_bringup.cli.ros_session import Session, add_spin_time
from onebot_bringup.cli.subcommands import Parser, count
from onebot_bringup.cli.topic_types import await_class
from onebot_bringup.introspection.rates import Bandwidth, Delays, Intervals
from onebot_description.errors import OneBotError
from onebot_description.stamps import nanoseconds

_REPORT = 1.0  # s
_LONELY = 2  # reports without any message, after which it says so


def hz(parser: Parser, argv: Sequence[str]) -> int:
    """Print the rate of a topic each second; return the exit code."""
    args = _parse(parser, argv, 10000)
    meter = Intervals(args.window)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        clock = session.node.get_clock()
        _measure(
            session, args, lambda _: meter.arrived(clock.now().nanoseconds * 1e-9), meter.report
        )


def bw(parser: Parser, argv: Sequence[str]) -> int:
    """Print the bandwidth of a topic each second; return the exit code."""
    args = _parse(parser, argv, 100)
    meter = Bandwidth(args.window)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        _measure(
            session,
            args,
            lambda data: meter.arrived(time.monotonic(), len(data)),
            lambda: meter.report(time.monotonic()),
            announce=True,
        )


def delay(parser: Parser, argv: Sequence[str]) -> int:
    """Print the age of a topic's messages each second; return the exit code."""
    args = _parse(parser, argv, 10000)
    meter = Delays(args.window)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        clock = session.node.get_clock()

        def arrived(message: Any) -> None:
            stamp = message.header.stamp
            meter.arrived((clock.now().nanoseconds - nanoseconds(stamp)) * 1e-9)

        _measure(session, args, arrived, meter.report, raw=False)


def _parse(parser: Parser, argv: Sequence[str], window: int) -> Namespace:
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "-w", "--window", type=count, default=window, metavar="N",
        help=f"measure over the last N messages ({window})",
    )  # fmt: skip
    add_spin_time(parser)
    qos.add_arguments(parser, "what suits the publishers")
    return parser.parse(argv)


def _measure(
    session: Session,
    args: Namespace,
    arrived: Callable[[Any], None],
    report: Callable[[], str | None],
    *,
    raw: bool = True,
    announce: bool = False,
) -> NoReturn:
    topic, kind = await_class(session, args.topic)
    if not raw and "header" not in kind.get_fields_and_field_types():
        raise OneBotError(f"msg does not have header: {topic} has no time to compare with")
    heard = 0

    def on_message(message: Any) -> None:
        nonlocal heard
        heard += 1
        arrived(message)

    session.node.create_subscription(
        kind, topic, on_message, qos.matching(session.node, topic, args), raw=raw
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
        elif rounds == _LONELY and not heard:
            publishers = session.node.count_publishers(topic)
            print(f"note: no message on {topic} yet; publishers: {publishers}", file=sys.stderr)
