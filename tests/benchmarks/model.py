"""RobotModel against other libraries: a robot's transforms from its joints' positions.

Two tasks: parent-to-child transforms of all joints, as /tf carries them, and poses of all links in
the root's frame. Once for one set of positions, and once for a batch of 1000; libraries without
batches take a batch one by one.
"""

import itertools
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from tests.benchmarks.chains import Chain, Floats
from tests.benchmarks.measuring import WrongAnswer, in_turn, median, seconds_per_call
from tests.benchmarks.model_libraries import (
    LINK_POSES,
    OTHERS,
    TRANSFORMS,
    OneBot,
    installed,
)
from tests.benchmarks.registry import Options
from tests.benchmarks.report import Goal, Report, Value, at_least

_COUNTS = (10, 50, 200, 1000)
_BATCH = 1000
_TOLERANCE = 1e-9
# Joints to the least speed over yourdfpy's.
_SINGLE_GOALS = {10: 10.0, 200: 100.0}
_BATCH_GOAL_FROM = 50


def run(options: Options) -> Report:
    """Measure chains of 10 to 1000 joints."""
    others = [library for library in OTHERS if installed(library)]
    missing = [library.name for library in OTHERS if not installed(library)]
    rows: list[dict[str, Value]] = []
    goals: list[Goal] = []
    for joints in (10, 50) if options.quick else _COUNTS:
        options.say(f"model: {joints} joints")
        chain = Chain(joints)
        for task in (TRANSFORMS, LINK_POSES):
            libraries: list[Any] = [OneBot, *others]
            able = {
                library.name: library(chain)
                for library in libraries
                if joints <= library.tasks.get(task, 0)
            }
            for library in able.values():
                _check(library, task, chain)
            single = _measure(able, task, chain.positions(_BATCH), 1, options)
            batch = _measure(able, task, chain.positions(_BATCH), _BATCH, options)
            rows += [_row(joints, task, name, single, batch) for name in able]
            goals += _goals(joints, task, single, batch)
    notes = [
        "All transforms were checked against scipy's. Transforms per second; ratios are medians of "
        f"those within a round. A batch is {_BATCH} states; the other libraries have no batches, "
        "and are called state by state.",
        "Left out: pinocchio from 300 joints on, because its work memory grows with their cube, to "
        "32 GB at 1000; yourdfpy's links in root beyond 50 joints, which take 20 s a state at 200; "
        "kinpy beyond 300, because it reads chains by recursion; ikpy beyond 50, because it takes "
        "minutes to read them. kinpy and ikpy know links in root only.",
    ]
    if missing:
        notes.append(f"Not installed, so not measured: {', '.join(missing)}.")
    return Report("model", rows, goals, notes)


def _check(library: Any, task: str, chain: Chain) -> None:
    """Compare a library's answers with the chain's own.

    Raises:
        WrongAnswer: they differ.
    """
    positions = chain.positions(3)
    links = chain.link_matrices(positions)
    for row, state in enumerate(positions):
        found = library.matrices(task, library.run(task, state))
        _compare(found, _expected(links[row], task), f"{library.name}, {task}")
    if library.batches:
        batch = library.run(task, positions)
        for row in range(len(positions)):
            one = tuple(part[row] for part in batch) if isinstance(batch, tuple) else batch[row]
            found = library.matrices(task, one)
            _compare(found, _expected(links[row], task), f"{library.name}, {task}, in a batch")


def _expected(links: Floats, task: str) -> Floats:
    if task == LINK_POSES:
        return links[1:]
    expected: Floats = np.linalg.inv(links[:-1]) @ links[1:]
    return expected


def _compare(found: Floats, expected: Floats, who: str) -> None:
    error = float(np.abs(found - expected).max()) if found.shape == expected.shape else np.inf
    # Positions far out along a chain of many metres round off accordingly.
    allowed = _TOLERANCE * max(1.0, float(np.abs(expected).max()))
    if not error <= allowed:
        raise WrongAnswer(
            f"{who}: off by {error:.3g} with {len(expected)} joints (allowed: {allowed:.1g})"
        )


def _measure(
    libraries: Mapping[str, Any], task: str, positions: Floats, batch: int, options: Options
) -> dict[str, list[float]]:
    """Return each library's transforms per second, a number a round."""
    least = 0.002 if options.quick else 0.1
    joints = positions.shape[1]

    def speed(library: Any) -> float:
        function, states = _call(library, task, positions, batch)
        return float(joints * states / seconds_per_call(function, least))

    variants = {name: partial(speed, library) for name, library in libraries.items()}
    return in_turn(variants, options.choose(5, 1))


def _call(
    library: Any, task: str, positions: Floats, batch: int
) -> tuple[Callable[[], object], int]:
    """What is to be timed, and how many states it computes."""
    if batch > 1 and library.batches:
        return partial(library.run, task, positions[:batch]), batch
    # Never the same state twice in turn: some libraries keep their last results.
    states = itertools.cycle(positions)
    return lambda: library.run(task, next(states)), 1


def _row(
    joints: int,
    task: str,
    name: str,
    single: Mapping[str, list[float]],
    batch: Mapping[str, list[float]],
) -> dict[str, Value]:
    return {
        "Joints": joints,
        "Transforms": task,
        "Library": name,
        "single: us": 1e6 * joints / median(single[name]),
        "single: transforms/s": round(median(single[name])),
        "RobotModel over it": _over(single, name),
        "batch: us/state": 1e6 * joints / median(batch[name]),
        "batch: transforms/s": round(median(batch[name])),
        "RobotModel over it, batch": _over(batch, name),
    }


def _over(speeds: Mapping[str, list[float]], name: str) -> float:
    pairs = zip(speeds[OneBot.name], speeds[name], strict=True)
    return median([ours / other for ours, other in pairs])


def _goals(
    joints: int,
    task: str,
    single: Mapping[str, list[float]],
    batch: Mapping[str, list[float]],
) -> list[Goal]:
    goals = []
    if joints in _SINGLE_GOALS and "yourdfpy" in single:
        what = f"{joints} joints, {task}: RobotModel over yourdfpy"
        goals.append(at_least(what, _over(single, "yourdfpy"), _SINGLE_GOALS[joints]))
    if joints >= _BATCH_GOAL_FROM:
        for name in batch:
            if name != OneBot.name:
                what = f"{joints} joints, {task}, batch: RobotModel over {name}"
                goals.append(at_least(what, _over(batch, name), 1.0))
    return goals
