"""When cycles are due, and their stamps."""

import ctypes
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.runtime.pacing import Pacer, SystemStamps, wake_exactly
from onebot_description.timing import NS_PER_S


class Machine:
    """A clock whose time passes only by waiting and working."""

    def __init__(self) -> None:
        self.now = 100.0

    def pacer(self, period: float = 0.01, factor: float = 1.0) -> Pacer:
        self._pacer = Pacer(period, factor, clock=lambda: self.now)
        return self._pacer

    def wait(self) -> None:
        self.now = max(self.now, self._pacer.due)


def test_a_stop_while_it_waits_is_lag() -> None:
    machine = Machine()
    pacer = machine.pacer(period=0.25)
    assert (pacer.lag, pacer.missed) == (0.0, 0)

    def stopped() -> None:
        machine.now = pacer.due + 5.0

    pacer.next(stopped)
    assert (pacer.lag, pacer.due, pacer.missed) == (5.0, 105.25, 20)
    pacer.next(machine.wait)
    assert (pacer.lag, machine.now) == (0.0, 105.5)


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
    for _ in range(3):
        machine.now += 5.0
        pacer.next(machine.wait)
        assert (pacer.due, pacer.lag) == (machine.now, 0.0)
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
    machine = Machine()
    pacer = machine.pacer(period=0.25)
    machine.now += work
    pacer.next(machine.wait)
    assert (machine.now, pacer.lag, pacer.due) == (100.0 + work, lag, due)
    assert pacer.missed == (1 if lag else 0)
    pacer.next(machine.wait)
    assert (machine.now, pacer.lag, pacer.due) == (due + 0.25, 0.0, due + 0.25)


@pytest.mark.parametrize("sign", [1, -1])
def test_drift_of_2_ms_is_the_most_that_is_not_followed(sign: int) -> None:
    ahead = 1_000_000_000
    stamps = SystemStamps(lambda: 7_000_000, lambda: 7_000_000 + ahead)
    ahead += sign * 2_000_000
    assert stamps.at(1.0) == 2_000_000_000
    ahead += sign
    assert stamps.at(2.0) == 2_000_000_000 + ahead
    ahead -= sign * 2_000_000
    assert stamps.at(3.0) == 4_000_000_000 + sign * 2_000_001


class BusyMachine:
    """Two clocks, and a thread that is off the processor for a while between any two readings."""

    def __init__(self) -> None:
        self.now, self.ahead = 50 * NS_PER_S, 10**18
        self._pauses_ms: Iterator[int] = iter(())
        self.stamps = SystemStamps(self._monotonic_ns, self._system_ns)

    def pause(self, pauses_ms: Iterable[int]) -> None:
        """Be off the processor for so long before each of the readings to come."""
        self._pauses_ms = iter(pauses_ms)

    def _monotonic_ns(self) -> int:
        self.now += next(self._pauses_ms, 0) * 1_000_000
        return self.now

    def _system_ns(self) -> int:
        return self._monotonic_ns() + self.ahead


@pytest.mark.parametrize("pauses_ms", [(0, 30, 0), (0, 0, 30), (0, 0, 30, 0, 30)])
def test_a_pause_between_two_readings_of_the_clocks_moves_no_stamp(
    pauses_ms: Sequence[int],
) -> None:
    """30 ms off the processor once put a stamp 20 ms before that of the cycle before."""
    machine = BusyMachine()
    machine.pause([0, 0, 0, *pauses_ms])
    found = [machine.stamps.at(50.0 + 0.01 * cycle) for cycle in range(6)]
    assert found == [10**18 + 50 * NS_PER_S + 10_000_000 * cycle for cycle in range(6)]


@given(
    pauses_ms=st.lists(st.sampled_from([0, 0, 0, 1, 3, 30, 3000]), max_size=60),
    steps_ms=st.lists(st.integers(-20, 20), min_size=2, max_size=40),
    rate=st.sampled_from([1.0, 30.0, 100.0, 1000.0]),
)
def test_stamps_increase(pauses_ms: list[int], steps_ms: list[int], rate: float) -> None:
    """Whenever the thread is off the processor, and however the clock is adjusted."""
    machine, found = BusyMachine(), list[int]()
    machine.pause(pauses_ms)
    for step in steps_ms:
        found.append(machine.stamps.at(machine.now / NS_PER_S))
        machine.now += round(NS_PER_S / rate)
        machine.ahead += step * 1_000_000
    assert all(before < after for before, after in pairwise(found))


def test_stamps_return_to_a_clock_that_went_back_a_little() -> None:
    """At half speed: after 0.5 s back it takes a second."""
    machine = BusyMachine()
    start = machine.stamps.at(50.0)
    machine.ahead -= 500_000_000
    found = [machine.stamps.at(50.0 + 0.1 * cycle) - start for cycle in range(1, 13)]
    assert found[:3] == [50_000_000, 100_000_000, 150_000_000] and type(found[0]) is int
    assert found[-3:] == [500_000_000, 600_000_000, 700_000_000]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets threads choose")
def test_waits_of_one_thread_end_on_time() -> None:
    """The kernel then puts none of its timers off, and those of other threads as before."""
    slack = ctypes.CDLL(None).prctl
    asking = 30  # PR_GET_TIMERSLACK
    before = slack(asking)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(wake_exactly)
        assert pool.submit(slack, asking).result() == 1
        pool.submit(wake_exactly, False)
        assert pool.submit(slack, asking).result() == before
    assert slack(asking) == before > 1
