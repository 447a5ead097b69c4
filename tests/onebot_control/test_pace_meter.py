"""What is logged of the real-time factor that a loop reaches."""

import pytest

from onebot_control.runtime.pacing import Pace, PaceMeter

PERIOD = 1 / 64  # s, so that sums are exact


class Loop(PaceMeter):
    """Control cycles, what is measured of each second, and what is logged at which one."""

    def __init__(self, wanted: float = 1.0) -> None:
        super().__init__(self.report)
        self.seconds: list[tuple[Pace, bool]] = []
        self.lines: list[tuple[int, str, bool]] = []
        self.now = 100.0
        self.set(self.now, wanted)

    def report(self, pace: Pace, is_slow: bool, line: str) -> None:
        self.seconds.append((pace, is_slow))
        if line:
            self.lines.append((round(self.now - 100.0), line, is_slow))

    def run(self, seconds: float, missed: int = 0, factor: float = 1.0) -> None:
        """Let cycles leave out so many after each."""
        until = self.now + seconds
        while self.now < until:
            self.now += PERIOD / factor * (1 + missed)
            self.cycle(self.now, PERIOD, missed)

    def pause(self, seconds: float) -> None:
        self.now += seconds
        self.skip(self.now)


def test_it_is_logged_when_it_falls_then_each_minute_and_once_when_it_is_back() -> None:
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
    missed = "control cycles missed"
    slow = f"slow motion: real-time factor 0.25 in the last 1 s, 48 of 64 {missed}"
    back = f"the pace is back: real-time factor 1 in the last 5 s, 0 of 320 {missed}"
    assert loop.lines == [
        (101, slow, True),
        (161, f"slow motion: real-time factor 0.25 in the last 60 s, 2880 of 3840 {missed}", True),
        (221, f"slow motion: real-time factor 0.51 in the last 60 s, 1872 of 3840 {missed}", True),
        (225, back, False),
        (1221, slow, True),
        (1226, back, False),
    ]
    assert [is_slow for _, is_slow in loop.seconds].count(True) == 129
    pace, is_slow = loop.seconds[70]
    assert (pace.factor, pace.missed, pace.cycles, is_slow) == (0.25, 48, 64, True)


def test_it_is_back_at_95_percent_of_what_is_wanted() -> None:
    loop = Loop(2.0)
    loop.run(1.0, factor=1.0)
    loop.run(50.0, factor=1.89)
    assert [is_slow for *_, is_slow in loop.lines] == [True]
    loop.run(10.0, factor=1.91)
    assert [is_slow for *_, is_slow in loop.lines] == [True, False]


@pytest.mark.parametrize(("wanted", "slow"), [(0.0, []), (4.0, []), (5.0, [True])])
def test_it_is_slow_by_what_is_wanted(wanted: float, slow: list[bool]) -> None:
    loop = Loop(wanted)
    loop.run(1.0, factor=4.0)
    assert [is_slow for *_, is_slow in loop.lines] == slow
