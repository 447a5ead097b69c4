"""What is logged of the real-time factor that a loop reaches."""

import pytest

from onebot_control.runtime.pacing import PaceMeter

PERIOD = 1 / 64  # s, so that sums are exact


class Loop(PaceMeter):
    """Control cycles, and what is logged at which second."""

    def __init__(self, wanted: float = 1.0) -> None:
        super().__init__(lambda *line: self.lines.append((round(self.now - 100.0), *line)))
        self.lines: list[tuple[int, str, bool]] = []
        self.now = 100.0
        self.set(self.now, wanted)

    def run(self, seconds: float, missed: int = 0, factor: float = 1.0) -> None:
        """Let cycles leave out so many after each."""
        until = self.now + seconds
        while self.now < until:
            self.now += PERIOD / factor * (1 + missed)
            self.cycle(self.now, PERIOD, missed)

    def pause(self, seconds: float) -> None:
        self.now += seconds
        self.skip(self.now)


def test_it_is_logged_once_when_it_falls_and_once_when_it_is_back() -> None:
    """A single cycle is not worth a line; nor is a good second among slow ones, nor a pause."""
    loop = Loop()
    loop.run(9.5)
    loop.run(2 * PERIOD, missed=1)
    loop.run(60.5 - 2 * PERIOD)
    loop.pause(30.0)
    loop.run(80.0, missed=3)
    for _ in range(20):
        loop.run(1.0)
        loop.run(1.0, missed=3)
    loop.run(1000.0)
    loop.run(1.0, missed=3)
    loop.run(1000.0)
    slow = "slow motion: real-time factor 0.25, 48 of 64 control cycles missed in the last second"
    back = "the pace is back: real-time factor 1, 0 of 64 control cycles missed in the last second"
    lines = [(101, slow, True), (225, back, False), (1221, slow, True), (1226, back, False)]
    assert loop.lines == lines


def test_it_is_back_at_95_percent_of_what_is_wanted() -> None:
    loop = Loop(2.0)
    loop.run(1.0, factor=1.0)
    loop.run(60.0, factor=1.89)
    assert [is_slow for *_, is_slow in loop.lines] == [True]
    loop.run(10.0, factor=1.91)
    assert [is_slow for *_, is_slow in loop.lines] == [True, False]


@pytest.mark.parametrize(("wanted", "slow"), [(0.0, []), (4.0, []), (5.0, [True])])
def test_it_is_slow_by_what_is_wanted(wanted: float, slow: list[bool]) -> None:
    loop = Loop(wanted)
    loop.run(1.0, factor=4.0)
    assert [is_slow for *_, is_slow in loop.lines] == slow
