"""``onebot teleop``: what the keys mean, and the command on a pseudo-terminal and real DDS."""

import io
import os
import pty
import re
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from onebot_bringup.cli.running_robots import chosen_commands, commanded_robots
from onebot_bringup.cli.session import Session
from onebot_bringup.cli.teleop import KeyDriver, split_keys
from onebot_bringup.steering.protocol import Velocity
from onebot_description.errors import OneBotError
from tests.onebot_bringup.cli_support import MODULE, onebot
from tests.ros_support import LATCHED, Peer
from tests.support import PATIENCE, starved, stopped, wait_for

TOPIC = "/velocity_controller/cmd_vel"


def test_the_keys_of_teleop_twist_keyboard() -> None:
    """Each key moves in its direction, at the speeds set; any other key stops."""
    expected = {
        "i": (1, 0, 0, 0), ",": (-1, 0, 0, 0), "j": (0, 0, 0, 1), "l": (0, 0, 0, -1),
        "u": (1, 0, 0, 1), "o": (1, 0, 0, -1), "m": (-1, 0, 0, -1), ".": (-1, 0, 0, 1),
        "U": (1, 1, 0, 0), "O": (1, -1, 0, 0), "J": (0, 1, 0, 0), "L": (0, -1, 0, 0),
        "M": (-1, 1, 0, 0), ">": (-1, -1, 0, 0), "I": (1, 0, 0, 0), "<": (-1, 0, 0, 0),
        "t": (0, 0, 1, 0), "b": (0, 0, -1, 0), "up": (1, 0, 0, 0), "left": (0, 0, 0, 1),
        "k": (0, 0, 0, 0), " ": (0, 0, 0, 0), "": (0, 0, 0, 0),
    }  # fmt: skip
    driver = KeyDriver(0.5, 2.0, 0.7)
    for key, (ahead, left, up, turn) in expected.items():
        driver.press("i", 0.0)
        driver.press(key, 0.0)
        velocity = Velocity(0.5 * ahead, 2.0 * turn, 0.5 * left)
        assert driver.velocity(0.0) == (velocity, 0.5 * up), key


def test_speed_keys() -> None:
    """They change the speeds by 10 %, and the motion goes on at the new ones."""
    factors = {"q": (1.1, 1.1), "z": (0.9, 0.9), "w": (1.1, 1), "x": (0.9, 1), "e": (1, 1.1)}
    for key, (speed, turn) in {**factors, "c": (1, 0.9)}.items():
        driver = KeyDriver(0.5, 1.0, 0.7)
        driver.press("u", 0.0)
        driver.press(key, 0.1)
        assert (driver.speed, driver.turn) == pytest.approx((0.5 * speed, turn))
        assert driver.velocity(0.2) == (Velocity(driver.speed, driver.turn), 0.0)


@pytest.mark.parametrize("delay", [0.25, 0.5, 0.66])
@pytest.mark.parametrize("interval", [0.02, 0.033, 0.1])
def test_a_held_key_moves_throughout_and_stops_soon(delay: float, interval: float) -> None:
    """No gap while the key repeats; after it is let go, stopped within a few of its repeats."""
    driver = KeyDriver(0.5, 1.0, 0.7)
    driver.press("i", 0.0)
    moment = delay
    for _ in range(30):
        assert driver.moving(moment - 1e-6)
        driver.press("i", moment)
        moment += interval
    let_go = moment - interval
    assert not driver.moving(let_go + max(0.2, 4 * interval) + 1e-6)


def test_another_key_takes_over() -> None:
    """The latest key counts, as long as a first press may wait for its first repeat."""
    driver = KeyDriver(0.5, 1.0, 0.7)
    for moment in (0.0, 0.5, 0.53):
        driver.press("i", moment)
    driver.press("j", 0.6)
    assert driver.velocity(1.2) == (Velocity(0.0, 1.0), 0.0) and not driver.moving(1.3)


def test_no_key_moves_a_locked_robot() -> None:
    """However long ago the last one was: a repeat after a hitch looks like a press."""
    driver = KeyDriver(0.5, 1.0, 0.7)
    driver.press("i", 0.0)
    driver.lock()
    for key, moment in (("i", 0.1), ("i", 9.0), ("o", 9.1)):
        driver.press(key, moment)
        assert not driver.moving(moment)
    driver.locked = False
    driver.press("i", 9.2)
    assert driver.moving(9.2)


def test_keys_of_a_terminal() -> None:
    """Arrows are words, other function keys nothing, Esc alone itself."""
    assert split_keys("iq") == ["i", "q"]
    assert split_keys("\x1b[A\x1b[B\x1bOC\x1b[D") == ["up", "down", "right", "left"]
    assert split_keys("\x1b") == ["\x1b"]
    assert split_keys("\x1b[3~\x1b[1;5Ai\x1b[5~") == ["", "", "i", ""]


class Terminal:
    """The command on a pseudo-terminal; its keyboard, and what it shows."""

    def __init__(self, *words: str) -> None:
        self._keyboard, self._screen = pty.openpty()
        self.before = termios.tcgetattr(self._screen)
        self.process = subprocess.Popen(
            [sys.executable, "-m", MODULE, "teleop", *words],
            stdin=self._screen, stdout=self._screen, stderr=self._screen,
            start_new_session=True, preexec_fn=_own_terminal,
        )  # fmt: skip
        self._shown = b""
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while True:
            try:
                self._shown += os.read(self._keyboard, 4096)
            except OSError:
                return

    @property
    def shown(self) -> str:
        return self._shown.decode()

    @property
    def mode(self) -> list[object]:
        return termios.tcgetattr(self._screen)

    def type(self, keys: str) -> None:
        os.write(self._keyboard, keys.encode())

    def says(self, text: str) -> None:
        wait_for(lambda: text in self.shown, f'"{text}" on the terminal')

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(PATIENCE)
        os.close(self._screen)
        os.close(self._keyboard)


def _own_terminal() -> None:
    """Make stdin the controlling terminal, so that its Ctrl-C becomes a signal."""
    import fcntl

    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


@contextmanager
def teleop(*words: str) -> Iterator[Terminal]:
    terminal = Terminal(*words)
    try:
        yield terminal
    finally:
        terminal.close()


def ready(peer: Peer, terminal: Terminal, topic: str = TOPIC) -> None:
    """Wait until the command reads the keyboard and the peer has discovered its publisher."""
    terminal.says("currently:\tspeed")
    wait_for(lambda: peer.node.count_publishers(topic), "the publisher")
    wait_for(lambda: terminal.mode != terminal.before, "single keys")


def met(terminal: Terminal, heard: list[Twist]) -> None:
    """Press a key until it is heard, then wait until it counts as let go."""
    _hold(terminal, "i", heard)
    wait_for(lambda: heard[-3:] == [Twist()] * 3, "a stop")
    heard.clear()


def _hold(terminal: Terminal, key: str, heard: list[object]) -> None:
    """Hold a key, as a keyboard repeats it, until something is heard."""
    deadline = time.monotonic() + PATIENCE
    while not heard and time.monotonic() < deadline:
        terminal.type(key)
        time.sleep(0.1)


def test_drives_while_a_key_is_held(peer: Peer) -> None:
    """While a key repeats a Twist comes at a fixed rate; when it does not, zero, then silence."""
    with teleop("--hold", "3") as terminal:
        heard = peer.hear(Twist, TOPIC)
        ready(peer, terminal)
        met(terminal, heard)
        began = time.monotonic()
        for count in range(0, 30, 5):  # repeats of 4 Hz, and so each counts for a second or more
            wait_for(lambda count=count: len(heard) >= count, f"{count} commands")
            terminal.type("i")
        wait_for(lambda: heard[-1] == Twist(), "a stop")
        stopped = time.monotonic()
        moving = [m for m in heard if m != Twist()]
        assert {(m.linear.x, m.angular.z) for m in moving} == {(0.5, 0.0)}
        assert 25 <= len(moving) <= 20.0 * (stopped - began) + 2
        assert heard.index(Twist()) == len(moving)  # no gap
        time.sleep(0.5)
        assert len(heard) - len(moving) <= 3
        heard.clear()
        terminal.type("\x1a")  # Ctrl-Z would leave the robot driving; here it is any other key
        _hold(terminal, "i", heard)
        assert heard


def test_space_locks_the_robot_and_r_unlocks_it(peer: Peer) -> None:
    """No driving key unlocks, whoever has locked it."""
    heard, locks = peer.hear(Twist, TOPIC), peer.hear(Bool, f"{TOPIC}_lock")
    state = peer.node.create_publisher(Bool, f"{TOPIC}_locked", LATCHED)
    with teleop("--hold", "0.3") as terminal:
        ready(peer, terminal)
        met(terminal, heard)
        wait_for(lambda: peer.node.count_publishers(f"{TOPIC}_lock"), "the lock")
        wait_for(state.get_subscription_count, "the subscriber of the state")
        terminal.type(" ")
        terminal.says("(locked: r unlocks)")
        wait_for(lambda: locks == [Bool(data=True)], "the lock")
        _ignores(terminal, "i")
        assert locks == [Bool(data=True)] and not any(m.linear.x for m in heard)
        terminal.type("r")
        wait_for(lambda: locks == [Bool(data=True), Bool(data=False)], "the unlock")
        heard.clear()
        _hold(terminal, "i", heard)
        wait_for(lambda: heard[-1].linear.x, "a motion")
        state.publish(Bool(data=True))  # by somebody else
        wait_for(lambda: terminal.shown.count("(locked") > 2, "the lock")
        _ignores(terminal, "i")
        assert len(locks) == 2
        state.publish(Bool(data=False))  # somebody else's unlock does not make it drive
        _ignores(terminal, "i")
        wait_for(lambda: heard[-1] == Twist(), "a stop")


def _ignores(terminal: Terminal, key: str) -> None:
    """Type a key that has no effect, and wait until it was read."""
    terminal.type(key)
    count = terminal.shown.count("(locked")
    terminal.type("w")
    wait_for(lambda: terminal.shown.count("(locked") > count, "the next key")


@pytest.mark.parametrize(
    ("keys", "halted"), [("i" * 9000, stopped), ("ijJw\x1b[A", starved)], ids=["stopped", "starved"]
)
def test_what_was_typed_while_it_did_not_run_does_not_drive(
    peer: Peer, keys: str, halted: Callable[[int], AbstractContextManager[None]]
) -> None:
    """Neither moves nor speeds, also those that wait in the terminal; keys typed later drive."""
    with teleop("--hold", "0.3") as terminal:
        heard = peer.hear(Twist, TOPIC)
        ready(peer, terminal)
        met(terminal, heard)
        with halted(terminal.process.pid):
            typing = threading.Thread(target=terminal.type, args=(keys,))
            typing.start()  # the terminal may have no room for all of them
            typing.join(0.1)
        wait_for(lambda: _drove(terminal, "q"), "a key of afterwards")
        assert terminal.shown.count("speed 0.5\t") == 1 and not any(map(_moves, heard))
        _hold(terminal, "i", heard)
        assert _moves(heard[0])


def _drove(terminal: Terminal, key: str) -> bool:
    """Type a key that changes speeds; whether one has been taken, or several at once."""
    terminal.type(key)
    time.sleep(0.2)
    return re.search(r"speed (?!0\.5\t)\d", terminal.shown) is not None


def _moves(message: Twist) -> bool:
    return message != Twist()


def test_what_stops_counts_whenever_it_was_typed(peer: Peer) -> None:
    """Space and Esc, unlike what drives.

    A key that was held before a stop is let go, however short it is: the hand may be gone.
    """
    heard = peer.hear(Twist, TOPIC)
    with teleop("--hold", "1000") as terminal:
        peer.node.create_subscription(Bool, f"{TOPIC}_lock", lambda _: None, 1)
        ready(peer, terminal)
        wait_for(lambda: peer.node.count_publishers(f"{TOPIC}_lock"), "the lock")
        _hold(terminal, "i", heard)
        with stopped(terminal.process.pid):
            pass
        wait_for(lambda: heard[-1] == Twist(), "a stop")
        with stopped(terminal.process.pid):
            terminal.type("i ")
        terminal.says("(locked: r unlocks)")
        with stopped(terminal.process.pid):
            terminal.type("i\x1b")
        assert terminal.process.wait(PATIENCE) == 0


def test_leaving_stops_the_robot_and_restores_the_terminal(peer: Peer) -> None:
    """By Ctrl-C, also while a key is held; commands have the type that the robot subscribes to."""
    with teleop(*"/drive --speed 0.2 --turn 0.4".split()) as terminal:
        heard = peer.hear(TwistStamped, "/drive")
        ready(peer, terminal, "/drive")
        terminal.says("currently:\tspeed 0.2\tturn 0.4 ")
        terminal.type("q")
        terminal.says("currently:\tspeed 0.22\tturn 0.44 ")
        _hold(terminal, "u", heard)
        assert heard[0].header.stamp.sec > 0
        twist = heard[0].twist
        assert (twist.linear.x, twist.angular.z) == pytest.approx((0.22, 0.44))
        terminal.type("\x03")
        assert terminal.process.wait(PATIENCE) == 0, terminal.shown
        wait_for(lambda: heard[-1].twist == Twist(), "a stop")
        assert terminal.mode == terminal.before
        assert "Traceback" not in terminal.shown


def test_of_several_robots_one_is_named(peer: Peer) -> None:
    """Without a name they are listed."""
    for name in ("robot1", "robot2"):
        peer.hear(Twist, f"/{name}/velocity_controller/cmd_vel")
    with Session() as session:
        wait_for(lambda: len(commanded_robots(session)) == 2, "both robots")
        for name, text in (
            ("", "2 robots take commands: robot1, robot2; choose one by its name"),
            ("robot3", 'no robot "robot3" takes commands .did you mean'),
        ):
            with pytest.raises(OneBotError, match=text):
                chosen_commands(session, name)
        assert chosen_commands(session, "robot2") == "/robot2/velocity_controller/cmd_vel"


def test_a_car_turns_in_curves_of_a_minimum_radius(peer: Peer) -> None:
    """Beside the speeds, as its controller's parameters have it; they may change."""
    peer.node.declare_parameter("steering_joints_names", ["right", "left"])
    peer.node.declare_parameter("minimum_turning_radius", 0.468)
    peer.hear(Twist, TOPIC)
    with teleop() as terminal:
        terminal.says("turn 1 \tminimum radius 0.468 m")
        peer.node.set_parameters([Parameter("minimum_turning_radius", value=2.0)])
        terminal.says("minimum radius 2 m")


def test_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe has no keys: one clear error."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("iii"))
    done = onebot("teleop")
    assert done.returncode == 1 and "terminal" in done.stderr
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
