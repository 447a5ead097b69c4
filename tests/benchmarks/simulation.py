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
from typing import NamedTuple

from onebot_control.driven_robot import Snapshot
from onebot_control.fleet import Fleet, Member
from onebot_control.odometry import Odometry
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.poses import PlanarPose, yaw_of
from onebot_control.simulation import Settings
from onebot_control.simulation.engine import engine
from onebot_description.description import Description, load_description
from tests.benchmarks.measuring import WrongAnswer, in_turn, median
from tests.benchmarks.report import Options, Report, Value, at_least

MODEL = "package://onebot_description/urdf/onebot.urdf.xacro"
BARE, OURS = "bare stepSimulation", "with controllers"
_LINEAR, _ANGULAR = 0.3, 0.2  # m/s, rad/s: a circle of 1.5 m radius
_APART = 4.0  # m between starts, so that circles do not meet
_DRIVEN = 2.0  # s, of the arc that is checked
_FARTHEST = 0.005  # m, from the commanded arc and from odometry; tests.accuracy shows less
_TURNED = math.radians(0.2)
_GOAL = 0.8
_GOALS_FOR = (1, 10, 100)
_SLICE = 0.05  # s of processor time; many short ones, as what else the machine does comes and goes


class Took(NamedTuple):
    """What a slice took for each simulated second."""

    wall: float  # s
    cpu: float  # s of processor time


class Measured(NamedTuple):
    """Measurements of one world."""

    robots: int  # in it
    takes: dict[str, list[Took]]  # of each variant, a slice a round
    error: float  # m, the farthest a robot was from its arc

    def factor(self, name: str) -> float:
        """Simulated seconds a second on the wall."""
        return 1.0 / median([took.wall for took in self.takes[name]])

    def cycle_us(self, name: str) -> float:
        """Processor time of each robot in a control cycle of 10 ms, microseconds."""
        return 1e4 * median([took.cpu for took in self.takes[name]]) / self.robots

    @property
    def share(self) -> float:
        """What the physics is of all: bare over ours, the middle one of the rounds."""
        pairs = zip(self.takes[BARE], self.takes[OURS], strict=True)
        return median([bare.cpu / ours.cpu for bare, ours in pairs])


def run(options: Options) -> Report:
    """Measure worlds of 1 to 100 robots."""
    description = load_description(MODEL)
    parameters = read_control_files([default_control_file()], "/", "velocity_controller")
    config = ControlConfig.from_parameters(parameters.values)
    counts = (1, 10) if options.quick else (1, 2, 5, 10, 20, 50, 100)
    results = []
    for robots in counts:
        options.say(f"simulation: {_so_many(robots)} in one world")
        results.append(measure(description, config, robots, options))
    goals = [
        at_least(f"{_so_many(each.robots)}: bare steps' time of the whole", each.share, _GOAL)
        for each in results
        if each.robots in _GOALS_FOR
    ]
    worst = max(result.error for result in results)
    notes = [
        f"Every robot was where it was commanded to drive: at most {1e3 * worst:.2f} mm from "
        f"its arc after {_DRIVEN:g} s. {_per_cycle(config)} physics steps a control cycle, solver "
        "iterations as in the table of tests.accuracy. The real-time factor is of one "
        "core, on the wall; the rest is processor time."
    ]
    return Report("simulation", [_row(result) for result in results], goals, notes)


def _so_many(robots: int) -> str:
    return f"{robots} OneBot{'s'[: robots - 1]}"


def measure(
    description: Description, config: ControlConfig, robots: int, options: Options
) -> Measured:
    """Check and time a world of ``robots``.

    Raises:
        WrongAnswer: a robot is not where it was commanded to.
    """
    side = math.ceil(math.sqrt(robots))
    members = [
        Member(
            description,
            replace(config, x=_APART * (row % side), y=_APART * (row // side), yaw=0.1 * row),
        )
        for row in range(robots)
    ]
    with Fleet.of(members) as fleet:
        error = check_drive(fleet, 0.3 if options.quick else _DRIVEN)
        # As the node does: what lives need not be looked through for garbage again and again.
        gc.collect()
        gc.freeze()
        try:
            cycles = _cycles_of(fleet, options)
            variants: dict[str, Callable[[], Took]] = {
                BARE: lambda: _timed(_bare, fleet, cycles),
                OURS: lambda: _timed(_driven, fleet, cycles),
            }
            takes = in_turn(variants, options.choose(75, 1))
        finally:
            gc.unfreeze()
        _check_odometry(fleet, [drive.begin() for drive in fleet.robots])
    return Measured(robots, takes, error)


def check_drive(fleet: Fleet, duration: float) -> float:
    """Drive an arc for ``duration`` s; return how far, in m, a robot was from it at most.

    Raises:
        WrongAnswer: too far.
    """
    starts = [drive.true_pose for drive in fleet.robots]
    plans = [Odometry(drive.controller.odometry.kinematics) for drive in fleet.robots]
    period = fleet.robots[0].period
    for _ in range(round(duration / period)):
        _command(fleet)
        for plan, snapshot in zip(plans, fleet.cycle(), strict=True):
            command = snapshot.command
            plan.update_open_loop(command.linear, command.angular, period)
    snapshots = [drive.begin() for drive in fleet.robots]
    _check_odometry(fleet, snapshots)
    worst = 0.0
    for row, (start, plan, snapshot) in enumerate(zip(starts, plans, snapshots, strict=True)):
        planned = start.compose(PlanarPose(plan.x, plan.y, plan.heading))
        worst = max(worst, _apart(_true(snapshot), planned, f"robot {row + 1}'s place", "its arc"))
    return worst


def _check_odometry(fleet: Fleet, snapshots: list[Snapshot]) -> None:
    for row, (drive, snapshot) in enumerate(zip(fleet.robots, snapshots, strict=True)):
        believed = drive.odom_in_world.compose(snapshot.odometry)
        # Over a long drive it may be off by more.
        scale = max(1.0, drive.ticks * drive.period / _DRIVEN)
        _apart(_true(snapshot), believed, f"robot {row + 1}'s place", "its odometry", scale)


def _true(snapshot: Snapshot) -> PlanarPose:
    (x, y, _), rotation = snapshot.pose.translation.tolist(), snapshot.pose.rotation.tolist()
    return PlanarPose(x, y, yaw_of(*rotation))


def _apart(one: PlanarPose, other: PlanarPose, what: str, which: str, scale: float = 1.0) -> float:
    """How far apart two poses are, m; WrongAnswer if too far."""
    place = math.hypot(one.x - other.x, one.y - other.y)
    turn = abs(math.remainder(one.yaw - other.yaw, 2.0 * math.pi))
    # Unlike >, this lets no NaN pass.
    if not (place <= _FARTHEST * scale and turn <= _TURNED * scale):
        raise WrongAnswer(
            f"{what} is {1e3 * place:.2f} mm and {math.degrees(turn):.3f} degrees from {which}"
        )
    return place


def _command(fleet: Fleet) -> None:
    for drive in fleet.robots:
        drive.accept(_LINEAR, _ANGULAR)


def _driven(fleet: Fleet, cycles: int) -> None:
    for _ in range(cycles):
        _command(fleet)
        fleet.cycle()


def _bare(fleet: Fleet, cycles: int) -> None:
    step, client = engine.stepSimulation, fleet.world.client
    for _ in range(cycles * _per_cycle(fleet.robots[0].config)):
        step(client)


def _per_cycle(config: ControlConfig) -> int:
    """Physics steps a control cycle."""
    return Settings().fitted(config.update_rate).steps(1.0 / config.update_rate)


def _timed(work: Callable[[Fleet, int], None], fleet: Fleet, cycles: int) -> Took:
    wall, cpu = time.perf_counter(), time.thread_time()
    work(fleet, cycles)
    wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
    simulated = cycles * fleet.robots[0].period
    return Took(wall / simulated, cpu / simulated)


def _cycles_of(fleet: Fleet, options: Options) -> int:
    """How many control cycles a slice has."""
    began, cycles = time.thread_time(), 0
    while cycles < 2 or (not options.quick and time.thread_time() - began < _SLICE):
        _driven(fleet, 1)
        cycles += 1
    return cycles


def _row(result: Measured) -> dict[str, Value]:
    return {
        "OneBots": result.robots,
        "real-time factor": result.factor(OURS),
        "bare steps'": result.factor(BARE),
        "CPU us/cycle": result.robots * result.cycle_us(OURS),
        "bare": result.robots * result.cycle_us(BARE),
        "bare over ours": result.share,
    }
