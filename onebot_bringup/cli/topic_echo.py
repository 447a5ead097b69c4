"""``onebot topic echo``: print messages as they come."""

import sys
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli import qos
from onebot_bringup.cli.ros_session import Session, add_spin_time
from onebot_bringup.cli.subcommands import Parser, natural, positive
from onebot_bringup.cli.topic_types import await_class
from onebot_description.errors import OneBotError

_LONELY = 2.0  # s without a message, after which it says so


def echo(parser: Parser, argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: the type is not installed, or there is no such field.
    """
    _add_arguments(parser)
    args = parser.parse(argv)
    with Session(args.ros_args, spin_time=args.spin_time) as session:
        return _Echo(session, args).run()


def _add_arguments(parser: Parser) -> None:
    parser.add_argument("topic", metavar="TOPIC", help="such as /joint_states")
    parser.add_argument(
        "type", nargs="?", metavar="TYPE", help="such as sensor_msgs/msg/JointState (discovered)"
    )
    parser.add_argument("--once", action="store_true", help="print one message and end")
    parser.add_argument("--timeout", type=positive, metavar="S", help="give up after S seconds")
    parser.add_argument(
        "--field", metavar="FIELD", help="print a part only: pose.pose.position, position[0]"
    )
    parser.add_argument("--csv", action="store_true", help="print values separated by commas")
    parser.add_argument("--raw", action="store_true", help="print the bytes on the wire")
    parser.add_argument("--flow-style", action="store_true", help="one line a message")
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
    qos.add_arguments(parser, "what suits the publishers")


class _Echo:
    def __init__(self, session: Session, args: Namespace) -> None:
        from onebot_bringup.introspection.printing import Style

        self._session, self._args = session, args
        self._style = Style(
            longest=None if args.full_length else args.truncate_length,
            arrays=not args.no_arr,
            strings=not args.no_str,
            flow=args.flow_style,
        )
        self._heard = False
        self._error: OneBotError | None = None

    def run(self) -> int:
        args = self._args
        topic, kind = await_class(self._session, args.topic, args.type)
        self._session.node.create_subscription(
            kind,
            topic,
            self._on_message,
            qos.matching(self._session.node, topic, args),
            event_callbacks=self._events(),
            raw=args.raw,
        )
        first = min(_LONELY, args.timeout or _LONELY)
        if not self._session.spin(self._first, first):
            if not args.timeout or args.timeout > _LONELY:
                self._say_lonely(topic)
            left = None if args.timeout is None else args.timeout - first
            if not self._session.spin(self._first, left):
                raise OneBotError(f"no message on {topic} within {args.timeout:g} s")
        if not args.once:
            self._session.spin(lambda: self._check() and False)
        return 0

    def _first(self) -> bool:
        self._check()
        return self._heard

    def _check(self) -> bool:
        if self._error is not None:
            raise self._error
        return True

    def _events(self) -> Any:
        from rclpy.event_handler import SubscriptionEventCallbacks

        # The default says on the log which QoS does not match; that stays.
        lost = None if self._args.no_lost_messages else _on_lost
        return SubscriptionEventCallbacks(message_lost=lost)

    def _say_lonely(self, topic: str) -> None:
        publishers = self._session.node.count_publishers(topic)
        who = "nobody publishes it" if not publishers else f"{publishers} publisher(s)"
        print(f"note: no message on {topic} yet; {who}", file=sys.stderr)

    def _on_message(self, message: Any) -> None:
        if self._error is not None or (self._heard and self._args.once):
            return
        try:
            self._print(message)
        except OneBotError as error:  # of the field; raised outside of the callback
            self._error = error
        self._heard = True

    def _print(self, message: Any) -> None:
        from onebot_bringup.introspection.printing import is_message, pick, to_csv, to_yaml

        part = pick(message, self._args.field) if self._args.field else message
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
