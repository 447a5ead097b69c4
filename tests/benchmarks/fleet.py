"""OneBots in one world as ``onebot_bringup robots:=N`` brings them up, all of them driven.

A process of its own commands each robot ten times a second and counts the control cycles of one. At
the end each robot must drive at the commanded speed, clear of the others. The floor are bare
``stepSimulation`` calls of the same world, for each cycle, in this process.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import combinations
from math import hypot
from pathlib import Path
from typing import Any, NamedTuple

from onebot_bringup.launch.robots import in_rows
from onebot_control.fleet import Fleet, Member
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.simulation.engine import engine
from onebot_description.description import Description, load_description
from tests.benchmarks.lines import Lines
from tests.benchmarks.measuring import (
    Running,
    WrongAnswer,
    cpu_ns,
    median,
    process_tree,
    ros_domain,
    rss_bytes,
)
from tests.benchmarks.report import Goal, Options, Report, Value, at_least, at_most
from tests.benchmarks.startup import pss_bytes

MODEL = "package://onebot_description/urdf/onebot.urdf.xacro"
_BRINGUP = [sys.executable, "-m", "onebot_bringup.launch.onebot_bringup", "reload:=false"]
_SIMULATION, _STATES = "onebot_control.velocity_controller", "onebot_description.robot_state"
_RATE = 100.0  # Hz
_SPEED, _TOLERANCE = 0.2, 0.02  # m/s
_CLEAR = 0.3  # m between two robots, at least
_ROBOTS, _LEAST, _MOST = 20, 0.99, 1000.0  # of the goals: robots, of real time, MB
_STEPS = 100  # cycles of bare steps
_PATIENCE = 60.0  # s


class Window(NamedTuple):
    """What a fleet took."""

    share: float  # of 100 cycles a second
    simulation: float  # ms of processor time of velocity_controller for each cycle
    states: float  # of robot_state_publisher
    total: float  # of all processes
    rss: float  # MB of all processes; what they share counts for each
    pss: float  # MB, what they share counted once


def run(options: Options) -> Report:
    """Bring up fleets of several sizes."""
    sizes = (
        [(3, "none")] if options.quick else [(1, "none"), (20, "none"), (20, "web"), (50, "none")]
    )
    description, rows, goals = load_description(MODEL), [], list[Goal]()
    for robots, viewer in sizes:
        options.say(f"fleet: {robots} robots, viewer {viewer}")
        bare = bare_steps(description, robots, options)
        windows = [_measure(robots, viewer, options) for _ in range(options.choose(3, 1))]
        rows.append(_row(robots, viewer, windows, bare))
        if robots == _ROBOTS:
            goals += _goals(f"{robots} robots, viewer {viewer}", windows)
    notes = [
        f"All robots drove as commanded, {_SPEED:g} m/s, clear of one another. Milliseconds of "
        "processor time for each control cycle, of which real time has 10 on each core; bare "
        "steps are those of the same world without anything else. Memory as in startup."
    ]
    return Report("fleet", rows, goals, notes)


def _goals(what: str, windows: Sequence[Window]) -> list[Goal]:
    return [
        at_least(f"{what}: of real time at 100 Hz", _middle(windows, "share"), _LEAST),
        at_most(f"{what}: memory, RSS", _middle(windows, "rss"), _MOST, "MB"),
    ]


def bare_steps(description: Description, robots: int, options: Options) -> float:
    """Return the ms of processor time that the physics of a control cycle takes, and no more."""
    values = read_control_files([default_control_file()], "/", "velocity_controller").values
    config = ControlConfig.from_parameters(values)
    members = [
        Member(description, replace(config, x=each.x, y=each.y), each.name)
        for each in in_rows(robots, description)
    ]
    with Fleet.of(members) as fleet:
        for _ in range(options.choose(100, 2)):
            for robot in fleet.robots:
                robot.accept(_SPEED, 0.0)
            fleet.cycle()
        steps = fleet.world.settings.steps(fleet.period)
        took = []
        for _ in range(options.choose(_STEPS, 2)):
            began = time.thread_time()
            for _ in range(steps):
                engine.stepSimulation(fleet.world.client)
            took.append(1e3 * (time.thread_time() - began))
    return median(took)


def _measure(robots: int, viewer: str, options: Options) -> Window:
    """Bring a fleet up, drive it, and look at what it takes meanwhile.

    Raises:
        WrongAnswer: a robot does not drive as commanded.
    """
    names = [f"robot{row + 1}" for row in range(robots)]
    with ExitStack() as stack:
        environment = stack.enter_context(ros_domain())
        for display in ("DISPLAY", "WAYLAND_DISPLAY"):
            environment.pop(display, None)  # no browser is to be opened
        words = [*_BRINGUP, f"robots:={robots}", f"viewer:={viewer}"]
        bringup = stack.enter_context(Running(words, environment))
        commander = [sys.executable, "-m", "tests.benchmarks.fleet_commander", *names]
        commands = stack.enter_context(Running(commander, environment, pipes=True))
        lines = Lines(commands)
        lines.next(bringup)
        order = {"speed": _SPEED, "seconds": options.choose(2, 1)}
        deadline = time.monotonic() + _PATIENCE
        while not _drives(lines.ask(order, bringup)) and time.monotonic() < deadline:
            continue  # it starts to drive: of many robots, slower than in real time
        pids = process_tree(bringup.process.pid)
        began, at = {pid: cpu_ns(pid) for pid in pids}, time.monotonic()
        seen = lines.ask({**order, "seconds": options.choose(8, 1)}, bringup)
        spent = {pid: 1e-6 * (cpu_ns(pid) - began[pid]) for pid in pids}
        seconds = time.monotonic() - at
        _check(seen)
        stamps = seen["stamps"]
        cycles = len(stamps) * seconds / (stamps[-1] - stamps[0])
        per_cycle = {pid: took / cycles for pid, took in spent.items()}
        return Window(
            (len(stamps) - 1) / (stamps[-1] - stamps[0]) / _RATE,
            _of(per_cycle, _SIMULATION),
            _of(per_cycle, _STATES),
            sum(per_cycle.values()),
            rss_bytes(*pids) / 1e6,
            pss_bytes(*pids) / 1e6,
        )


def _drives(seen: Mapping[str, Any]) -> bool:
    # Slow motion shows in the speeds, which are by the system's clock. No NaN passes.
    return all(_TOLERANCE < speed <= _SPEED + _TOLERANCE for speed in seen["speeds"].values())


def _check(seen: Mapping[str, Any]) -> None:
    if not _drives(seen):
        raise WrongAnswer(f"commanded {_SPEED:g} m/s, the robots drive at {seen['speeds']}")
    for (one, a), (other, b) in combinations(seen["placed"].items(), 2):
        if not hypot(a[0] - b[0], a[1] - b[1]) >= _CLEAR:
            raise WrongAnswer(f"{one} and {other} are in the same place, {a} and {b}")


def _of(per_cycle: Mapping[int, float], module: str) -> float:
    """What the processes that run a module took."""
    words = {pid: Path(f"/proc/{pid}/cmdline").read_bytes().decode() for pid in per_cycle}
    return sum(took for pid, took in per_cycle.items() if module in words[pid])


def _middle(windows: Sequence[Window], field: str) -> float:
    return median([getattr(window, field) for window in windows])


def _row(robots: int, viewer: str, windows: Sequence[Window], bare: float) -> dict[str, Value]:
    simulation = _middle(windows, "simulation")
    return {
        "Robots": robots,
        "viewer": viewer,
        "of real time": _middle(windows, "share"),
        "bare steps ms/cycle": bare,
        "simulation": simulation,
        "over bare": simulation / bare,
        "state publishers": _middle(windows, "states"),
        "all": _middle(windows, "total"),
        "RSS MB": _middle(windows, "rss"),
        "PSS MB": _middle(windows, "pss"),
    }
