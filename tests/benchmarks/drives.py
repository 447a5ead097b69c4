"""Control cycles of other drives over those of OneBot, in the same run, while all drive circles.

Cycles of all robots take turns, on the processor time of the thread. In the end each robot has to
be where its odometry says.
"""

import math
from collections.abc import Callable

from onebot_control import Simulation
from tests.benchmarks.measuring import WrongAnswer, cpu_of, in_turn, over
from tests.benchmarks.report import Report, Result
from tests.onebot_control.drive_models import car, mecanum, omni

_DRIVES = {"mecanum": mecanum(), "omni wheels": omni(), "car": car()}
_MOST = {"mecanum": 1.5, "omni wheels": 1.5}
_LINEAR, _ANGULAR = 0.3, 0.2  # m/s, rad/s
_OFF = 0.001  # share of the way
_CYCLES, _SLICE = 20, 0.05  # cycles a call, s of processor time


def run(quick: bool) -> Report:
    """Measure each drive."""
    simulations = {"OneBot": Simulation()}
    try:
        for name, description in _DRIVES.items():
            simulations[name] = Simulation(description)
        for simulation in simulations.values():
            simulation.robot.drive(_LINEAR, _ANGULAR)
            simulation.run(2.0)
        least = 0.0 if quick else _SLICE
        variants = {name: _cycles(simulation, least) for name, simulation in simulations.items()}
        seconds = in_turn(variants, 1 if quick else 75)
        for name, simulation in simulations.items():
            _check(name, simulation)
    finally:
        for simulation in simulations.values():
            simulation.close()
    return [
        Result(
            f"{name}: a cycle over one of OneBot",
            over(seconds[name], seconds["OneBot"]),
            at_most=_MOST.get(name, math.nan),
        )
        for name in _DRIVES
    ]


def _cycles(simulation: Simulation, least: float) -> Callable[[], float]:
    return lambda: cpu_of(lambda: simulation.step(_CYCLES), least)


def _check(name: str, simulation: Simulation) -> None:
    pose, odometry = simulation.robot.pose, simulation.robot.odometry
    off = math.hypot(pose.x - odometry.x, pose.y - odometry.y)
    if not off <= _OFF * _LINEAR * simulation.time:
        raise WrongAnswer(f"{name} is {1e3 * off:.2f} mm from its odometry")
