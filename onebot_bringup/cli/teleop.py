"""``onebot teleop``: drives a robot from the keyboard, with the keys of teleop_twist_keyboard.

``KeyDriver`` turns keys into velocities, without ROS and without a terminal.
"""

import contextlib
import os
import re
import select
import signal
import sys
import termios
import tty
from argparse import Namespace
from collections.abc import Iterator, Sequence

from onebot_bringup.cli.options import Parser, not_negative, option, positive
from onebot_bringup.cli.running_robots import chosen_commands
from onebot_bringup.cli.session import Session
from onebot_bringup.steering.arbiter import ZEROS
from onebot_bringup.steering.protocol import Velocity
from onebot_description.errors import OneBotError
from onebot_description.timing.wake_detector import WAKE, boot_time

# For each key: forward, turn to the left, left, up; each -1, 0 or 1. Reverse curves turn as a car
# does with the same steering angle, as in teleop_twist_keyboard.
_MOVES: dict[str, tuple[int, int, int, int]] = {
    **dict.fromkeys(("i", "I", "up"), (1, 0, 0, 0)),
    **dict.fromkeys((",", "<", "down"), (-1, 0, 0, 0)),
    **dict.fromkeys(("j", "left"), (0, 1, 0, 0)),
    **dict.fromkeys(("l", "right"), (0, -1, 0, 0)),
    "u": (1, 1, 0, 0),
    "o": (1, -1, 0, 0),
    "m": (-1, -1, 0, 0),
    ".": (-1, 1, 0, 0),
    "U": (1, 0, 1, 0),
    "O": (1, 0, -1, 0),
    "J": (0, 0, 1, 0),
    "L": (0, 0, -1, 0),
    "M": (-1, 0, 1, 0),
    ">": (-1, 0, -1, 0),
    "t": (0, 0, 0, 1),
    "b": (0, 0, 0, -1),
}
# For each key: factor on the speed, factor on the turning speed.
_SPEEDS: dict[str, tuple[float, float]] = {
    "q": (1.1, 1.1),
    "z": (0.9, 0.9),
    "w": (1.1, 1.0),
    "x": (0.9, 1.0),
    "e": (1.0, 1.1),
    "c": (1.0, 0.9),
}
_SHORTEST_HOLD = 0.2  # s; over a network, repeats arrive in bursts
_REPEATS_MISSED = 4
ESCAPE = "\x1b"
# A key; what follows the terminal's introducer of a function key says which one it is.
_KEY = re.compile(rf"{ESCAPE}[\[O](?P<function>[^A-Za-z~]*[A-Za-z~]|.)|.", re.DOTALL)
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_LOCK, _UNLOCK = " ", "r"
_QUIT = (ESCAPE, "\x03", "\x04")
_PERIOD = 0.05  # s between commands
_SUBSCRIBER_PERIOD = 0.25  # s between polls for subscribers
_SPIN = 0.002  # s of callbacks between two reads of the keyboard
_LONGEST_WAIT = 0.1  # s for a key, so that a longer gap shows that the process did not run
_LOCKED = f"\t(locked: {_UNLOCK} unlocks)"

HELP = """\
Reading from the keyboard and publishing on {topic}
---------------------------
Moving around, while a key is held:
   u    i    o
   j    k    l
   m    ,    .

Sideways (for robots that can), with Shift:
   U    I    O
   J    K    L
   M    <    >

t : up (+z)
b : down (-z)

space : stop, and lock the robot for everybody
r : unlock it (driving keys do not)
anything else : stop

q/z : increase/decrease max speeds by 10%
w/x : increase/decrease only linear speed by 10%
e/c : increase/decrease only angular speed by 10%

CTRL-C or Esc to quit
"""


class KeyDriver:
    """Converts key presses to velocities over time."""

    def __init__(self, speed: float, turn: float, hold: float) -> None:
        self.speed, self.turn = speed, turn  # m/s and rad/s while a key is held
        # Seconds for which one press counts as held without repeats; longer than the repeat delay.
        self._hold = hold
        self.locked = False  # if True, no key moves the robot
        self._key: str | None = None
        self._pressed = 0.0  # time of the last press or repeat
        self._until = 0.0  # time from which the key counts as released

    def press(self, key: str, now: float) -> None:
        """Process a key received at ``now`` (s)."""
        if key in _SPEEDS:
            self.speed *= _SPEEDS[key][0]
            self.turn *= _SPEEDS[key][1]
        elif key not in _MOVES or self.locked:
            self._key = None
        else:
            repeated = key == self._key and now < self._until
            hold = self._hold
            if repeated:  # the first repeat, after the long delay, counts as long as a press
                hold = min(hold, max(_SHORTEST_HOLD, _REPEATS_MISSED * (now - self._pressed)))
            self._key, self._pressed, self._until = key, now, now + hold

    def lock(self) -> None:
        """Stop, and ignore the keys that move the robot while ``locked``.

        Such a key must not unlock: a press looks like the first repeat of a held key after the
        process or its connection stood still.
        """
        self.locked = True
        self.release()

    def release(self) -> None:
        """Count the key that moves the robot as released."""
        self._key = None

    def moving(self, now: float) -> bool:
        """Whether a key that moves the robot is held."""
        return self._key is not None and now < self._until

    def velocity(self, now: float) -> tuple[Velocity, float]:
        """Return the velocity at ``now``, and that up, m/s: zero when no key is held."""
        if not self.moving(now):
            return Velocity(), 0.0
        ahead, turn, left, up = _MOVES[self._key or ""]
        velocity = Velocity(ahead * self.speed, turn * self.turn, left * self.speed)
        return velocity, up * self.speed


@contextlib.contextmanager
def single_keys() -> Iterator[int]:
    """Switch the terminal to single keys without echo, and back afterwards; Ctrl-C interrupts.

    Yields:
        The terminal's file descriptor.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        raise OneBotError("this reads keys from a terminal, but standard input is not a terminal")
    fd = sys.stdin.fileno()
    old_mode = termios.tcgetattr(fd)
    try:
        tty.setcbreak(fd, termios.TCSADRAIN)
        mode = termios.tcgetattr(fd)
        # Ctrl-S would block the output, and with it the loop that publishes.
        mode[0] &= ~termios.IXON
        # Ctrl-Z would suspend the process while the robot keeps driving.
        mode[6][termios.VSUSP] = os.fpathconf(fd, "PC_VDISABLE").to_bytes(1, "little")
        termios.tcsetattr(fd, termios.TCSADRAIN, mode)
        yield fd
    finally:
        with contextlib.suppress(termios.error):  # the terminal's window is closed
            termios.tcsetattr(fd, termios.TCSADRAIN, old_mode)


def read_keys(fd: int, timeout: float) -> list[str] | None:
    """Return the keys pressed since the last call; wait up to ``timeout`` (s) for one.

    Arrow keys are ``up``, ``down``, ``left`` and ``right``. It is None once the terminal is closed.
    """
    if not select.select([fd], [], [], max(timeout, 0.0))[0]:
        return []
    try:
        data = os.read(fd, 1024)
    except OSError:
        return None
    return split_keys(data.decode(errors="replace")) if data else None


def split_keys(text: str) -> list[str]:
    """Split terminal input into keys; function keys other than arrows give "" each."""
    return [
        key[0] if key["function"] is None else _ARROWS.get(key["function"], "")
        for key in _KEY.finditer(text)
    ]


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    summary = "drive a robot from the keyboard, while a key is held"
    args = Parser("onebot teleop", summary, _OPTIONS).parse(argv)
    with single_keys() as fd, Session(args.ros_args, "teleop") as session:
        teleop = _Teleop(session, args)
        try:
            teleop.drive(fd)
        except KeyboardInterrupt:
            pass
        finally:
            teleop.stop()
    return 0


_OPTIONS = (
    option(
        "robot",
        "ROBOT|TOPIC",
        "the robot, such as robot2, or the topic to publish on (the only robot's)",
        default="",
        nargs="?",
    ),
    option("--speed", "M/S", "initial speed (0.5 m/s)", positive, 0.5),
    option("--turn", "RAD/S", "initial turn rate (1 rad/s)", positive, 1.0),
    option(
        "--hold",
        "S",
        "how long one press counts as held; longer than the keyboard's repeat delay (0.7)",
        not_negative,
        0.7,
    ),
)


class _Teleop:
    def __init__(self, session: Session, args: Namespace) -> None:
        from onebot_bringup.steering.command_topic import CommandTopic
        from onebot_control.nodes.command_controllers import Controllers

        self._session = session
        topic = chosen_commands(session, args.robot)
        self._commands = CommandTopic(session.node, topic, self._on_lock)
        self._driver = KeyDriver(args.speed, args.turn, args.hold)
        self._controllers = Controllers(session.node, lambda: None)
        self._shown = self._note = ""
        self._next_poll = 0.0

    def drive(self, fd: int) -> None:
        """Read keys from a terminal and publish, until a key quits."""
        signal.signal(signal.SIGCONT, lambda *_: WAKE.resumed())
        termios.tcflush(fd, termios.TCIFLUSH)  # drop what was typed before it could be read
        print(HELP.format(topic=self._commands.topic))
        zeros, due, began = 0, boot_time(), WAKE.check()
        while True:
            self._show()
            self._session.spin_for(_SPIN)
            pressed = read_keys(fd, min(due - boot_time(), _LONGEST_WAIT))
            now, just_woke = boot_time(), WAKE.just_woke() and WAKE.woke > began
            if pressed is None or any(key in _QUIT for key in pressed):
                return
            was_moving = self._driver.moving(now)
            if just_woke:  # earlier keys may have waited in the terminal
                self._driver.release()
                pressed = [key for key in pressed if key == _LOCK]
            for key in pressed:
                self._press(key, now)
            moving = self._driver.moving(now)
            if moving != was_moving:
                zeros, due = ZEROS, now  # publish the first one at once
            if now < due:
                continue
            due = max(due + _PERIOD, now)
            if moving or zeros > 0:
                zeros -= not moving
                self._commands.publish(*self._driver.velocity(now))

    def _press(self, key: str, now: float) -> None:
        self._driver.press(key, now)
        if key == _LOCK:
            self._commands.lock(True)
            self._on_lock(self._commands.locked)
        elif key == _UNLOCK:
            self._commands.lock(False)
            self._driver.locked = False

    def _on_lock(self, locked: bool) -> None:
        if locked:
            self._driver.lock()

    def stop(self) -> None:
        """Publish zero and wait for acknowledgements."""
        for _ in range(ZEROS):
            self._commands.publish(Velocity())
        self._commands.flush()
        with contextlib.suppress(OSError):  # the terminal's window is closed
            print(flush=True)

    def _show(self) -> None:
        """Update the status line when the speeds or the subscribers changed."""
        if boot_time() > self._next_poll:
            self._next_poll = boot_time() + _SUBSCRIBER_PERIOD
            self._note = self._subscriber_note()
        note = _LOCKED if self._driver.locked else self._note
        driver = self._driver
        text = f"currently:\tspeed {driver.speed:.3g}\tturn {driver.turn:.3g} {note}"
        if text != self._shown:
            self._shown = text
            sys.stdout.write(f"\r\x1b[K{text}")
            sys.stdout.flush()

    def _subscriber_note(self) -> str:
        """Return what is known about the robot: its minimum turning radius, or that it is gone."""
        commands = self._commands
        commands.update(self._controllers.names)
        self._controllers.update(end.node for end in commands.subscribers if end.node)
        radius = max((c.minimum_radius for c in self._controllers.known), default=0.0)
        if not commands.listeners:
            return "\t(no subscriber yet)"
        return f"\tminimum radius {radius:.3g} m" if radius else ""
