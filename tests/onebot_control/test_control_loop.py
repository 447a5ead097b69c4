"""The thread that runs the control cycles."""

import threading
import time
from itertools import pairwise
from typing import cast

import pytest

from onebot_control.controlled_robot import Snapshot
from onebot_control.fleet import Fleet
from onebot_control.physics.world import World
from onebot_control.runtime.control_loop import (
    ControlLoop,
    LoopSlot,
)
from onebot_control.runtime.pacing import Divider, PaceMeter
from onebot_description.errors import OneBotError
from onebot_description.timing.wake_detector import WakeDetector
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
        speeds = [snapshot.drive.command.linear for snapshot, _ in run.published]
        assert speeds[at] == (0.6 if simulated else 0.0)
        assert max(run.missed) >= 28  # cycles


@pytest.mark.parametrize("simulated", [False, True])
def test_a_command_ends_when_the_process_wakes(simulated: bool) -> None:
    """Also one without a timeout, in simulated time and in a suspended computer's, which jumps."""
    with Run(simulated=simulated, cmd_vel_timeout=0.0) as run:
        run.loop.call(lambda: run.drive.accept(0.6, 0.0))
        wait_for(lambda: run.published[-1][0].drive.command.linear == 0.6, "the robot to drive")
        run.now += 3600.0
        wait_for(
            lambda: run.published[-1][0].drive.command.wheels == (0.0, 0.0), "the robot to stop"
        )
        run.loop.call(lambda: run.drive.accept(0.5, 0.0))
        count = len(run.published)
        wait_for(lambda: len(run.published) > count + 20, "cycles")
        assert run.published[-1][0].drive.command.linear == 0.5


def test_a_command_ages_while_paused_on_the_systems_time() -> None:
    with Run(cmd_vel_timeout=0.2) as run:
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        run.loop.call(lambda: run.drive.accept(0.6, 0.0))
        count = len(run.published)
        wait_for(lambda: len(run.published) > count + 30, "0.3 s of pause")
        at = run.loop.call(lambda: setattr(run.loop, "paused", False) or len(run.published))
        wait_for(lambda: len(run.published) > at, "a cycle")
        assert run.published[at][0].drive.command.linear == 0.0


def test_paused_on_the_systems_time_it_publishes_the_standing_robot() -> None:
    """With stamps of now, and 10 ms apart, however fast it would be."""
    with Run(factor=0.0, cmd_vel_timeout=0.0) as run:
        run.loop.call(lambda: run.drive.accept(0.6, 0.2))
        wait_for(lambda: run.published[-1][0].drive.twist.linear > 0.1, "the robot to drive")
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        count, ticks = len(run.published), run.loop.fleet.ticks
        wait_for(lambda: len(run.published) > count + 15, "messages while paused")
        assert run.loop.fleet.ticks == ticks
        assert run.published[-1][0].drive.twist == (0.0, 0.0, 0.0)
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


@pytest.mark.parametrize(("rate", "one_in"), [(500, 1), (100, 1), (100 / 3, 3), (100 / 30, 30)])
def test_divider_picks_every_so_many(rate: float, one_in: int) -> None:
    """The first and then each at the same distance, in spite of rounding; all where it is more."""
    divider = Divider(rate, 100.0)
    picked = [cycle for cycle in range(3000) if divider.due()]
    assert picked == list(range(0, 3000, one_in))
