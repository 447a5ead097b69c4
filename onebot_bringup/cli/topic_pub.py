"""``onebot topic pub``: publish messages given as YAML."""

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli import qos
from onebot_bringup.cli.ros_session import Session
from onebot_bringup.cli.subcommands import Parser, count, natural, not_negative, positive
from onebot_description.errors import OneBotError

_LONELY = 2.0  # s without a listener, after which it says so


def pub(parser: Parser, argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the type is not installed, or a value is wrong.
    """
    _add_arguments(parser)
    args = parser.parse(argv)
    from onebot_bringup.introspection.filling import fill
    from onebot_bringup.introspection.interfaces import message_class

    kind = message_class(args.type)
    message = kind()
    times = fill(message, _values(args), finite=not args.allow_non_finite)
    with Session(args.ros_args, args.node_name) as session:
        _Publisher(session, args, kind).run(message, times)
    return 0


def _add_arguments(parser: Parser) -> None:
    parser.add_argument("topic", metavar="TOPIC", help="such as /velocity_controller/cmd_vel")
    parser.add_argument("type", metavar="TYPE", help="such as geometry_msgs/msg/Twist")
    parser.add_argument(
        "values",
        nargs="?",
        metavar="VALUES",
        help='in YAML, such as "{linear: {x: 0.2}}"; what is left out keeps its default. '
        "A header may be auto, a time now",
    )
    parser.add_argument("--stdin", action="store_true", help="read the values from stdin")
    parser.add_argument(
        "-r", "--rate", type=positive, default=1.0, metavar="HZ", help="messages a second (1)"
    )
    parser.add_argument(
        "-p", "--print", type=natural, default=1, metavar="N", help="print every N-th only (1)"
    )
    number = parser.add_mutually_exclusive_group()
    number.add_argument("-1", "--once", action="store_true", help="publish one message and end")
    number.add_argument("-t", "--times", type=count, metavar="N", help="publish N and end")
    parser.add_argument(
        "-w",
        "--wait-matching-subscriptions",
        dest="wait",
        type=natural,
        metavar="N",
        help="wait for N listeners first (1 with --once or --times, else 0)",
    )
    parser.add_argument(
        "--max-wait-time-secs", type=positive, metavar="S", help="wait no longer than S seconds"
    )
    parser.add_argument(
        "--keep-alive", type=not_negative, default=0.1, metavar="S", help="stay at the end (0.1 s)"
    )
    parser.add_argument("-n", "--node-name", metavar="NAME", help="of the publishing node")
    parser.add_argument("--allow-non-finite", action="store_true", help="let .nan and .inf through")
    qos.add_arguments(parser, "default (reliable, volatile, depth 10)")


def _values(args: Namespace) -> str:
    if args.stdin:
        return sys.stdin.read()
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
        self._await_listeners(wait)
        print("publisher: beginning loop")
        self._loop(message, times, most)
        self._finish()

    def _await_listeners(self, number: int) -> None:
        began = said = time.monotonic() - 1.0
        limit = self._args.max_wait_time_secs
        while self._publisher.get_subscription_count() < number:
            now = time.monotonic()
            if limit is not None and now - began - 1.0 > limit:
                raise OneBotError(
                    f"waited {limit:g} s in vain for {number} matching subscription(s) of "
                    f"{self._topic}{self._others()}"
                )
            if now - said >= 1.0:
                print(f"Waiting for at least {number} matching subscription(s)...{self._others()}")
                said = now
            self._session.spin_until(now + 0.05)

    def _loop(self, message: Any, times: list[Any], most: int | None) -> None:
        from onebot_bringup.introspection.filling import stamp

        period, began = 1.0 / self._args.rate, time.monotonic()
        due, lonely = began, self._args.wait != 0 or most is None
        while True:
            stamp(times, self._session.node.get_clock().now().nanoseconds)
            self._number += 1
            if self._args.print and self._number % self._args.print == 0:
                print(f"publishing #{self._number}: {message!r}\n")
            self._publisher.publish(message)
            if self._number == most:
                return
            # After a pause (a laptop that slept) it goes on, without making up for it.
            due = max(due + period, time.monotonic() - period)
            if lonely and time.monotonic() - began > _LONELY:
                lonely = False
                self._say_if_lonely()
            self._session.spin_until(due)

    def _say_if_lonely(self) -> None:
        if self._publisher.get_subscription_count() == 0:
            print(f"note: nobody listens to {self._topic}{self._others()}", file=sys.stderr)

    def _others(self) -> str:
        """Who listens to the topic, but for another type, or with another QoS."""
        found = self._session.node.get_subscriptions_info_by_topic(self._topic)
        types = sorted({info.topic_type for info in found})
        if not types:
            return ""
        return f" (subscribers there: {', '.join(types)}; type and QoS have to match)"

    def _finish(self) -> None:
        from rclpy.duration import Duration

        if self._publisher.get_subscription_count():
            self._publisher.wait_for_all_acked(Duration(seconds=1.0))
        self._session.spin_until(time.monotonic() + self._args.keep_alive)
