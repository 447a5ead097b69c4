"""Studies: what they cost over a bare loop, on processes and on Ray, and environments in parallel.

An episode is about a second of one processor: a drive in the maze, whose Simulation is kept.
"""

import subprocess
import sys
import time
from importlib.util import find_spec
from typing import Any

from onebot_control.evaluation import Case
from tests.benchmarks.measuring import WrongAnswer, in_turn, over
from tests.benchmarks.report import Report, Result

_WORKERS = 2
_DRIVE = """
import sys, time
from onebot_control import Simulation
simulation = Simulation(world="maze", y=0.8, sensors=True)
def episode(seed, seconds):
    simulation.reset(seed)
    simulation.robot.drive(0.3)
    simulation.run(seconds)
    return simulation.robot.pose.x
seeds, seconds = int(sys.argv[1]), float(sys.argv[2])
episode(0, 0.1)
print("ready", flush=True)
sys.stdin.readline()
for seed in range(seeds):
    x = episode(seed, seconds)
print(x)
"""
_kept: dict[str, Any] = {}


def episode(case: Case) -> dict[str, float]:
    """Drive for some seconds; the simulation is the worker's."""
    from onebot_control import Simulation

    simulation = _kept.setdefault("maze", None) or Simulation(world="maze", y=0.8, sensors=True)
    _kept["maze"] = simulation
    simulation.reset(case["seed"])
    simulation.robot.drive(0.3)
    simulation.run(case["seconds"])
    return {"x": simulation.robot.pose.x, "wall": time.time()}


def run(quick: bool) -> Report:
    """Measure.

    Raises:
        WrongAnswer: an episode ended elsewhere than in a bare process.
    """
    seeds, seconds = (4, 0.5) if quick else (16, 20.0)
    expected = _bare(1, 1, seconds)[1]
    variants = {
        "bare": lambda: _bare(_WORKERS, seeds // _WORKERS, seconds)[0],
        "processes": lambda: _study("processes", seeds, seconds, expected),
    }
    has_ray = find_spec("ray") is not None
    if has_ray:
        variants["ray"] = lambda: _study("ray", seeds, seconds, expected)
    taken = in_turn(variants, 1 if quick else 3)
    flat = _memory(100 if quick else 2000)
    steps = _steps(10 if quick else 300)
    results = [
        Result(
            "2 workers over two bare processes", over(taken["bare"], taken["processes"]), 1e9, 0.9
        ),
        Result("memory of parent and workers, after over before", flat, 1.1),
        Result("OneBot-Maze-v0, 2 environments in processes: steps/s", steps),
    ]
    if has_ray:
        ratio = over(taken["processes"], taken["ray"])
        results.insert(1, Result("Ray over processes", ratio, at_least=0.85))
    return results


def _bare(processes: int, seeds: int, seconds: float) -> tuple[float, float]:
    """Return what processes without evaluate take from when all are ready, s, and where they end."""
    command = [sys.executable, "-c", _DRIVE, str(seeds), str(seconds)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    running = [subprocess.Popen(command, **pipes) for _ in range(processes)]
    for process in running:
        process.stdout.readline()
    began = time.perf_counter()
    for process in running:
        process.stdin.write("\n")
        process.stdin.flush()
    ends = {float(process.communicate()[0]) for process in running}
    taken = time.perf_counter() - began
    if len(ends) != 1:
        raise WrongAnswer(f"processes end at {ends}")
    return taken, ends.pop()
