"""Simulation from Python, in simulated seconds a second of processor time: its floor is real time.

Goals of speed are of the computer whose bare step of OneBot is in ``measuring``; they are scaled by
what that step takes here. Where a robot ends up is checked against its odometry, and that nothing
of it is lost.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any, NamedTuple

from onebot_control import SimulatedRobot, Simulation
from onebot_control.environment import OneBotEnv
from tests.benchmarks.measuring import (
    BARE_STEP,
    WrongAnswer,
    bare_step,
    fastest,
    in_turn,
    over,
)
from tests.benchmarks.report import Report, Result

_LINEAR = 0.3  # m/s, forward and back
_PERIOD = 0.1  # s between measurements
_SLEEP = 2.5  # s until crates that nothing pushes sleep
_FARTHEST = 0.02  # m between odometry and truth
_START, _RESET = 500.0, 20.0  # ms at most
_FIRST_SCAN = 50.0  # ms at most, of a process that has not imported what reads meshes
_ENVIRONMENT = 600.0  # steps a second at least
_FIRST = """
import time
from onebot_control import Simulation
with Simulation(world="maze", sensors=True) as simulation:
    began = time.thread_time()
    ranges = simulation.robot.scan().ranges
    print(time.thread_time() - began, len(ranges))
"""


class Case(NamedTuple):
    """A simulation, and what is measured in it at 10 Hz."""

    what: str
    goal: float  # times real time
    arguments: dict[str, Any]
    measure: Callable[[SimulatedRobot], object] = lambda robot: None


def _look(robot: SimulatedRobot) -> None:
    robot.image()
    robot.depth()


_MAZE = {"world": "maze"}
_SENSED = {**_MAZE, "sensors": True}
CASES = (
    Case("bare ground", 50.0, {}),
    Case("maze", 30.0, _MAZE),
    Case("maze, contacts at 10 Hz", 25.0, _MAZE, lambda robot: robot.contacts),
    Case("maze, 360 ranges at 10 Hz", 20.0, _SENSED, lambda robot: robot.scan()),
    Case("maze, picture and depth at 10 Hz", 10.0, _SENSED, _look),
)


def run(quick: bool) -> Report:
    """Measure how fast simulations are, and how soon they start."""
    seconds, rounds = (0.5, 1) if quick else (2.0, 20)
    with ExitStack() as stack:
        simulations = [stack.enter_context(Simulation(**case.arguments)) for case in CASES]
        variants = {
            case.what: lambda s=simulation, c=case: _drive(s, c, seconds)
            for case, simulation in zip(CASES, simulations, strict=True)
        }
        variants["bare"] = lambda: bare_step(simulations[0])
        taken = in_turn(variants, rounds)
        bare_steps = simulations[0]._core.fleet.world.settings.steps(1.0)
    step = fastest(taken.pop("bare"))
    paces = {what: 1.0 / fastest(each) for what, each in taken.items()}
    scale = BARE_STEP / step
    with closing(OneBotEnv(world="maze")) as environment:
        variants = {
            **{"start": _start, "reset": _reset, "first scan": _first_scan},
            "environment": lambda: _environment_step(environment, 2 if quick else 50),
            "bare": lambda: bare_step(environment.simulation),
        }
        taken = in_turn(variants, 1 if quick else 9)
    of_a_step = over(taken["environment"], taken["bare"])
    return [
        Result("bare stepSimulation, bare ground: times real time", 1.0 / (bare_steps * step)),
        *(
            Result(
                f"OneBot, {case.what}: times real time",
                paces[case.what],
                at_least=round(case.goal * scale, 1),
            )
            for case in CASES
        ),
        Result("maze, lidar: start", 1e3 * fastest(taken["start"]), _START, unit="ms"),
        Result("maze, lidar: reset", 1e3 * fastest(taken["reset"]), _RESET, unit="ms"),
        Result(
            "maze, lidar: first scan of a process",
            1e3 * fastest(taken["first scan"]),
            _FIRST_SCAN,
            unit="ms",
        ),
        Result(
            "OneBotEnv, maze, 360 ranges: steps a second",
            1.0 / fastest(taken["environment"]),
            at_least=_ENVIRONMENT,
        ),
        Result("OneBotEnv, maze, 360 ranges: a step over a bare stepSimulation", of_a_step),
    ]


def _drive(simulation: Simulation, case: Case, seconds: float) -> float:
    """Drive forward and back from the start; return a simulated second's processor time."""
    simulation.reset()
    simulation.run(_SLEEP)
    robot = simulation.robot

    taken = []
    for period in range(round(seconds / _PERIOD)):
        began = time.thread_time()
        robot.drive(_LINEAR if period % 20 < 10 else -_LINEAR)
        simulation.run(_PERIOD)
        case.measure(robot)
        taken.append(time.thread_time() - began)
    off = robot.odometry.x - robot.pose.x
    if not (abs(off) < _FARTHEST and robot.joints["left_wheel_joint"].position != 0.0):
        raise WrongAnswer(f"after {seconds:g} s {robot}, by its odometry {robot.odometry}")
    return fastest(taken) / _PERIOD


def _start() -> float:
    began = time.thread_time()
    with Simulation(**_SENSED) as simulation:
        simulation.robot.scan()
        return time.thread_time() - began


def _first_scan() -> float:
    command = [sys.executable, "-c", _FIRST]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, ranges = run.stdout.split()
    if ranges != "360":
        raise WrongAnswer(f"a scan of {ranges} ranges")
    return float(seconds)


def _environment_step(environment: OneBotEnv, steps: int) -> float:
    """Return what a step of an episode with random actions takes, s, as the mean of some."""
    environment.reset(seed=1)
    environment.action_space.seed(1)
    actions = [environment.action_space.sample() for _ in range(steps)]
    began = time.thread_time()
    for action in actions:
        observation, *_ = environment.step(action)
    taken = time.thread_time() - began
    if observation["scan"].shape != (360,) or not environment.simulation.robot.twist.linear:
        raise WrongAnswer(f"{environment.simulation} after {steps} steps")
    return taken / steps


def _reset() -> float:
    with Simulation(**_SENSED) as simulation:
        simulation.run(0.1)
        began = time.thread_time()
        simulation.reset()
        return time.thread_time() - began
