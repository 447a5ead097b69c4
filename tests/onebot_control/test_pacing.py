"""Deadlines and stamps."""

import ctypes
import sys
import threading
from itertools import pairwise

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


def test_change_of_factor_counts_from_the_next_cycle_on() -> None:
    """The grid goes on from the present deadline, and no lag is left over from the old one."""
    machine = Machine()
    pacer = machine.pacer()
    for period, factor, expected in [
        (0.01, 1.0, 100.01),
        (0.01, 0.5, 100.03),
        (0.02, 4.0, 100.035),
        (0.02, 1.0, 100.055),
    ]:
        machine.now += 0.002
        pacer.set(period, factor)
        pacer.next(machine.wait)
        assert machine.now == pacer.due == pytest.approx(expected)
        assert pacer.lag == 0.0


def test_as_fast_as_possible_never_lags_nor_makes_up_for_it() -> None:
    """However long a cycle took; slowed down again, the next one is a whole period later."""
    machine = Machine()
    pacer = machine.pacer(factor=0.0)
    waits = list[float]()
    for _ in range(3):
        machine.now += 5.0
        pacer.next(waits.append)
        assert (pacer.due, pacer.lag) == (machine.now, 0.0)
    assert waits == [0.0] * 3  # to look whether it is to stop
    pacer.set(0.01, 1.0)
    pacer.next(machine.wait)
    assert (machine.now, pacer.lag) == (pytest.approx(115.01), 0.0)


@pytest.mark.parametrize(
    ("work", "lag", "due"),
    [
        (0.25, 0.0, 100.25),  # on time to the bit
        (0.375, 0.0, 100.25),  # late, but within the next period: the grid stays
        (0.5, 0.25, 100.5),  # late by a whole period: the grid begins anew
        (0.625, 0.375, 100.625),
    ],
)
def test_late_by_less_and_by_more_than_a_period(work: float, lag: float, due: float) -> None:
    """A cycle that is late comes at once, without a wait."""
    machine, waits = Machine(), list[float]()
    pacer = machine.pacer(period=0.25)
    machine.now += work
    pacer.next(waits.append)
    assert (waits, pacer.lag, pacer.due) == ([], lag, due)
    machine.now = due
    pacer.next(waits.append)
    assert (waits, pacer.lag, pacer.due) == ([0.25], 0.0, due + 0.25)


@pytest.mark.parametrize("sign", [1, -1])
def test_drift_of_2_ms_is_the_most_that_is_not_followed(sign: int) -> None:
    """It adds up: the comparison is with the offset in use."""
    ahead = 1_000_000_000
    stamps = SystemStamps(lambda: 7_000_000, lambda: 7_000_000 + ahead)
    ahead += sign * 2_000_000
    assert stamps.at(1.0) == 2_000_000_000
    ahead += sign
    assert stamps.at(1.0) == 1_000_000_000 + ahead
    ahead -= sign * 2_000_000
    assert stamps.at(1.0) == 2_000_000_000 + sign * 2_000_001


@pytest.mark.parametrize("one_in", [1, 2, 3, 10, 30])
def test_divider_picks_every_so_many(one_in: int) -> None:
    """The first and then each at the same distance, in spite of rounding."""
    divider = Divider(100.0 / one_in, 100.0)
    picked = [cycle for cycle in range(3000) if divider.due()]
    assert picked == list(range(0, 3000, one_in))


def test_divider_picks_evenly() -> None:
    """Of a rate that does not divide the other, distances differ by one cycle at most."""
    divider = Divider(30.0, 100.0)
    picked = [cycle for cycle in range(100) if divider.due()]
    assert {after - before for before, after in pairwise(picked)} == {3, 4}


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
