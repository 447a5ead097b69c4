"""Studies: what they cost over bare processes, on processes and on Ray; environments in parallel.

An episode is about a second of one processor: a drive in the maze, by a Simulation that is kept.
"""

import subprocess
import sys
import time

import gymnasium
import numpy as np
import psutil
import pyarrow as pa
import ray

from onebot_control import Simulation
from onebot_control.evaluation import Case, evaluate, grid
from tests.benchmarks.measuring import WrongAnswer, in_turn, over
from tests.benchmarks.report import Report, Result

_WORKERS = 2
_BARE = """
import sys
from tests.benchmarks.evaluation import drive
for seed in range(int(sys.argv[1])):
    x = drive({"seed": seed, "seconds": float(sys.argv[2])})["x"]
print(x)
"""
_kept: dict[str, Simulation] = {}  # of this process


def drive(case: Case) -> dict[str, float]:
    """Drive for some seconds; return where it ends, and when it began and ended."""
    began = time.monotonic()
    if "maze" not in _kept:
        _kept["maze"] = Simulation(world="maze", y=0.8, sensors=True)
    simulation = _kept["maze"]
    simulation.reset(case["seed"])
    simulation.robot.drive(0.2)
    simulation.run(case["seconds"])
    return {"x": simulation.robot.pose.x, "began": began, "ended": time.monotonic()}


def run(quick: bool) -> Report:
    """Measure.

    Raises:
        WrongAnswer: an episode ended elsewhere than in a bare process.
    """
    seeds, seconds = (4, 0.2) if quick else (40, _simulated_second())
    # Its start is no part of a study's time.
    with ray.init("local", num_cpus=_WORKERS, include_dashboard=False, log_to_driver=False):
        taken = in_turn(
            {
                "bare": lambda: _bare(_WORKERS, seeds // _WORKERS, seconds),
                "processes": lambda: _study("processes", seeds, seconds),
                "ray": lambda: _study("ray", seeds, seconds),
            },
            1 if quick else 3,
        )
    return [
        Result(
            "2 workers: two bare processes' time of the whole",
            over(taken["bare"], taken["processes"]),
            at_least=0.9,
        ),
        Result(
            "Ray here: processes' time of it", over(taken["processes"], taken["ray"]), at_least=0.85
        ),
        Result(
            "what a study adds to an episode of 1 s, of it",
            _overhead(evaluate(drive, _cases(seeds // 2, seconds), 1)),
            at_most=0.05,
        ),
        Result(
            "memory of parent and workers, after 10,000 episodes over after 500",
            _memory_growth(*((20, 30) if quick else (500, 10_000))),
            at_most=1.05,
        ),
        Result("OneBot-Maze-v0, 2 in processes: steps a second", _steps(10 if quick else 300)),
    ]


def _cases(seeds: int, seconds: float) -> list[Case]:
    return grid(seed=range(seeds), seconds=seconds)


def _simulated_second() -> float:
    """Return how many seconds of the drive take a second."""
    drive(Case(seed=0, seconds=0.1))
    row = drive(Case(seed=0, seconds=1.0))
    _kept.clear()
    return round(1.0 / (row["ended"] - row["began"]), 1)


def _bare(processes: int, seeds: int, seconds: float) -> float:
    """Return the time of processes side by side, s, each with its share of the episodes."""
    command = [sys.executable, "-c", _BARE, str(seeds), str(seconds)]
    began = time.monotonic()
    running = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(processes)]
    ends = {float(process.communicate()[0]) for process in running}
    if len(ends) != 1:
        raise WrongAnswer(f"bare processes end at {ends}")
    return time.monotonic() - began


def _study(on: str, seeds: int, seconds: float) -> float:
    began = time.monotonic()
    table = evaluate(drive, _cases(seeds, seconds), None if on == "ray" else _WORKERS, on=on)
    taken = time.monotonic() - began
    if table["error"].null_count != seeds or len(set(table["x"].to_pylist())) != 1:
        raise WrongAnswer(f"on {on}: {table.to_pylist()}")
    return taken


def _overhead(table: pa.Table) -> float:
    """Return the share of the time that one worker is between episodes."""
    began, ended = (np.array(table[name]) for name in ("began", "ended"))
    return float(1.0 - (ended - began)[1:].sum() / (ended[-1] - ended[0]))


def _memory_growth(early: int, late: int) -> float:
    """Return the memory of this process and its workers late in a study over that early in it."""
    table = evaluate(short, grid(number=range(late)), _WORKERS)
    memory = np.array(table["parent"]) + _WORKERS * np.array(table["worker"])
    return float(memory[-10:].mean() / memory[early - 10 : early].mean())


def short(case: Case) -> dict[str, float]:
    """Drive for a few cycles on bare ground; return the memory of this worker and its parent."""
    if "bare" not in _kept:
        _kept["bare"] = Simulation()
    _kept["bare"].reset(case["number"])
    _kept["bare"].step(2)
    worker = psutil.Process()
    parent = worker.parent()
    assert parent is not None
    return {"worker": worker.memory_info().rss, "parent": parent.memory_info().rss}


def _steps(count: int) -> float:
    """Return the steps a second of two environments in processes of their own."""
    name = "onebot_control.environment:OneBot-Maze-v0"
    environments = gymnasium.make_vec(name, num_envs=2, vectorization_mode="async", y=0.8)
    environments.reset(seed=1)
    actions = np.array([[0.1, 0.0], [0.1, 0.0]], np.float32)
    began = time.monotonic()
    for _ in range(count):
        observations, *_ = environments.step(actions)
    taken = time.monotonic() - began
    environments.close()
    if observations["scan"].shape != (2, 360):
        raise WrongAnswer(f"scans of {observations['scan'].shape}")
    return 2 * count / taken
