"""The thread that runs the control cycles."""

import threading

import pytest

from onebot_control.control_loop import ControlLoop
from onebot_control.driven_robot import Snapshot
from onebot_description.errors import OneBotError
from tests.onebot_control.control_support import IdealPlant, ideal_drive
from tests.support import wait_for


class Run:
    """A loop over an ideal plant, with what it published; a context that starts and stops it."""

    def __init__(self, *, simulated: bool = False, factor: float = 1.0) -> None:
        self.plant = IdealPlant()
        self.published: list[tuple[Snapshot, int]] = []
        self.failures: list[BaseException] = []
        self.loop = ControlLoop(
            ideal_drive(self.plant, real_time_factor=factor),
            lambda snapshot, stamp: self.published.append((snapshot, stamp)),
            simulated=simulated,
            failed=self.failures.append,
        )

    def __enter__(self) -> "Run":
        self.loop.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.loop.stop()
        assert self.plant.closed


def test_simulated_stamps_count_cycles() -> None:
    """Stamps are one period apart from the first on, and never 0."""
    with Run(simulated=True, factor=0.0) as run:
        wait_for(lambda: len(run.published) > 100, "100 cycles")
    stamps = [stamp for _, stamp in run.published[:100]]
    assert stamps == [10_000_000 * (cycle + 1) for cycle in range(100)]


def test_as_fast_as_possible_still_answers() -> None:
    """At a factor of 0 jobs are done between cycles."""
    with Run(simulated=True, factor=0.0) as run:
        for _ in range(20):
            assert run.loop.call(lambda: run.loop.robot.ticks) >= 0


def test_pause_and_step() -> None:
    """Paused, the robot's time stands still; each step is one cycle."""
    with Run(simulated=True) as run:
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        ticks = run.loop.call(lambda: run.loop.robot.ticks)
        run.loop.call(run.loop.step)
        run.loop.call(run.loop.step)
        assert run.loop.call(lambda: run.loop.robot.ticks) == ticks + 2
        run.loop.call(lambda: setattr(run.loop, "paused", False))
        with pytest.raises(OneBotError, match="pause it first"):
            run.loop.call(run.loop.step)


def test_paused_on_the_systems_time_keeps_publishing() -> None:
    """Listeners get the standing robot with stamps of now."""
    with Run() as run:
        run.loop.call(lambda: setattr(run.loop, "paused", True))
        count, ticks = len(run.published), run.loop.robot.ticks
        wait_for(lambda: len(run.published) > count + 5, "messages while paused")
        assert run.loop.robot.ticks == ticks
        stamps = [stamp for _, stamp in run.published]
        assert stamps == sorted(set(stamps))


def test_one_thread_alone_touches_the_robot() -> None:
    """Jobs run in the control thread, and a mistake in one reaches who asked for it."""
    with Run() as run:
        assert run.loop.call(threading.get_ident) != threading.get_ident()

        def wrong() -> None:
            raise OneBotError("no")

        with pytest.raises(OneBotError, match="no"):
            run.loop.call(wrong)
        assert run.loop.call(lambda: 1) == 1


def test_what_ends_the_loop_is_reported() -> None:
    """An error that nobody waits for ends the loop, closes the simulation, and is handed on."""
    with Run() as run:
        run.loop.post(lambda: 1 // 0)
        wait_for(lambda: run.failures, "the failure")
    assert isinstance(run.failures[0], ZeroDivisionError)
