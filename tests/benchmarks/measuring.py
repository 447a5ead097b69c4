"""What the benchmarks measure with: processes, their processor time and memory, runs in turn."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import Twist
from numpy.typing import ArrayLike

from onebot_control import Simulation
from onebot_control.physics.engine import engine
from onebot_description.errors import OneBotError
from onebot_description.ros.domains import used_domain
from tests.ros_support import NodeProcess

T = TypeVar("T")
MODEL = "package://onebot_description/urdf/onebot.urdf.xacro"
# s that a bare ``stepSimulation`` of OneBot on bare ground takes on the computer of the goals.
BARE_STEP = 69e-6


class WrongAnswer(OneBotError):
    """What was measured gave a wrong answer, so its speed is of no interest."""


@contextmanager
def bringup(*words: str) -> Iterator[tuple[int, NodeProcess]]:
    """``onebot_bringup`` in a ROS domain of its own; yields the domain and the process."""
    with used_domain() as domain, pytest.MonkeyPatch.context() as patch:
        for display in ("DISPLAY", "WAYLAND_DISPLAY"):
            patch.delenv(display, raising=False)  # the page is served, but no browser opens it
        with NodeProcess("onebot_bringup.launch.onebot_bringup", *words) as process:
            yield domain, process


def command(publishers: Sequence[Any], speed: float, seconds: float) -> None:
    """Command robots to drive ahead for so long, each ten times a second, as many users would."""
    message = Twist()
    message.linear.x = speed
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for publisher in publishers:
            publisher.publish(message)
            time.sleep(0.1 / len(publishers))


def _tree(pid: int) -> list[psutil.Process]:
    """A process and all that it has started."""
    process = psutil.Process(pid)
    return [process, *process.children(recursive=True)]


def cpu_ns(pid: int) -> int:
    """Processor time of a process and all that it has started, of their running threads, ns.

    The scheduler's own count (/proc/PID/task/TID/schedstat), which the kernel brings up to date at
    least at every tick: measure over a second rather than over milliseconds.
    """
    total = 0
    for process in _tree(pid):
        for task in Path(f"/proc/{process.pid}/task").iterdir():
            try:
                total += int((task / "schedstat").read_text().split()[0])
            except FileNotFoundError:
                continue  # a thread that has just ended
    return total


def rss_mb(pid: int) -> float:
    """Resident memory of a process and all that it has started; what they share counts for each."""
    return sum(process.memory_info().rss for process in _tree(pid)) / 1e6


def percentile(values: ArrayLike, percent: float) -> float:
    """Return the value that ``percent`` of ``values`` do not exceed."""
    return float(np.percentile(np.asarray(values, float), percent))


def median(values: ArrayLike) -> float:
    """Return the middle one of ``values``."""
    return percentile(values, 50.0)


def fastest(seconds: Sequence[float]) -> float:
    """Return the least of ``seconds``: what else a computer does only ever adds to our own."""
    return min(seconds)


def over(ours: Sequence[float], floor: Sequence[float]) -> float:
    """Return the middle one of the ratios of each round."""
    return median([a / b for a, b in zip(ours, floor, strict=True)])


def cpu_of(function: Callable[[], object], seconds: float) -> float:
    """Return this thread's processor time for a call, s, as the mean over at least ``seconds``."""
    function()
    calls, began = 0, time.thread_time()
    while not calls or time.thread_time() - began < seconds:
        function()
        calls += 1
    return (time.thread_time() - began) / calls


def bare_step(
    simulation: Simulation, clock: Callable[[], float] = time.thread_time, steps: int = 100
) -> float:
    """Return what a bare ``stepSimulation`` of a world takes, s, as the mean of some."""
    client = simulation._core.fleet.world.bullet.client
    began = clock()
    for _ in range(steps):
        engine.stepSimulation(client)
    return (clock() - began) / steps


def in_turn(variants: Mapping[str, Callable[[], T]], rounds: int) -> dict[str, list[T]]:
    """Run all variants in turn, so that noise hits them alike; return each round's results.

    Every other round goes backwards, so that none is always measured after the same one.
    """
    results: dict[str, list[T]] = {name: [] for name in variants}
    for number in range(rounds):
        names = list(variants)
        for name in reversed(names) if number % 2 else names:
            results[name].append(variants[name]())
    return results
