"""The thread that runs the control cycles, its deadlines and its stamps."""

import ctypes
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_control.controlled_robot import Snapshot
from onebot_control.fleet import Divider, Fleet
from onebot_control.nodes.control_loop import (
    ControlLoop,
    LoopSlot,
    Pacer,
    SystemStamps,
    wake_exactly,
)
from onebot_control.nodes.real_time import PaceMeter
from onebot_control.physics import World
from onebot_description.errors import OneBotError
from onebot_description.ros.message_age import WakeDetector
from onebot_description.ros.wire.cdr import NS_PER_S
from tests.onebot_control.control_support import IdealPlant, IdealWorld, ideal_drive
from tests.support import PATIENCE, wait_for


class RecordingMeter(PaceMeter):
    """Keeps how many cycles were left out, where any were."""

    def __init__(self, missed: list[int]) -> None:
        super().__init__()
        self._found = missed

    def cycle(self, due: float, simulated: float, missed: int) -> None:
        self._found += [missed] if missed else []
        super().cycle(due, simulated, missed)


class Run:
    """A loop over an ideal plant, with what it published; a context that starts and stops it."""

    def __init__(self, *, simulated: bool = False, factor: float = 1.0, **values: float) -> None:
        self.plant = IdealPlant()
        self.drive = ideal_drive(self.plant, real_time_factor=factor, **values)
        self.missed: list[int] = []
        self.published: list[tuple[Snapshot, int]] = []
        self.failures: list[BaseException] = []
        self.meter = RecordingMeter(self.missed)
        self.now = 0.0  # of the clock by which a stop is noticed
        self.loop = ControlLoop(
            Fleet([self.drive], cast(World, IdealWorld([self.plant]))),
            lambda snapshots, stamp: self.published.append((snapshots[0], stamp)),
            simulated=simulated,
            meter=self.meter,
            failed=self.failures.append,
            wake=WakeDetector(lambda: self.now),
        )

    def __enter__(self) -> "Run":
        self.loop.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.loop.stop()
        assert self.plant.closed


def test_a_step_waits_as_long_as_any_robot_asks_for() -> None:
    drives = [ideal_drive(step_timeout=timeout) for timeout in (0.001, 0.02, 0.01)]
    plants = IdealWorld([cast(IdealPlant, drive.body) for drive in drives])
    loop = ControlLoop(
        Fleet(drives, cast(World, plants)), lambda *_: None, missing=lambda: "no command came"
    )
    loop.paused = True
    began = time.monotonic()
    with pytest.raises(OneBotError, match=r"no command came within 0\.02 s \(step_timeout\)"):
        loop.step()
    assert time.monotonic() - began >= 0.02


def test_one_thread_alone_touches_the_robot() -> None:
    """Jobs run in the control thread, and a mistake in one reaches who asked for it."""
    with Run() as run:
        assert run.loop.call(threading.get_ident) != threading.get_ident()

        def wrong() -> None:
            raise OneBotError("no")

        with pytest.raises(OneBotError, match="no"):
            run.loop.call(wrong)
        assert run.loop.call(lambda: 1) == 1
        slot = LoopSlot(0)
        with pytest.raises(OneBotError, match="there is no robot yet"):
            slot.running  # noqa: B018
        slot.loop = run.loop
        assert slot.robot is run.drive


def test_paused_simulated_time_publishes_nothing_but_steps() -> None:
    with Run(simulated=True, factor=0.0) as run:
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        count = len(run.published)
        for _ in range(5):
            run.loop.call(lambda: None)
        assert len(run.published) == count
        before = run.loop.now_ns()
        run.loop.call(run.loop.step)
        assert len(run.published) == count + 1
        assert run.published[-1][1] == before
        assert run.loop.now_ns() == before + 10_000_000
        with pytest.raises(OneBotError, match="resumed after 1 of 3 cycles"):
            run.loop.call(lambda: (run.loop.post(lambda: run.loop.pause(False)), run.loop.step(3)))
        with pytest.raises(OneBotError, match="pause it first"):
            run.loop.call(run.loop.step)
        wait_for(lambda: len(run.published) > count + 5, "cycles after the pause")
    stamps = [stamp for _, stamp in run.published]
    assert stamps == [10_000_000 * (cycle + 1) for cycle in range(len(stamps))]


def test_simulated_stamps_are_of_the_update_rate() -> None:
    """At 30 Hz they are rounded, but do not drift."""
    with Run(simulated=True, factor=0.0, update_rate=30) as run:
        wait_for(lambda: len(run.published) > 30, "a second")
    assert [stamp for _, stamp in run.published[:4]] == [33333333, 66666667, 100000000, 133333333]
    assert run.published[29][1] == 1_000_000_000


def spin(seconds: float) -> None:
    """Let nothing else happen in this thread."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        pass


@pytest.mark.parametrize("simulated", [False, True])
def test_a_command_ages_by_the_clock_in_force(simulated: bool) -> None:
    """A stall longer than the timeout ends it, unless simulated time stood still meanwhile."""
    with Run(simulated=simulated, cmd_vel_timeout=0.2) as run:

        def stall() -> int:
            run.drive.accept(0.6, 0.0, 0.0)
            spin(0.3)
            return len(run.published)

        at = run.loop.call(stall) + 1  # the cycle of the stall is under way
        wait_for(lambda: len(run.published) > at + 1, "cycles after the stall")
        speeds = [snapshot.command.linear for snapshot, _ in run.published]
        assert speeds[at] == (0.6 if simulated else 0.0)
        assert max(run.missed) >= 28  # cycles


@pytest.mark.parametrize("simulated", [False, True])
def test_a_command_ends_when_the_process_wakes(simulated: bool) -> None:
    """Also one without a timeout, in simulated time and in a suspended computer's, which jumps."""
    with Run(simulated=simulated, cmd_vel_timeout=0.0) as run:
        run.loop.call(lambda: run.drive.accept(0.6, 0.0))
        wait_for(lambda: run.published[-1][0].command.linear == 0.6, "the robot to drive")
        run.now += 3600.0
        wait_for(lambda: run.published[-1][0].command[:2] == (0.0, 0.0), "the robot to stop")
        run.loop.call(lambda: run.drive.accept(0.5, 0.0))
        count = len(run.published)
        wait_for(lambda: len(run.published) > count + 20, "cycles")
        assert run.published[-1][0].command.linear == 0.5


def test_a_command_ages_while_paused_on_the_systems_time() -> None:
    with Run(cmd_vel_timeout=0.2) as run:
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        run.loop.call(lambda: run.drive.accept(0.6, 0.0))
        count = len(run.published)
        wait_for(lambda: len(run.published) > count + 30, "0.3 s of pause")
        at = run.loop.call(lambda: setattr(run.loop, "paused", False) or len(run.published))
        wait_for(lambda: len(run.published) > at, "a cycle")
        assert run.published[at][0].command.linear == 0.0


def test_paused_on_the_systems_time_it_publishes_the_standing_robot() -> None:
    """With stamps of now, and 10 ms apart, however fast it would be."""
    with Run(factor=0.0, cmd_vel_timeout=0.0) as run:
        run.loop.call(lambda: run.drive.accept(0.6, 0.2))
        wait_for(lambda: run.published[-1][0].twist[0] > 0.1, "the robot to drive")
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        count, ticks = len(run.published), run.loop.fleet.ticks
        wait_for(lambda: len(run.published) > count + 15, "messages while paused")
        assert run.loop.fleet.ticks == ticks
        assert run.published[-1][0].twist == (0.0, 0.0)
        assert not any(run.published[-1][0].joint_states.velocities)
    stamps = [stamp for _, stamp in run.published[count:]]
    # The first may have been under way as it was paused.
    assert all(after - before > 9_000_000 for before, after in pairwise(stamps[1:]))


def test_a_job_that_fails_ends_the_loop_and_who_waits_for_it_is_told() -> None:
    """An error that is no OneBotError is a fault of ours, which is not kept quiet."""
    with Run() as run:
        with pytest.raises(OneBotError, match="the control loop has failed"):
            run.loop.call(lambda: 1 // 0)
        wait_for(lambda: run.failures, "the failure")
    assert isinstance(run.failures[0], ZeroDivisionError)


def test_stop_is_no_failure_and_may_come_twice() -> None:
    """It ends a loop that waits for its next cycle at once, and not in 1000 s."""
    run = Run(update_rate=0.001)
    with run:
        wait_for(lambda: run.published, "the first cycle")
        began = time.monotonic()
        run.loop.stop()
        assert time.monotonic() - began < PATIENCE
    assert len(run.published) == 1
    assert run.failures == run.missed == []


@pytest.mark.parametrize(("simulated", "slow"), [(True, 1e-5), (True, 1e-320), (False, 1.0)])
def test_calls_do_not_wait_for_a_cycle_far_ahead(simulated: bool, slow: float) -> None:
    """And where the pace was raised, neither does the cycle; a call knows how far ahead it is."""
    rate = 100.0 if simulated else 0.001
    with Run(simulated=simulated, factor=slow, update_rate=rate) as run:
        wait_for(lambda: run.published, "the first cycle")
        began = time.monotonic()
        assert run.loop.call(lambda: run.loop.left) > 500.0
        assert len(run.published) == 1
        for factor in (1e3, 0.0):
            run.loop.call(lambda factor=factor: run.loop.set_factor(factor))  # type: ignore[misc]
            count = len(run.published)
            wait_for(lambda: len(run.published) > count + 1, "cycles")  # noqa: B023
            assert run.meter.wanted == factor
        assert time.monotonic() - began < PATIENCE
    assert run.failures == []


def test_a_pause_puts_off_no_cycle_of_slow_time() -> None:
    """However long it is, the next cycle is due within a period, which is 0.2 s here."""
    with Run(simulated=True, factor=0.05) as run:
        run.loop.call(lambda: run.loop.pause(True))
        spin(0.5)
        assert run.loop.call(lambda: run.loop.left) <= 0.2


# Deadlines and stamps -----------------------------------------------------------------------


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


@pytest.mark.parametrize(("rate", "one_in"), [(500, 1), (100, 1), (100 / 3, 3), (100 / 30, 30)])
def test_divider_picks_every_so_many(rate: float, one_in: int) -> None:
    """The first and then each at the same distance, in spite of rounding; all where it is more."""
    divider = Divider(rate, 100.0)
    picked = [cycle for cycle in range(3000) if divider.due()]
    assert picked == list(range(0, 3000, one_in))


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lets threads choose")
def test_waits_of_one_thread_end_on_time() -> None:
    """The kernel then puts none of its timers off, and those of other threads as before."""
    slack = ctypes.CDLL(None).prctl
    asking = 30  # PR_GET_TIMERSLACK
    before = slack(asking)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(wake_exactly)
        assert pool.submit(slack, asking).result() == 1
    assert slack(asking) == before > 1
