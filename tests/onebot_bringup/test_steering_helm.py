"""What the robot is told, and when, of what pages say: at once where it matters. No ROS, no web."""

import pytest

from onebot_bringup.steering.arbiter import DEAD_MAN, GRIP, ZEROS, Helm
from onebot_bringup.steering.protocol import Drive, Release, SetLimits, Stop, Velocity

FORWARD, ZERO = Velocity(0.5, 0.1), Velocity()


class Steered:
    """A helm with pages "a" and "b", what it has published, and how often pages were informed."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        self.published: list[Velocity] = []
        self.changes = 0
        self.helm = Helm(Velocity(1.0, 2.0), self.published.append, Velocity(3.0, 4.0))
        self.helm.join("a")
        self.helm.join("b")
        self.helm.changed = self._changed

    def _changed(self) -> None:
        self.changes += 1

    def said(self) -> list[Velocity]:
        """What was published since the last call."""
        said, self.published[:] = list(self.published), []
        return said


@pytest.fixture
def steered(monkeypatch: pytest.MonkeyPatch) -> Steered:
    """See ``Steered``; the time stands still unless a test moves it."""
    return Steered(monkeypatch)


def test_to_take_hold_is_published_at_once_and_then_at_the_fixed_rate(steered: Steered) -> None:
    """More of the same waits for its turn."""
    steered.helm.take("a", Drive(FORWARD))
    assert steered.said() == [FORWARD] and steered.changes == 1
    steered.helm.take("a", Drive(Velocity(0.6, 0.0)))
    assert steered.said() == [] and steered.changes == 1
    steered.helm.tick()
    assert steered.said() == [Velocity(0.6, 0.0)]


@pytest.mark.parametrize("end", ["release", "stop", "leave", "refuse"])
def test_an_end_is_published_at_once(steered: Steered, end: str) -> None:
    """A zero, and the others with the next ticks; pages learn that nobody drives."""
    steered.helm.take("a", Drive(FORWARD))
    steered.said()
    ends = {
        "release": lambda: steered.helm.take("a", Release()),
        "stop": lambda: steered.helm.take("b", Stop()),
        "leave": lambda: steered.helm.leave("a"),
        "refuse": lambda: steered.helm.refuse("a"),
    }
    ends[end]()
    assert steered.said() == [ZERO] and steered.changes == 2
    for _ in range(ZEROS + 2):
        steered.helm.tick()
    assert steered.said() == [ZERO] * (ZEROS - 1)
    assert steered.helm.now.driver is None and steered.helm.now.command == ZERO


def test_another_driver_s_command_is_published_at_once(steered: Steered) -> None:
    """The robot does not go on for a period of the first one's."""
    steered.helm.take("a", Drive(FORWARD))
    steered.said()
    steered.helm.take("b", Drive(Velocity(-0.2, 0.0)))
    assert steered.said() == [Velocity(-0.2, 0.0)] and steered.helm.now.driver == "b"


def test_the_stop_button_is_published_even_if_nobody_drives(steered: Steered) -> None:
    """Something else may be driving the robot; and again each time it is pressed."""
    for _ in range(2):
        steered.helm.take("a", Stop())
        assert steered.said() == [ZERO]
    assert steered.changes == 0


def test_a_silent_driver_is_stopped_at_once(steered: Steered) -> None:
    """After the time of the dead man's switch, not at it; then it loses the wheel."""
    steered.helm.take("a", Drive(FORWARD))
    steered.said()
    steered.now += DEAD_MAN
    steered.helm.check()
    assert steered.said() == [] and steered.helm.lapses == 0
    steered.now = 100.0 + DEAD_MAN + 0.001
    steered.helm.check()
    assert steered.said() == [ZERO] and steered.helm.lapses == 1 and steered.changes == 1
    steered.helm.check()
    assert steered.said() == [] and steered.helm.lapses == 1
    steered.now = 100.0 + GRIP
    steered.helm.check()
    assert steered.helm.now.driver == "a" and steered.changes == 1
    steered.now = 100.0 + GRIP + 0.001
    steered.helm.check()
    assert steered.helm.now.driver is None and steered.changes == 2
    assert steered.helm.lapses == 1


def test_silence_counts_from_the_last_word(steered: Steered) -> None:
    """Saying the same again keeps the robot going."""
    for _ in range(10):
        steered.helm.take("a", Drive(FORWARD))
        steered.now += DEAD_MAN * 0.9
        steered.helm.check()
    assert steered.helm.now.command == FORWARD and steered.helm.lapses == 0


def test_limits_are_bounded_by_the_ceiling(steered: Steered) -> None:
    """From the beginning, and whoever sets them; pages learn of what is new only."""
    assert Helm(Velocity(9.0, 9.0), lambda _: None, Velocity(3.0, 4.0)).now.limits == Velocity(3, 4)
    assert Helm(Velocity(9.0, 9.0), lambda _: None).now.limits == Velocity(9, 9)
    steered.helm.take("a", SetLimits(Velocity(5.0, 0.5)))
    assert steered.helm.now.limits == Velocity(3.0, 0.5) and steered.changes == 1
    steered.helm.set_limits(Velocity(3.0, 0.5))
    assert steered.changes == 1
    steered.helm.set_limits(Velocity(0.25, 0.05))
    assert steered.changes == 2 and steered.said() == []
    steered.helm.take("a", Drive(FORWARD))
    assert steered.said() == [Velocity(0.25, 0.05)] == [steered.helm.now.command]


def test_pages_come_and_go(steered: Steered) -> None:
    """All the others learn how many there are; the robot learns nothing."""
    steered.helm.join("c")
    assert steered.helm.now.pages == 3 and steered.changes == 1
    steered.helm.leave("c")
    steered.helm.leave("c")
    assert steered.helm.now.pages == 2 and steered.changes == 2 and steered.said() == []


def test_to_halt_sends_all_zeros_at_once(steered: Steered) -> None:
    """To a robot that was driven; one that was not is left alone."""
    steered.helm.halt()
    assert steered.said() == [] and steered.changes == 1
    steered.helm.tick()
    assert steered.said() == []
    steered.helm.take("a", Drive(FORWARD))
    steered.said()
    steered.helm.halt()
    assert steered.said() == [ZERO] * ZEROS and steered.helm.now.driver is None
    steered.helm.tick()
    assert steered.said() == []
    steered.helm.take("a", Drive(FORWARD))
    assert steered.said() == [], "it has to let go first"


def test_a_page_cannot_drive_on_after_nonsense_without_letting_go(steered: Steered) -> None:
    """Also one that did not drive when it was refused."""
    steered.helm.refuse("a")
    assert steered.said() == []
    steered.helm.take("a", Drive(FORWARD))
    assert steered.said() == [] and steered.helm.now.driver is None
    steered.helm.take("a", Release())
    steered.helm.take("a", Drive(FORWARD))
    assert steered.said() == [FORWARD]
