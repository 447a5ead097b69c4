"""The real-time factor that a loop reaches, and what is logged of it."""

import pytest

from onebot_control.real_time import Pace, PaceMeter

PERIOD = 1 / 64  # s, so that sums are exact


class Loop:
    """Control cycles, what is measured of them, and what is logged at which second."""

    def __init__(self, wanted: float = 1.0) -> None:
        self.paces: list[Pace] = []
        self.slow: list[bool] = []
        self.log: list[tuple[int, str, bool]] = []
        self.now = 100.0
        self._meter = PaceMeter(self._on_pace, self._on_log)
        self._meter.set(self.now, wanted)

    def _on_pace(self, pace: Pace, is_slow: bool) -> None:
        self.paces.append(pace)
        self.slow.append(is_slow)

    def _on_log(self, text: str, is_slow: bool) -> None:
        self.log.append((round(self.now - 100.0), text, is_slow))

    def run(self, seconds: float, missed: int = 0, factor: float = 1.0) -> None:
        """Let cycles leave out so many after each."""
        until = self.now + seconds
        while self.now < until:
            self.now += PERIOD / factor * (1 + missed)
            self._meter.cycle(self.now, PERIOD, missed)

    def pause(self, seconds: float) -> None:
        self.now += seconds
        self._meter.skip(self.now)


def test_it_is_measured_each_second() -> None:
    """Of 64 cycles that were to be, 48 are missed."""
    loop = Loop()
    loop.run(2.0)
    loop.pause(30.0)
    loop.run(1.0, missed=3)
    assert [pace.factor for pace in loop.paces] == pytest.approx([1.0, 1.0, 0.25])
    assert [(pace.cycles, pace.missed) for pace in loop.paces] == [(64, 0), (64, 0), (16, 48)]
    assert loop.slow == [False, False, True]


def test_it_is_logged_when_it_falls_then_once_a_minute_with_sums() -> None:
    """Until a minute in which no cycle was missed; a single cycle is not worth a line."""
    loop = Loop()
    loop.run(9.5)
    loop.run(2 * PERIOD, missed=1)
    loop.run(90.5 - 2 * PERIOD)
    loop.run(80.0, missed=3)
    loop.run(200.0)
    sums = [(at, line.split(": ")[-1], is_slow) for at, line, is_slow in loop.log]
    assert sums == [
        (101, "real-time factor 0.25 in the last 1 s, 48 of 64 control cycles missed", True),
        (161, "real-time factor 0.25 in the last 60 s, 2880 of 3840 control cycles missed", True),
        (221, "real-time factor 0.76 in the last 60 s, 912 of 3840 control cycles missed", True),
        (281, "real-time factor 1 in the last 60 s, 0 of 3840 control cycles missed", False),
    ]


@pytest.mark.parametrize(("wanted", "slow"), [(0.0, False), (4.0, False), (5.0, True)])
def test_it_is_slow_by_what_is_wanted(wanted: float, slow: bool) -> None:
    loop = Loop(wanted)
    loop.run(1.0, factor=4.0)
    assert (loop.paces[0].factor, loop.slow) == (pytest.approx(4.0), [slow])
