"""``onebot teleop``: drive a robot from the keyboard, with the keys of teleop_twist_keyboard."""

import contextlib
import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from onebot_bringup.cli.driving_keys import HELP, Driver, Velocity
from onebot_bringup.cli.ros_session import Session
from onebot_bringup.cli.subcommands import Parser, not_negative, positive
from onebot_bringup.cli.terminal import ESCAPE, Keys, single_keys

_TOPIC = "/velocity_controller/cmd_vel"
_ZEROS = 3  # published when a key is let go, in case one gets lost
_LISTENERS = 1.0  # s between looks at who listens
_QUIT = (ESCAPE, "\x03", "\x04")


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code.

    Raises:
        OneBotError: there is no terminal to read keys from, or the command line is wrong.
    """
    args = _parse(argv)
    with single_keys() as keys, Session(args.ros_args, "teleop") as session:
        teleop = _Teleop(session, args)
        try:
            teleop.drive(keys)
        except KeyboardInterrupt:
            pass
        finally:
            teleop.stop()
    return 0


def _parse(argv: Sequence[str]) -> Namespace:
    parser = Parser("onebot teleop", "drive a robot from the keyboard; it stops when you let go")
    parser.add_argument(
        "topic", nargs="?", default=_TOPIC, metavar="TOPIC", help=f"to publish on ({_TOPIC})"
    )
    parser.add_argument(
        "--stamped", action="store_true", help="publish TwistStamped instead of Twist"
    )
    parser.add_argument(
        "--speed", type=positive, default=0.5, metavar="M/S", help="to begin with (0.5 m/s)"
    )
    parser.add_argument(
        "--turn", type=positive, default=1.0, metavar="RAD/S", help="to begin with (1 rad/s)"
    )
    parser.add_argument("--frame-id", default="", metavar="FRAME", help="of TwistStamped")
    parser.add_argument(
        "--rate", type=positive, default=20.0, metavar="HZ", help="messages a second (20)"
    )
    parser.add_argument(
        "--hold",
        type=not_negative,
        default=0.7,
        metavar="S",
        help="how long one press counts; longer than the keyboard's delay before it repeats (0.7)",
    )
    return parser.parse(argv)


class _Teleop:
    def __init__(self, session: Session, args: Namespace) -> None:
        from geometry_msgs.msg import Twist, TwistStamped

        self._session, self._args = session, args
        self._kind = TwistStamped if args.stamped else Twist
        self._topic = session.full_name(args.topic)
        self._publisher = session.node.create_publisher(self._kind, self._topic, 10)
        self._driver = Driver(args.speed, args.turn, args.hold)
        self._shown = ""
        self._note, self._look = "", time.monotonic() + _LISTENERS

    def drive(self, keys: Keys) -> None:
        """Read keys and publish until one says to leave."""
        print(HELP.format(kind=self._kind.__name__, topic=self._topic))
        zeros, due = 0, time.monotonic()
        while True:
            self._show()
            pressed = keys.read(due - time.monotonic())
            now = time.monotonic()
            if pressed is None or any(key in _QUIT for key in pressed):
                return
            was_moving = self._driver.moving(now)
            for key in pressed:
                self._driver.press(key, now)
            if self._driver.moving(now):
                zeros = _ZEROS
                due = due if was_moving else now  # the first one at once
            elif was_moving:
                due = now
            if now < due:
                continue
            due = max(due + 1.0 / self._args.rate, now)
            if self._driver.moving(now) or zeros > 0:
                zeros -= not self._driver.moving(now)
                self._publish(self._driver.velocity(now))

    def stop(self) -> None:
        """Publish zero, and see that it arrives."""
        from rclpy.duration import Duration

        for _ in range(_ZEROS):
            self._publish(Velocity())
        if self._publisher.get_subscription_count():
            self._publisher.wait_for_all_acked(Duration(seconds=0.5))
        with contextlib.suppress(OSError):  # the terminal's window is closed
            print(flush=True)

    def _publish(self, velocity: Velocity) -> None:
        message: Any = self._kind()
        twist = message.twist if self._args.stamped else message
        if self._args.stamped:
            message.header.stamp = self._session.node.get_clock().now().to_msg()
            message.header.frame_id = self._args.frame_id
        twist.linear.x, twist.linear.y, twist.linear.z = velocity.x, velocity.y, velocity.z
        twist.angular.z = velocity.turn
        self._publisher.publish(message)

    def _show(self) -> None:
        """Write the speeds anew when they changed, and say when nobody listens."""
        if time.monotonic() > self._look:
            self._look = time.monotonic() + _LISTENERS
            self._note = self._who_listens()
        text = f"{self._driver.status()}{self._note}"
        if text != self._shown:
            self._shown = text
            sys.stdout.write(f"\r\x1b[K{text}")
            sys.stdout.flush()

    def _who_listens(self) -> str:
        if self._publisher.get_subscription_count():
            return ""
        found = self._session.node.get_subscriptions_info_by_topic(self._topic)
        types = sorted({info.topic_type for info in found})
        if any(name.endswith("/TwistStamped") for name in types) and not self._args.stamped:
            return "\t(the robot wants TwistStamped: use --stamped)"
        if any(name.endswith("/Twist") for name in types) and self._args.stamped:
            return "\t(the robot wants Twist: leave out --stamped)"
        return "\t(nobody listens yet)"
