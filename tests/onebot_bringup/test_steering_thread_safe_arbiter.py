"""What the robot is told, and when, of what pages say: at once where it matters. No ROS, no web."""

import pytest

from onebot_bringup.steering.arbiter import (
    COMMAND_TIMEOUT,
    ZEROS,
    ThreadSafeArbiter,
)
from onebot_bringup.steering.limits import Bound, Limits
from onebot_bringup.steering.protocol import Drive, Release, SetLimits, Stop, Velocity

FORWARD, ZERO = Velocity(0.5, 0.1), Velocity()


def limits(linear: float, angular: float) -> Limits:
    """Of a robot, the same forward and backward."""
    return Limits(Bound(linear, linear, linear), Bound(angular, angular, angular))


class Steered:
    """An arbiter of pages "a" and "b", what it published, and how often it notified pages."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        self.published: list[Velocity] = []
        self.changes = 0
        self.locks: list[bool] = []
        self.arbiter = ThreadSafeArbiter(limits(3.0, 4.0), self.published.append, self.locks.append)
        self.arbiter.handle("", SetLimits(1.0, 2.0))
        self.arbiter.join("a")
        self.arbiter.join("b")
        self.arbiter.changed = self._changed

    def _changed(self) -> None:
        self.changes += 1

    def drive(self, page: str, velocity: Velocity = FORWARD) -> None:
        """Have a page send a command that is not late."""
        self.arbiter.handle(page, Drive(velocity, self.now))

    def sent(self) -> list[Velocity]:
        """What was published since the last call."""
        sent, self.published[:] = list(self.published), []
        return sent


@pytest.fixture
def steered(monkeypatch: pytest.MonkeyPatch) -> Steered:
    """See ``Steered``; the time stands still unless a test moves it."""
    return Steered(monkeypatch)


def test_to_take_hold_is_published_at_once_and_then_at_the_fixed_rate(steered: Steered) -> None:
    """More of the same waits for its turn."""
    steered.drive("a")
    assert steered.sent() == [FORWARD] and steered.changes == 1
    steered.drive("a", Velocity(0.6, 0.0))
    assert steered.sent() == [] and steered.changes == 1
    steered.arbiter.tick()
    assert steered.sent() == [Velocity(0.6, 0.0)]


@pytest.mark.parametrize("end", ["release", "stop", "leave", "reject"])
def test_an_end_is_published_at_once(steered: Steered, end: str) -> None:
    """A zero, and the others with the next ticks; pages learn that nobody drives."""
    steered.drive("a")
    steered.sent()
    ends = {
        "release": lambda: steered.arbiter.handle("a", Release()),
        "stop": lambda: steered.arbiter.handle("b", Stop()),
        "leave": lambda: steered.arbiter.leave("a"),
        "reject": lambda: steered.arbiter.reject("a"),
    }
    ends[end]()
    assert steered.sent() == [ZERO] and steered.changes == 2
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * (ZEROS - 1)
    assert steered.arbiter.state.driver is None and steered.arbiter.state.command == ZERO


def test_another_driver_s_command_is_published_at_once(steered: Steered) -> None:
    """The robot does not go on for a period of the first one's."""
    steered.drive("a")
    steered.sent()
    steered.drive("b", Velocity(-0.2, 0.0))
    assert steered.sent() == [Velocity(-0.2, 0.0)] and steered.arbiter.state.driver == "b"


def test_the_stop_button_is_published_even_if_nobody_drives(steered: Steered) -> None:
    """Something else may be driving the robot; and again each time it is pressed."""
    for _ in range(2):
        steered.arbiter.handle("a", Stop())
        assert steered.sent() == [ZERO]
    assert steered.changes == 0


def test_a_stop_locks_the_robot_until_a_page_presses_anew(steered: Steered) -> None:
    """What is held all the time unlocks nothing, nor does a halt of the server lock."""
    steered.drive("a")
    steered.arbiter.handle("b", Stop())
    steered.arbiter.handle("b", Stop())
    steered.drive("a")
    assert steered.locks == [False, True, True]
    steered.arbiter.handle("a", Release())
    steered.drive("a")
    steered.drive("a")
    steered.arbiter.halt()
    assert steered.locks == [False, True, True, False]


def test_a_control_held_at_zero_does_not_unlock(steered: Steered) -> None:
    """Whoever presses 0 wants a robot that stands, which another node may drive; a push unlocks."""
    steered.arbiter.handle("b", Stop())
    steered.drive("a", ZERO)
    assert steered.locks == [True] and steered.arbiter.state.driver == "a"
    for velocity in (FORWARD, ZERO, FORWARD):
        steered.drive("a", velocity)
    assert steered.locks == [True, False]


def test_a_silent_driver_is_stopped_at_once(steered: Steered) -> None:
    """After the time of the dead man's switch, not at it; its next word drives on."""
    steered.drive("a")
    steered.sent()
    steered.now += COMMAND_TIMEOUT
    steered.arbiter.check_timeout()
    assert steered.sent() == [] and steered.arbiter.timeouts == 0
    steered.now = 100.0 + COMMAND_TIMEOUT + 0.001
    steered.arbiter.check_timeout()
    assert steered.sent() == [ZERO] and steered.arbiter.timeouts == 1
    steered.arbiter.check_timeout()
    assert steered.sent() == [] and steered.arbiter.timeouts == 1
    assert steered.arbiter.state.driver == "a" and steered.arbiter.state.late == {"a"}
    steered.drive("a")
    assert steered.sent() == [FORWARD] and not steered.arbiter.state.late


def test_after_a_stall_nothing_old_is_published(steered: Steered) -> None:
    """The next tick may come before the next check: its command is zero, too."""
    steered.drive("a")
    steered.sent()
    steered.now += COMMAND_TIMEOUT + 0.001
    for _ in range(ZEROS + 2):
        steered.arbiter.tick()
    assert steered.sent() == [ZERO] * ZEROS and steered.arbiter.timeouts == 1


def test_silence_counts_from_the_last_word(steered: Steered) -> None:
    """Saying the same again keeps the robot going."""
    for _ in range(10):
        steered.drive("a")
        steered.now += COMMAND_TIMEOUT * 0.9
        steered.arbiter.check_timeout()
    assert steered.arbiter.state.command == FORWARD and steered.arbiter.timeouts == 0


def test_limits_are_the_robots_or_lower(steered: Steered) -> None:
    """Whoever sets them; pages learn of what is new only."""
    arbiter = steered.arbiter
    arbiter.handle("a", SetLimits(5.0, 0.5))
    assert arbiter.state.limits.in_force == Velocity(3.0, 0.5) and steered.changes == 1
    arbiter.handle("b", SetLimits(5.0, 0.5))
    assert steered.changes == 1
    arbiter.handle("a", SetLimits(0.25, None))
    assert arbiter.state.limits.in_force == Velocity(0.25, 4.0)
    assert steered.changes == 2 and steered.sent() == []
    steered.drive("a")
    assert steered.sent() == [Velocity(0.25, 0.05)] == [arbiter.state.command]


def test_what_an_operator_chose_outlasts_the_robot(steered: Steered) -> None:
    """Also what is above the present robot's limit; and it binds a command that is held."""
    arbiter = steered.arbiter
    arbiter.handle("a", SetLimits(0.5, 9.0))
    steered.drive("a", Velocity(0.5, 0.0))
    arbiter.set_limits(limits(0.125, 1.0))
    assert arbiter.state.command == Velocity(0.125, 0.0) and arbiter.state.driver == "a"
    assert arbiter.state.limits.in_force == Velocity(0.125, 1.0)
    arbiter.set_limits(limits(2.0, 6.0))
    assert arbiter.state.limits.in_force == Velocity(0.5, 6.0)
    assert arbiter.state.command == Velocity(0.5, 0.0)


def test_who_drove_is_known_to_the_log(steered: Steered) -> None:
    """To lose a page that drives is another thing than to lose one that looks on."""
    steered.drive("a")
    assert not steered.arbiter.reject("b") and steered.arbiter.reject("a")
    steered.arbiter.handle("b", Release())
    steered.drive("b")
    assert not steered.arbiter.leave("a") and steered.arbiter.leave("b")


def test_pages_come_and_go(steered: Steered) -> None:
    """All the others learn how many there are; the robot learns nothing."""
    steered.arbiter.join("c")
    assert steered.arbiter.state.pages == 3 and steered.changes == 1
    steered.arbiter.leave("c")
    steered.arbiter.leave("c")
    assert steered.arbiter.state.pages == 2 and steered.changes == 2 and steered.sent() == []


def test_to_halt_sends_all_zeros_at_once(steered: Steered) -> None:
    """To a robot that was driven; one that was not is left alone."""
    steered.arbiter.halt()
    assert steered.sent() == [] and steered.changes == 1
    steered.arbiter.tick()
    assert steered.sent() == []
    steered.drive("a")
    steered.sent()
    steered.arbiter.halt()
    assert steered.sent() == [ZERO] * ZEROS and steered.arbiter.state.driver is None
    steered.arbiter.tick()
    assert steered.sent() == []
    steered.drive("a")
    assert steered.sent() == [], "it has to let go first"


def test_a_page_cannot_drive_on_after_nonsense_without_letting_go(steered: Steered) -> None:
    """Also one that did not drive when it was refused."""
    steered.arbiter.reject("a")
    assert steered.sent() == []
    steered.drive("a")
    assert steered.sent() == [] and steered.arbiter.state.driver is None
    steered.arbiter.handle("a", Release())
    steered.drive("a")
    assert steered.sent() == [FORWARD]
