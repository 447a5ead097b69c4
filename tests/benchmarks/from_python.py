"""Simulation from Python, in simulated seconds a second of processor time: its floor is real time.

Where a robot ends up is checked against its odometry, and that nothing of it is lost.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from onebot_control import SimulatedRobot, Simulation
from tests.benchmarks.measuring import WrongAnswer, in_turn, median
from tests.benchmarks.report import Report, Result

_LINEAR = 0.3  # m/s, forward and back
_PERIOD = 0.1  # s between measurements
_FARTHEST = 0.02  # m between odometry and truth


class Case(NamedTuple):
    """A simulation, and what is measured in it at 10 Hz."""

    what: str
    arguments: dict[str, Any]
    measure: Callable[[SimulatedRobot], object] = lambda robot: None


_MAZE = {"world": "maze"}
_SENSED = {**_MAZE, "sensors": True}
CASES = (
    Case("bare ground", {}),
    Case("maze", _MAZE),
    Case("maze, 360 ranges at 10 Hz", _SENSED, lambda robot: robot.scan()),
    Case("maze, picture and depth at 10 Hz", _SENSED, lambda robot: (robot.image(), robot.depth())),
)


def run(quick: bool) -> Report:
    """Measure how fast simulations are, and how soon they start."""
    seconds, rounds = (0.5, 1) if quick else (5.0, 5)
    results = []
    for case in CASES:
        with Simulation(**case.arguments) as simulation:
            taken = in_turn({"ours": lambda s=simulation, c=case: _drive(s, c, seconds)}, rounds)
        results.append(Result(f"OneBot, {case.what}: times real time", 1.0 / median(taken["ours"])))
    taken = in_turn({"start": _start, "reset": _reset}, 1 if quick else 9)
    return [
        *results,
        Result("maze, lidar: start", 1e3 * median(taken["start"]), unit="ms"),
        Result("maze, lidar: reset", 1e3 * median(taken["reset"]), unit="ms"),
    ]


def _drive(simulation: Simulation, case: Case, seconds: float) -> float:
    """Drive forward and back from the start; return the processor time of a simulated second."""
    simulation.reset()
    robot = simulation.robot
    began = time.thread_time()
    for step in range(round(seconds / _PERIOD)):
        robot.drive(_LINEAR if step % 20 < 10 else -_LINEAR)
        simulation.run(_PERIOD)
        case.measure(robot)
    taken = time.thread_time() - began
    off = robot.odometry.x - robot.pose.x
    if not (abs(off) < _FARTHEST and robot.joints["left_wheel_joint"].position != 0.0):
        raise WrongAnswer(f"after {seconds:g} s {robot}, by its odometry {robot.odometry}")
    return taken / seconds


def _start() -> float:
    began = time.thread_time()
    with Simulation(**_SENSED) as simulation:
        simulation.robot.scan()
        return time.thread_time() - began


def _reset() -> float:
    with Simulation(**_SENSED) as simulation:
        simulation.run(0.1)
        began = time.thread_time()
        simulation.reset()
        return time.thread_time() - began
