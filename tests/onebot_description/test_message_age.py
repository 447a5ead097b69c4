"""How old messages are by their senders' clocks. No ROS."""

import pytest

from onebot_description.ros.message_age import Age, Delivery, SenderClock
from onebot_description.timing import NS_PER_S

_NOW = 1_700_000_000 * NS_PER_S
_MS = NS_PER_S // 1000


class Sender:
    """A publisher, whose clock is behind by ``behind`` s, and what a subscriber finds."""

    def __init__(self, behind: float = 0.0) -> None:
        self.behind, self.clock = round(behind * NS_PER_S), SenderClock()
        self.now, self.number = _NOW, 0

    def message(self, transit: float = 0.001) -> Delivery:
        """Send one that arrives after ``transit`` s, at ``now``."""
        self.number += 1
        sent = self.now - round(transit * NS_PER_S)
        return Delivery(sent - self.behind, self.now, self.number)

    def send(self, transit: float = 0.001) -> Age:
        """Send one, and return its age as the subscriber has it."""
        return self.clock.age(self.message(transit), self.now)

    def stream(self, count: int = 20) -> list[Age]:
        """Send some at 20 Hz."""
        return [self._next() for _ in range(count)]

    def _next(self) -> Age:
        self.now += 50 * _MS
        return self.send()


@pytest.mark.parametrize("behind", [0.0, 30.0, -30.0, 3e7])
def test_a_stream_tells_the_senders_clock(behind: float) -> None:
    """Then a message that was late is as old as it is, however wrong that clock is."""
    sender = Sender(behind)
    assert sender.stream()[-1] == pytest.approx((0.0, 0.0), abs=1e-6)
    sender.now += 3 * NS_PER_S
    assert sender.send(transit=3.0) == pytest.approx((2.999, 2.999), abs=1e-6)
    assert sender.send() == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("behind", "most"), [(0.0, 2.0), (30.0, 32.0), (-30.0, 10.0), (-1.95, 0.05)]
)
def test_until_then_a_message_may_be_as_old_as_its_stamp(behind: float, most: float) -> None:
    """It is certain only how long it has waited here."""
    sender = Sender(behind)
    message = sender.message(transit=2.0)
    assert sender.clock.age(message, sender.now + 300 * _MS) == pytest.approx((0.3, most + 0.3))


def test_what_waited_does_not_tell_the_clock() -> None:
    """Neither in one burst, nor in several: only a steady stream does."""
    sender = Sender()
    for burst in range(20):
        sender.now += 300 * _MS
        ages = [sender.send(transit=10.0 - 0.05 * row + 0.3 * burst) for row in range(10)]
        assert min(age.maximum for age in ages) > 9.0 + 0.3 * burst


def test_another_publisher_has_another_clock() -> None:
    """It counts its messages from 1: what is known of the one before does not count."""
    sender = Sender()
    sender.stream()
    other = Delivery(sender.now - 30 * NS_PER_S, sender.now, 1)
    assert sender.clock.age(other, sender.now) == pytest.approx((0.0, 30.0))


@pytest.mark.parametrize("step", [-30.0, 30.0])
def test_a_clock_that_is_set_is_learned_anew(step: float) -> None:
    sender = Sender()
    sender.stream()
    sender.behind += round(step * NS_PER_S)
    ages = sender.stream()
    assert ages[0].maximum >= 9.9
    assert ages[-1] == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_middleware_that_does_not_count_messages() -> None:
    sender = Sender(30.0)
    for _ in range(20):
        sender.now += 50 * _MS
        age = sender.clock.age(sender.message()._replace(number=None), sender.now)
    assert age == pytest.approx((0.0, 0.0), abs=1e-6)
