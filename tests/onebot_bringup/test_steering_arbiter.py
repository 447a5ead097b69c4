"""Who drives, of several pages, and what is published when. No ROS, network or clock."""

import math
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.steering.arbiter import COMMAND_TIMEOUT, MAX_AGE, STEP, ZEROS, Arbiter
from onebot_bringup.steering.command_limits import Bound, Limits
from onebot_bringup.steering.protocol import (
    Command,
    DriveMessage,
    Parts,
    Release,
    SetLimits,
    Stop,
    Velocity,
)
from onebot_description.timing.wake_detector import WakeDetector

FORWARD, ZERO = Velocity(0.5, 0.1), Velocity()
LOCK, UNLOCK = (True, Parts.ALL), (False, Parts.ALL)


def limits(*speeds: float) -> Limits:
    """Of a robot, the same forward and backward."""
    return Limits(*(Bound(speed, speed, speed) for speed in speeds))


class Steered:
    """An arbiter of some pages, and what it published and locked."""

    def __init__(self, pages: str) -> None:
        self.now, self.woke = 100.0, -math.inf
        self.published: list[Velocity] = []
        self.joints: list[Mapping[str, float]] = []  # their velocities, of each command
        self.locks: list[tuple[bool, Parts]] = []
        self.arbiter = Arbiter(
            limits(3.0, 4.0),
            self._publish,
            lambda *lock: self.locks.append(lock),
            lambda: self.now,
            lambda: self.woke,
        )
        self.arbiter.handle("", SetLimits(1.0, 2.0))
        for page in pages:
            self.arbiter.join(page)

    def _publish(self, command: Command) -> None:
        self.published.append(command.velocity)
        self.joints.append(command.joints)

    def drive(self, page: str, velocity: Velocity = FORWARD, age: float = 0.0) -> None:
        """Have a page send a command whose stamp is ``age`` seconds old, for an arm, too."""
        linear, angular, lateral = velocity
        arm = {"arm": linear} if linear else {}
        self.arbiter.handle(page, DriveMessage(linear, angular, self.now - age, arm, lateral))

    def release(self, page: str) -> None:
        """Have a page let go, later than a tap."""
        self.now += STEP
        self.arbiter.handle(page, Release())

    def stop(self, page: str) -> None:
        self.arbiter.handle(page, Stop())

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.arbiter.check_timeout()

    def sent(self) -> list[Velocity]:
        """What was published since the last call."""
        sent, self.published[:] = list(self.published), []
        return sent

    @property
    def driver(self) -> str | None:
        return self.arbiter.state.driver

    @property
    def command(self) -> Velocity:
        return self.arbiter.state.command.velocity


@pytest.fixture
def steered() -> Steered:
    """Pages "a" and "b"; the time stands still unless a test moves it."""
    return Steered("ab")


def test_nothing_is_published_before_anybody_drives(steered: Steered) -> None:
    """Other sources of commands are left alone; to halt is no exception."""
    steered.arbiter.tick()
    steered.arbiter.halt()
    steered.arbiter.tick()
    assert steered.sent() == [] and steered.driver is None


def test_to_take_hold_is_published_at_once_and_then_at_the_fixed_rate(steered: Steered) -> None:
    """More of the same waits for its turn; a robot that is held at zero gets zeros."""
    steered.drive("a")
    assert steered.sent() == [FORWARD]
    steered.drive("a", Velocity(0.6, 0.0))
    assert steered.sent() == []
    steered.arbiter.tick()
    assert steered.sent() == [Velocity(0.6, 0.0)]
    steered.drive("a", ZERO)
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * (ZEROS + 2) and steered.driver == "a"


def test_a_tap_is_a_step(steered: Steered) -> None:
    """Also where the release arrives with the press: a controller would only see the release."""
    steered.drive("a")
    steered.arbiter.handle("a", Release())
    assert steered.driver is None and steered.command == FORWARD
    steered.wait(0.9 * STEP)
    assert steered.command == FORWARD and ZERO not in steered.sent()
    steered.wait(0.2 * STEP)
    assert steered.sent() == [ZERO] and steered.command == ZERO
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * (ZEROS - 1) and steered.arbiter.timeouts == 0


def test_nothing_but_a_release_waits_for_the_step(steered: Steered) -> None:
    steered.drive("a")
    steered.arbiter.handle("a", Release())
    steered.stop("b")
    assert steered.command == ZERO and steered.sent()[-1] == ZERO
    steered.drive("b")
    assert steered.arbiter.leave("b") and not steered.arbiter.leave("b")
    assert steered.command == ZERO and steered.sent()[-1] == ZERO


@pytest.mark.parametrize(
    "end",
    [
        lambda steered: steered.release("a"),
        lambda steered: steered.arbiter.leave("a"),
        lambda steered: steered.arbiter.reject("a"),
        lambda steered: steered.stop("b"),
        lambda steered: steered.wait(COMMAND_TIMEOUT + 0.001),
    ],
    ids=["release", "leave", "reject", "stop", "silence"],
)
def test_every_end_gives_zeros_and_then_silence(steered: Steered, end) -> None:
    """The first at once, three in all, so that one may get lost; then others may drive."""
    steered.drive("a")
    steered.sent()
    end(steered)
    assert steered.sent() == [ZERO] and steered.command == ZERO
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * (ZEROS - 1)
    assert steered.joints == [{"arm": FORWARD.linear}, *[{}] * ZEROS]


def test_the_last_to_take_hold_drives(steered: Steered) -> None:
    """At once; the page it takes control from has to let go, and stops nobody meanwhile."""
    steered.drive("a")
    steered.sent()
    steered.drive("b", Velocity(-0.2, 0.0))
    assert steered.sent() == [Velocity(-0.2, 0.0)] and steered.driver == "b"
    steered.drive("a")
    steered.arbiter.reject("a")
    assert steered.driver == "b" and steered.command == Velocity(-0.2, 0.0)
    steered.release("b")
    steered.drive("a")
    assert steered.driver is None and steered.command == ZERO
    steered.release("a")
    steered.drive("a")
    assert steered.driver == "a" and steered.command == FORWARD


def _reject(steered: Steered) -> None:
    steered.arbiter.reject("a")


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize(
    "end", [lambda steered: steered.stop("b"), _reject, lambda steered: steered.arbiter.halt()]
)
def test_a_page_that_was_stopped_has_to_let_go_first(steered: Steered, end, held: bool) -> None:
    """None of these is undone by going on to hold; a page that held nothing may take hold.

    But not after nonsense.
    """
    if held:
        steered.drive("a")
    end(steered)
    steered.sent()
    if held or end is _reject:
        steered.drive("a")
        assert steered.sent() == [] and steered.driver is None
    steered.release("a")
    steered.drive("a")
    assert steered.sent()[-1:] == [FORWARD] and steered.driver == "a"


def test_a_stop_locks_the_robot_until_a_page_presses_anew(steered: Steered) -> None:
    """Each press of Stop; no held control unlocks, nor does a halt of the server lock."""
    steered.drive("a")
    steered.sent()
    for _ in range(2):
        steered.stop("b")
        assert steered.sent() == [ZERO]
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * (ZEROS - 1)
    steered.drive("a")
    assert steered.locks == [UNLOCK, LOCK, LOCK]
    steered.release("a")
    steered.drive("a")
    steered.drive("a")
    steered.arbiter.halt()
    assert steered.locks == [UNLOCK, LOCK, LOCK, UNLOCK]


@pytest.mark.parametrize(
    ("push", "moves", "rests"),
    [
        (DriveMessage(0.5, 0.0, 100.0, {}), Parts.WHEELS, Parts.JOINTS),
        (DriveMessage(0.0, 0.0, 100.0, {}, -0.5), Parts.WHEELS, Parts.JOINTS),
        (DriveMessage(0.0, 0.0, 100.0, {"arm": 9.0}), Parts.JOINTS, Parts.WHEELS),
    ],
)
def test_only_what_moves_is_unlocked(
    steered: Steered, push: DriveMessage, moves: Parts, rests: Parts
) -> None:
    """Whoever holds 0 wants a robot that stands, which another node may drive; so do its parts."""
    steered.stop("b")
    steered.drive("a", ZERO)
    assert steered.locks == [LOCK] and steered.driver == "a"
    for _ in range(2):
        steered.arbiter.handle("a", push)
        steered.drive("a", ZERO)
    assert steered.locks == [LOCK, (False, moves)]
    for _ in range(2):
        steered.drive("a", FORWARD)
    assert steered.locks == [LOCK, (False, moves), (False, rests)]


def test_a_silence_stops_and_the_same_grip_goes_on_after_it(steered: Steered) -> None:
    """After the time of the dead man's switch, not at it; a message that comes late is none."""
    for _ in range(10):
        steered.drive("a")
        steered.wait(COMMAND_TIMEOUT * 0.9)
    assert steered.command == FORWARD
    steered.drive("a")
    steered.wait(COMMAND_TIMEOUT)
    assert steered.command == FORWARD and not steered.arbiter.state.late
    steered.sent()
    steered.wait(0.001)
    steered.wait(10.0)
    assert steered.sent() == [ZERO] and steered.arbiter.timeouts == 1
    assert steered.driver == "a" and steered.arbiter.state.late == {"a"}
    steered.drive("a", age=9.9)
    assert steered.command == ZERO and steered.arbiter.state.late == {"a"}
    steered.drive("a", age=0.1)
    assert steered.sent() == [FORWARD] and not steered.arbiter.state.late


def test_a_command_holds_until_half_a_second_after_its_stamp(steered: Steered) -> None:
    """Whenever it comes: the hand that gave it may be gone as long as that."""
    steered.now = 0.0  # sums are exact
    steered.drive("a", age=MAX_AGE - 0.125)
    steered.wait(0.125)
    assert steered.command == FORWARD
    steered.wait(0.001)
    assert steered.command == ZERO and steered.arbiter.state.late == {"a"}
    for end in (steered.release, steered.arbiter.leave):
        steered.drive("a", age=2.0)
        end("a")
        assert not steered.arbiter.state.late


@pytest.mark.parametrize("other", [lambda s: s.stop("b"), lambda s: s.drive("b")])
@pytest.mark.parametrize("age", [5.0, 0.0])
def test_who_held_before_another_page_acted_does_not_drive_after_it(
    steered: Steered, age: float, other
) -> None:
    """Whether it drove and fell silent, or never came in time: it has to let go first."""
    steered.drive("a", age=age)
    steered.wait(COMMAND_TIMEOUT + 0.01)
    other(steered)
    steered.drive("a")
    assert steered.driver != "a"
    steered.release("a")
    steered.drive("a")
    assert steered.driver == "a"


_event = st.tuples(
    st.sampled_from(["drive", "release", "stop", "reject", "leave", "wait", "tick"]),
    st.sampled_from("abc"),
    st.floats(0.0, 0.4),
)


@given(st.lists(_event, max_size=60))
def test_the_robot_moves_only_while_its_driver_says_so(events) -> None:
    """Whatever pages do: a command that is not zero has a driver that spoke in time just before."""
    steered, spoke, pages = Steered("abc"), {}, set("abc")
    arbiter = steered.arbiter
    for kind, page, wait in events:
        if kind == "wait":
            steered.wait(wait)
        elif kind == "stop":
            steered.stop(page)
        elif kind == "tick":
            arbiter.tick()
        elif kind == "drive" and page in pages:
            steered.drive(page, age=2.0 * wait)
            if 2.0 * wait <= MAX_AGE:  # a late one changes nothing of what holds
                spoke[page] = steered.now, steered.now - 2.0 * wait
        elif page in pages:
            arbiter.handle(page, Release()) if kind == "release" else getattr(arbiter, kind)(page)
            pages -= {page} if kind == "leave" else set()
            assert steered.driver != page
        if arbiter.state.command != Command():
            if steered.driver is None:  # a tap
                assert any(steered.now - came <= STEP + 1e-9 for came, _ in spoke.values())
                continue
            assert steered.driver in pages
            came, stamp = spoke[steered.driver]
            rounding = 1e-9  # of sums of times
            assert steered.now - came <= COMMAND_TIMEOUT + rounding
            assert steered.now - stamp <= MAX_AGE + rounding
        assert arbiter.state.pages == len(pages)


def test_what_an_operator_chose_holds_within_the_robots_limits(steered: Steered) -> None:
    """Whoever sets it, also for what is held; it outlasts the robot.

    Of a robot that is slower, and of one that is faster than before.
    """
    arbiter = steered.arbiter
    arbiter.handle("a", SetLimits(0.5, 9.0))
    assert arbiter.state.limits.in_force == Velocity(0.5, 4.0) and steered.sent() == []
    steered.drive("a", Velocity(0.5, 0.0))
    arbiter.set_limits(limits(0.125, 1.0))
    arbiter.tick()
    assert steered.sent()[-1] == steered.command == Velocity(0.125, 0.0) and steered.driver == "a"
    assert arbiter.state.limits.in_force == Velocity(0.125, 1.0)
    arbiter.set_limits(limits(2.0, 6.0))
    assert arbiter.state.limits.in_force == Velocity(0.5, 6.0)


def _choose(steered: Steered, linear: float | None, angular: float | None = None) -> None:
    steered.arbiter.handle("b", SetLimits(linear, angular))


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["forward", "backward"])
@pytest.mark.parametrize("raised", [1.0, None], ids=["a number", "the field emptied"])
def test_a_raised_limit_waits_for_the_next_press(
    steered: Steered, raised: float | None, way: float
) -> None:
    """Another page's; a lowered one holds at once, and for the rest of the press."""
    _choose(steered, 0.3, 0.5)
    steered.drive("a", Velocity(way * 0.3, 0.5))
    _choose(steered, raised)
    steered.drive("a", Velocity(way, 0.5))
    assert steered.command == Velocity(way * 0.3, 0.5 * 0.3)
    _choose(steered, 0.2, 0.1)
    _choose(steered, raised)
    steered.wait(COMMAND_TIMEOUT + 0.001)  # a pause of the connection is no press
    steered.drive("a", Velocity(way, 0.0))
    assert steered.command == Velocity(way * 0.2, 0.0)
    steered.release("a")
    steered.drive("a", Velocity(way * 9.0, 0.0))
    assert steered.command == Velocity(way * (raised or 3.0), 0.0)
    steered.drive("b", Velocity(way * 9.0, 0.0))  # another driver presses, too
    assert steered.command == Velocity(way * (raised or 3.0), 0.0)


def test_what_was_sent_before_the_process_woke_does_not_drive(steered: Steered) -> None:
    """However short the stop was: neither the command in force nor those that waited.

    The next tick may come before the next check: its command is zero, too.
    """
    steered.drive("a")
    steered.now += 0.1
    steered.woke = steered.now
    steered.sent()
    steered.arbiter.tick()
    assert set(steered.sent()) == {ZERO} and steered.arbiter.state.late == {"a"}
    steered.drive("a", age=0.05)
    steered.arbiter.tick()
    assert steered.command == ZERO and not any(sent.linear for sent in steered.sent())
    steered.drive("b", age=0.05)
    assert steered.driver == "a" and steered.command == ZERO
    steered.now += 0.01
    steered.drive("a")
    assert steered.sent() == [FORWARD] and steered.driver == "a"


@pytest.mark.parametrize("idle", [0.3, 0.7, 2.0, 60.0])
def test_the_first_drive_counts_however_long_nobody_drove(idle: float) -> None:
    """Idleness is no sleep: a tap is a step, and a command goes out at its press."""
    now, published = [100.0], list[Velocity]()
    arbiter = Arbiter(
        limits(3.0, 4.0),
        lambda command: published.append(command.velocity),
        lambda *_: None,
        lambda: now[0],
        WakeDetector(lambda: now[0]).check,
    )
    arbiter.join("a")
    for check in (arbiter.check_timeout, arbiter.tick):
        for _ in range(round(idle / 0.05)):
            now[0] += 0.05
            check()
        arbiter.handle("a", DriveMessage(0.5, 0.1, now[0] - 0.02, {}))
        assert published[-1] == FORWARD and not arbiter.state.late
        now[0] += 0.05
        arbiter.handle("a", Release())


def test_to_halt_sends_all_zeros_at_once(steered: Steered) -> None:
    """Also those that are left of an earlier end."""
    steered.drive("a")
    steered.release("a")
    steered.sent()
    steered.arbiter.halt()
    assert steered.sent() == [ZERO] * ZEROS and steered.driver is None
    steered.arbiter.tick()
    assert steered.sent() == []
