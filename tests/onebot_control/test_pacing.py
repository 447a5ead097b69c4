"""Deadlines and stamps."""

import ctypes
import sys
import threading

import pytest

from onebot_control.control_loop import Divider, Pacer, SystemStamps, wake_exactly


class Machine:
    """A clock whose time passes only by waiting and working."""

    def __init__(self) -> None:
        self.now = 100.0

    def wait(self, seconds: float) -> None:
        self.now += seconds

    def pacer(self, period: float = 0.01, factor: float = 1.0) -> Pacer:
        return Pacer(period, factor, clock=lambda: self.now)


def test_deadlines_are_a_grid() -> None:
    """Work of any length within the period leaves the grid where it is."""
    machine = Machine()
    pacer = machine.pacer()
    for cycle in range(1, 100):
        machine.now += 0.001 * (cycle % 9)
        pacer.next(machine.wait)
        assert machine.now == pytest.approx(100.0 + 0.01 * cycle)


def test_lag_is_not_caught_up() -> None:
    """After a stall there is one cycle at once, then the old distance again: no burst."""
    machine = Machine()
    pacer = machine.pacer()
    machine.now += 1.0
    pacer.next(machine.wait)
    assert pacer.lag == pytest.approx(0.99)
    stalled = machine.now
    for cycle in range(1, 10):
        pacer.next(machine.wait)
        assert pacer.lag == 0.0
        assert machine.now == pytest.approx(stalled + 0.01 * cycle)


@pytest.mark.parametrize(("factor", "expected"), [(2.0, 0.005), (0.5, 0.02), (0.0, 0.0)])
def test_factor(factor: float, expected: float) -> None:
    """Twice as fast is half the time between cycles; 0 does not wait at all."""
    machine = Machine()
    pacer = machine.pacer(factor=factor)
    pacer.next(machine.wait)
    assert machine.now == pytest.approx(100.0 + expected)
    assert pacer.lag == 0.0


def test_stamps_are_even_and_follow_a_clock_that_is_set() -> None:
    """Small deviations do not show; a jump of the system clock does, both ways."""
    system = {"ahead": 1_000_000_000_000}
    monotonic = {"now": 5_000_000_000}
    stamps = SystemStamps(lambda: monotonic["now"], lambda: monotonic["now"] + system["ahead"])
    assert stamps.at(5.0) == 1_005_000_000_000
    system["ahead"] += 1_000_000
    assert stamps.at(5.01) == 1_005_010_000_000
    system["ahead"] -= 60_000_000_000
    assert stamps.at(5.02) == 945_021_000_000


@pytest.mark.parametrize(("rate", "expected"), [(50.0, 50), (30.0, 30), (100.0, 100), (500.0, 100)])
def test_divider_picks_the_right_number(rate: float, expected: int) -> None:
    """Of 100 cycles a second it picks as many as asked for, and not more than all."""
    divider = Divider(rate, 100.0)
    picked = [divider.due() for _ in range(1000)]
    assert picked[0]
    assert sum(picked) == pytest.approx(expected * 10, abs=1)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets threads choose")
def test_waits_of_one_thread_end_on_time() -> None:
    """The kernel then puts none of its timers off, and those of other threads as before."""
    slack = ctypes.CDLL(None).prctl
    asking = 30  # PR_GET_TIMERSLACK
    before, found = slack(asking), []

    def ask() -> None:
        wake_exactly()
        found.append(slack(asking))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    assert found == [1]
    assert slack(asking) == before > 1
