"""Navigation: what planning and following cost, and how robots cross generated worlds.

Costs are over floors of the same run. Beside the table,

    python -m tests.benchmarks.navigation [--barn FILE] [--model FILE] [--sensors FILE] [--every N]

drives a robot through the worlds of the BARN challenge (an .npz file with ``centres``, ``offsets``
and ``path_length``, see ``_barn``) or, without it, through generated ones, and prints the
challenge's score of each: reached * optimal / clip(time, 2 optimal, 8 optimal), with the optimal
time of the shortest way at 2 m/s.
"""

import argparse
import math
import sys
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from onebot_control import Simulation
from onebot_control.navigation.cost_to_go import CostToGo
from onebot_control.navigation.footprint import Vehicle
from onebot_control.navigation.grid import Window
from onebot_control.navigation.local_planner import LocalPlanner, Situation
from onebot_description.description import Description, parse_description
from onebot_description.description.clutter import ClutterParameters, clutter
from onebot_description.geometry.poses import PlanarPose, Triple
from tests.benchmarks.measuring import WrongAnswer, cpu_of, in_turn, over
from tests.benchmarks.report import Report, Result

JACKAL = {
    **{"linear.x.max_velocity": 2.0, "linear.x.max_acceleration": 3.0},
    **{"angular.z.max_velocity": 4.0, "angular.z.max_acceleration": 8.0},
}
_SECONDS, _NEAR, _BEGUN = 100.0, 1.0, 0.1  # s, m and m, as in the challenge
_OPTIMAL = 2.0  # m/s
_STEPS, _SAMPLES = 56, 2000  # of Nav2's controller
# What Nav2's cycle of that size takes, 20 ms at most, over bare roll-outs (1.65 ms); the goal is 8.
_CYCLE = 8.0 / 1.65
# Times of a field of 400 x 400 cells, 80 ms, and of its repair, 15 ms, over a distance transform of
# such a map, 6 ms; of 1500 x 1600 cells, 600 ms over 125 ms.
_FIELD, _REPAIR, _LARGE = 80.0 / 6.0, 15.0 / 6.0, 600.0 / 125.0


def run(quick: bool) -> Report:
    """Measure planning, following and a drive through the maze."""
    rounds, least = (1, 0.0) if quick else (9, 0.05)
    small, large = _prices((400, 400)), _prices((1500, 1600) if not quick else (300, 320))
    field, cycle = _whole(small), _cycle()
    part = Window(200, 200, 220, 220)

    def repair() -> None:
        for price in (np.inf, 1.0):
            small[part.cells] = price
            field.change(small, part)
            field.spread()

    variants = {
        "roll-outs": lambda: cpu_of(_roll_outs, least),
        "cycle": lambda: cpu_of(cycle, least),
        "transform": lambda: cpu_of(lambda: distance_transform_edt(np.isfinite(small)), least),
        "field": lambda: cpu_of(lambda: _whole(small), least),
        "repair": lambda: cpu_of(repair, least) / 2.0,
        "large transform": lambda: cpu_of(
            lambda: distance_transform_edt(np.isfinite(large)), least
        ),
        "large field": lambda: cpu_of(lambda: _whole(large), least),
    }
    seconds = in_turn(variants, rounds)
    rows = (
        ("a control cycle of 2000 x 56 over bare roll-outs", "cycle", "roll-outs", _CYCLE),
        ("a field of 400 x 400 over a distance transform", "field", "transform", _FIELD),
        ("its repair 10 m from the goal, likewise", "repair", "transform", _REPAIR),
        ("a field of 1500 x 1600, likewise", "large field", "large transform", _LARGE),
    )
    return [
        *(Result(what, over(seconds[a], seconds[b]), at_most=most) for what, a, b, most in rows),
        *_maze(quick),
    ]


def _maze(quick: bool) -> Report:
    """Drive OneBot through the maze; of its processor time, how much is the simulation's."""
    goal = (0.5, 0.0) if quick else (2.4, 2.4)
    with Simulation(world="maze", sensors=True) as simulation:
        robot = simulation.robot
        simulation.run(1.0)
        began = time.thread_time()
        simulation.run(5.0)
        bare = (time.thread_time() - began) / 5.0
        start = simulation.time
        robot.go_to(*goal)
        began = time.thread_time()
        simulation.run(until=lambda: not robot.navigating, timeout=120.0)
        cpu = (time.thread_time() - began) / (simulation.time - start)
        away = math.hypot(robot.pose.x - goal[0], robot.pose.y - goal[1])
        if robot.navigation.status != "arrived" or away > 0.05 or robot.collided:
            raise WrongAnswer(f"{robot.navigation.status}, {away:.3f} m from the goal: {robot}")
    return [
        Result("the maze with go_to over the maze without", cpu / bare),
        Result("go_to in the maze, times real time", 1.0 / cpu, at_least=8.0),
    ]


def _prices(shape: tuple[int, int]) -> Any:
    occupied = np.random.default_rng(1).random(shape) < 0.004
    occupied[200:220, 200:220] = occupied[:20, :20] = False
    away = distance_transform_edt(~occupied) * 0.05
    prices = 1.0 + 8.0 * np.exp((0.2 - away) / 0.08)
    prices[away < 0.2] = np.inf
    prices[:20, :20] = 1.0
    return prices.astype(np.float32)


def _whole(prices: Any) -> CostToGo:
    field = CostToGo(prices, 0.05, np.array([(5, 5)]))
    field.spread()
    return field


def _roll_outs() -> None:
    """Roll out what a cycle rolls out, and look one value up at each pose: as little as can be."""
    commands = _COMMANDS
    yaw = np.cumsum(commands[:, 1] * np.float32(0.05), axis=0)
    x = np.cumsum(commands[:, 0] * np.cos(yaw), axis=0)
    y = np.cumsum(commands[:, 0] * np.sin(yaw), axis=0)
    index = (y * np.float32(0.05)).astype(np.int32) * 400 + (x * np.float32(0.05)).astype(np.int32)
    weights = np.exp(_VALUES.take(index, mode="clip").sum(axis=0))
    (commands @ weights).sum()


_COMMANDS = np.random.default_rng(0).uniform(-0.1, 1.0, (_STEPS, 2, _SAMPLES)).astype(np.float32)
_VALUES = np.zeros(160_000, np.float32)


def _cycle() -> Any:
    corners = np.array([(-0.2, -0.15), (0.2, -0.15), (0.2, 0.15), (-0.2, 0.15)])
    vehicle = Vehicle(corners, 1.0, 0.3, 0.0, 2.0, 1.0, 3.0)
    planner = LocalPlanner(vehicle, samples=_SAMPLES, steps=_STEPS)
    prices = _prices((400, 400))
    fine = np.kron(np.isfinite(prices), np.ones((2, 2), bool))
    distances = (distance_transform_edt(fine) * 0.025).astype(np.float32)
    state = PlanarPose(10.0, 10.0), (0.5, 0.0, 0.0), (0.2, 0.2)
    costs = distances, _whole(prices).values, 20.0, (0.0, 0.0), 0.05
    now = Situation(*state, *costs, np.zeros((0, 2)))
    return lambda: planner.command(now)


# Worlds -------------------------------------------------------------------------------------------


class _Course(NamedTuple):
    name: str
    world: str | Description
    start: PlanarPose
    goal: tuple[float, float]
    length: float  # of the shortest way, m


class _Run(NamedTuple):
    reached: bool
    collided: bool
    seconds: float
    score: float
    text: str


def _barn(file: str, every: int) -> Iterator[_Course]:
    """Yield the worlds of the BARN challenge: upright cylinders of radius 0.075 m."""
    barn = np.load(file)
    shape = '<geometry><cylinder radius="0.075" length="1"/></geometry>'
    for index in range(0, len(barn["path_length"]), every):
        centers = barn["centres"][barn["offsets"][index] : barn["offsets"][index + 1]]
        parts = [
            f'<{kind}><origin xyz="{x} {y} 0.5"/>{shape}</{kind}>'
            for x, y in centers
            for kind in ("visual", "collision")
        ]
        world = parse_description(
            f'<robot name="barn"><link name="world"/><link name="c">{"".join(parts)}</link><joint '
            'name="j" type="fixed"><parent link="world"/><child link="c"/></joint></robot>'
        )
        length = float(barn["path_length"][index])
        yield _Course(str(index), world, PlanarPose(-2.25, 3.0, 1.57), (-2.25, 13.0), length)


def _generated(every: int) -> Iterator[_Course]:
    for seed in range(0, 100, every):
        for density in (0.15, 0.2, 0.25):
            made = clutter(ClutterParameters(seed, density))
            name = f"clutter:seed={seed},density={density}"
            yield _Course(name, name, PlanarPose(), made.goal, made.length)


def _delay(navigator: Any, cycles: int) -> None:
    """Return each command of a navigator some of its cycles later."""
    update, commands = navigator.update, deque([(0.0, 0.0, 0.0)] * cycles)

    def updated(*measured: Any, **sensed: Any) -> Triple:
        commands.append(update(*measured, **sensed))
        return commands.popleft()

    navigator.update = updated


def _cross(course: _Course, model: dict[str, Any], late: int) -> _Run:
    x, y, yaw = course.start
    with Simulation(world=course.world, x=x, y=y, yaw=yaw, **model) as simulation:
        robot, began = simulation.robot, math.inf
        robot.go_to(*course.goal)
        _delay(robot.navigation.navigator, late)

        def over_yet() -> bool:
            nonlocal began
            pose = robot.pose
            if math.hypot(pose.x - x, pose.y - y) > _BEGUN:
                began = min(began, simulation.time)
            near = math.hypot(pose.x - course.goal[0], pose.y - course.goal[1]) < _NEAR
            late = simulation.time > _SECONDS
            return near or late or robot.collided or not robot.navigating

        simulation.run(until=over_yet, timeout=_SECONDS + 5.0)
        pose, known = robot.pose, robot.navigation.navigator.pose
        near = math.hypot(pose.x - course.goal[0], pose.y - course.goal[1]) < _NEAR
        reached = near and not robot.collided
        seconds, optimal = simulation.time - min(began, simulation.time), course.length / _OPTIMAL
        score = reached * optimal / float(np.clip(seconds, 2.0 * optimal, 8.0 * optimal))
        off = math.hypot(pose.x - known.x, pose.y - known.y)
        text = (
            f"{course.name}: {'reached' if reached else robot.navigation.reason or 'not reached'}"
            f"{', TOUCHED' if robot.collided else ''} {seconds:.2f} s, "
            f"{seconds / optimal:.2f} x optimal, {off:.3f} m off, score {score:.3f}"
        )
        return _Run(reached, robot.collided, seconds / optimal, score, text)


def main(argv: list[str]) -> int:
    """Drive through worlds, print each, and return 0."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.navigation")
    parser.add_argument("--barn", metavar="FILE", help="worlds of the BARN challenge, .npz")
    parser.add_argument("--model", metavar="FILE", help="the robot's URDF; default: OneBot")
    parser.add_argument("--sensors", metavar="FILE", help="further sensors of it, such as an IMU")
    parser.add_argument("--late", type=int, default=0, metavar="N", help="commands are N/20 s late")
    parser.add_argument("--every", type=int, default=10, metavar="N", help="each Nth world")
    arguments = parser.parse_args(argv)
    model: dict[str, Any] = {"sensors": True}
    if arguments.model:
        further = arguments.sensors or False
        model = {"model": arguments.model, "parameters": JACKAL, "sensors": further}
    every = arguments.every
    runs = []
    for course in _barn(arguments.barn, every) if arguments.barn else _generated(every):
        runs.append(_cross(course, model, arguments.late))
        print(runs[-1].text, flush=True)
    rows = np.array([run[:4] for run in runs], float)
    reached, touched, ratio, score = rows.mean(axis=0)
    print(
        f"{len(runs)} worlds: reached {reached:.3f}, touched {touched:.3f}, "
        f"score {score:.3f}, mean time {ratio:.2f} x optimal, median {np.median(rows[:, 2]):.2f}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
