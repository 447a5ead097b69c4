"""OneBots in one PyBullet world, each with its controller, against bare steps of the same world.

Slices of time in which all controllers run, and every robot drives a circle, take turns with slices
of bare ``stepSimulation``, in which the motors keep their last speeds, so that the robots do the
same. Both are timed on the processor time of the thread, which other processes disturb less than
the clock on the wall. Before and after them each robot has to be where its odometry says.
"""

import gc
import math

from onebot_control import RobotSetup, Simulation
from onebot_control.controlled_robot import Snapshot
from onebot_control.fleet import Fleet
from onebot_control.physics.engine import engine
from onebot_description.geometry.poses import yaw_of
from tests.benchmarks.measuring import WrongAnswer, cpu_of, in_turn, median, over
from tests.benchmarks.report import Report, Result

_LINEAR, _ANGULAR = 0.3, 0.2  # m/s, rad/s: a circle of 1.5 m radius
_APART = 4.0  # m between starts, so that circles do not meet
_DRIVEN = 2.0  # s, before the first check
_FARTHEST = 0.005  # m, from odometry; tests.accuracy shows less
_TURNED = math.radians(0.2)
_GOAL = 0.8
_SLICE = 0.05  # s of processor time; many short ones, as what else the machine does comes and goes


def run(quick: bool) -> Report:
    """Measure worlds of 1 to 100 robots."""
    results = []
    for robots in (1, 10) if quick else (1, 10, 100):
        bare, ours = _measure(robots, quick)
        what = f"{robots} OneBot{'s'[: robots - 1]}:"
        results += [
            Result(f"{what} simulated seconds a second of processor time", 1.0 / median(ours)),
            Result(f"{what} bare steps' time of the whole", over(bare, ours), at_least=_GOAL),
        ]
    return results


def _measure(robots: int, quick: bool) -> tuple[list[float], list[float]]:
    """Check a world of robots; return the processor time of bare steps, and with controllers.

    Both are s for each simulated second, a number a round.
    """
    side = math.ceil(math.sqrt(robots))
    setups = {
        f"robot{row}": RobotSetup(_APART * (row % side), _APART * (row // side), 0.1 * row)
        for row in range(robots)
    }
    with Simulation(robots=setups) as simulation:
        fleet = simulation._core.fleet
        for _ in range(round((0.3 if quick else _DRIVEN) / fleet.period)):
            _drive(fleet)
        _check_odometry(fleet)
        # As the node does: what lives need not be looked through for garbage again and again.
        gc.collect()
        gc.freeze()
        least = 0.0 if quick else _SLICE
        try:
            variants = {
                "bare": lambda: cpu_of(lambda: _step(fleet), least) / fleet.period,
                "ours": lambda: cpu_of(lambda: _drive(fleet), least) / fleet.period,
            }
            seconds = in_turn(variants, 1 if quick else 75)
        finally:
            gc.unfreeze()
        _check_odometry(fleet)
    return seconds["bare"], seconds["ours"]


def _drive(fleet: Fleet) -> list[Snapshot]:
    for robot in fleet.robots:
        robot.accept(_LINEAR, _ANGULAR)
    return list(fleet.cycle())


def _step(fleet: Fleet) -> None:
    for _ in range(fleet.world.settings.steps(fleet.period)):
        engine.stepSimulation(fleet.world.bullet.client)


def _check_odometry(fleet: Fleet) -> None:
    for robot in fleet.robots:
        snapshot = robot.begin()
        expected = robot.odom_in_world.compose(snapshot.drive.odometry)
        # Over a long drive it may be off by more.
        scale = max(1.0, robot.ticks * robot.period / _DRIVEN)
        (x, y, _), rotation = snapshot.pose
        distance = math.hypot(x - expected.x, y - expected.y)
        turn = abs(math.remainder(yaw_of(*rotation) - expected.yaw, math.tau))
        # Unlike >, this lets no NaN pass.
        if not (distance <= _FARTHEST * scale and turn <= _TURNED * scale):
            off = f"{1e3 * distance:.2f} mm and {math.degrees(turn):.3f} degrees"
            raise WrongAnswer(f"a robot is {off} from its odometry")
