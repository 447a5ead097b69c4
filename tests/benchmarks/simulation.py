"""OneBots in one PyBullet world, each with its controller, against bare steps of the same world.

First every robot drives an arc, and where it ends up is checked: against the arc its limited
command describes, and against its odometry. Then slices of time in which all controllers run take
turns with slices of bare ``stepSimulation``, in which the motors keep their last speeds, so that
the robots do the same. Both are timed on the processor time of the thread, which other processes
disturb less than the clock on the wall.
"""

import gc
import math
import time
from collections.abc import Callable
from dataclasses import replace

from onebot_control.control_files import default_control_file, read_control_files
from onebot_control.controlled_robot import Snapshot
from onebot_control.drive.odometry import Odometry
from onebot_control.drive.parameters import ControlConfig
from onebot_control.fleet import Fleet, Member
from onebot_control.physics.engine import engine
from onebot_description.description import load_description
from onebot_description.geometry.poses import PlanarPose, yaw_of
from tests.benchmarks.measuring import MODEL, WrongAnswer, in_turn, median, over
from tests.benchmarks.report import Report, Result

_LINEAR, _ANGULAR = 0.3, 0.2  # m/s, rad/s: a circle of 1.5 m radius
_APART = 4.0  # m between starts, so that circles do not meet
_DRIVEN = 2.0  # s, of the arc that is checked
_FARTHEST = 0.005  # m, from the commanded arc and from odometry; tests.accuracy shows less
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
    values = read_control_files([default_control_file()], "/", "velocity_controller").values
    config, description = ControlConfig.from_parameters(values), load_description(MODEL)
    side = math.ceil(math.sqrt(robots))
    members = [
        Member(
            description,
            replace(config, x=_APART * (row % side), y=_APART * (row // side), yaw=0.1 * row),
        )
        for row in range(robots)
    ]
    with Fleet.from_members(members) as fleet:
        _check_arcs(fleet, 0.3 if quick else _DRIVEN)
        # As the node does: what lives need not be looked through for garbage again and again.
        gc.collect()
        gc.freeze()
        try:
            began, cycles = time.thread_time(), 0
            while cycles < 2 or (not quick and time.thread_time() - began < _SLICE):
                _drive(fleet)
                cycles += 1
            variants = {
                "bare": lambda: _timed(lambda: _step(fleet), fleet, cycles),
                "ours": lambda: _timed(lambda: _drive(fleet), fleet, cycles),
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


def _timed(work: Callable[[], object], fleet: Fleet, cycles: int) -> float:
    began = time.thread_time()
    for _ in range(cycles):
        work()
    return (time.thread_time() - began) / (cycles * fleet.period)


def _check_arcs(fleet: Fleet, duration: float) -> None:
    """Drive for ``duration`` s; every robot is on the arc of its limited commands."""
    starts = [robot.true_pose for robot in fleet.robots]
    plans = [Odometry(robot.diff_drive.odometry.kinematics) for robot in fleet.robots]
    for _ in range(round(duration / fleet.period)):
        for plan, snapshot in zip(plans, _drive(fleet), strict=True):
            command = snapshot.command
            plan.update_open_loop(command.linear, command.angular, fleet.period)
    _check_odometry(fleet)
    for start, plan, robot in zip(starts, plans, fleet.robots, strict=True):
        arc = start.compose(PlanarPose(plan.x, plan.y, plan.heading))
        _check(robot.begin(), arc, "its arc")


def _check_odometry(fleet: Fleet) -> None:
    for robot in fleet.robots:
        snapshot = robot.begin()
        # Over a long drive it may be off by more.
        scale = max(1.0, robot.ticks * robot.period / _DRIVEN)
        _check(snapshot, robot.odom_in_world.compose(snapshot.odometry), "its odometry", scale)


def _check(snapshot: Snapshot, expected: PlanarPose, which: str, scale: float = 1.0) -> None:
    (x, y, _), rotation = snapshot.pose
    distance = math.hypot(x - expected.x, y - expected.y)
    turn = abs(math.remainder(yaw_of(*rotation) - expected.yaw, math.tau))
    # Unlike >, this lets no NaN pass.
    if not (distance <= _FARTHEST * scale and turn <= _TURNED * scale):
        raise WrongAnswer(
            f"a robot is {1e3 * distance:.2f} mm and {math.degrees(turn):.3f} degrees from {which}"
        )
