"""The benchmarks, their options, and how one is run.

A benchmark is a module of this package with ``run(options: Options) -> Report``. It reports
progress with ``options.say``, raises ``WrongAnswer`` where an answer is wrong, and stops all it has
started however it ends.
"""

import importlib
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import cast

from onebot_description.errors import OneBotError, did_you_mean
from tests.benchmarks.report import Report

# What each measures, in one line: to list them imports none.
BENCHMARKS = {
    "state_publisher": "CPU, latency and memory of robot_state_publisher against a relay of bytes",
    "model": "transforms per second of RobotModel against yourdfpy, pinocchio, kinpy and ikpy",
    "simulation": "real-time factor of 1 to 100 OneBots with controllers against bare PyBullet",
    "fleet": "processor time and memory of robots:=1 to 50 in one world against bare PyBullet",
    "startup": "command to first /tf, /odom and frame logged, and memory, against an empty node",
    "control_loop": "jitter at 100 Hz and latency of commands, with the viewer and without",
    "viewer": "CPU of the viewer for each robot state against bare send_columns",
    "displays": "CPU of displays of scans, clouds, images, maps, markers against bare send_columns",
    "growth": "how cost grows with joints, 10 to 10000",
}


def say_on_stderr(text: str) -> None:
    """Print a line of progress, with the time of day, beside the results on standard output."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Options:
    """Options of a benchmark."""

    quick: bool = False  # do a little of everything, to check the answers; the times mean nothing
    # Command of another node to measure, with placeholders; see state_publisher.py.
    peer: str | None = None
    # Reports progress, a line at a time.
    say: Callable[[str], None] = field(default=say_on_stderr, repr=False)

    def choose(self, full: int, quick: int) -> int:
        """``full``, or ``quick`` in quick mode: for counts of rounds, messages and the like."""
        return quick if self.quick else full


def chosen(names: Sequence[str]) -> list[str]:
    """Return the benchmarks to run: ``names`` in the table's order, or all where none is given.

    Raises:
        OneBotError: there is no such benchmark.
    """
    for name in names:
        if name not in BENCHMARKS:
            known = did_you_mean(name, BENCHMARKS, "benchmarks")
            raise OneBotError(f'no benchmark "{name}"{known}')
    return [name for name in BENCHMARKS if not names or name in names]


def run(name: str, options: Options) -> Report:
    """Run one benchmark.

    Raises:
        WrongAnswer: what was measured gave wrong answers, so there is nothing to report.
        OneBotError: it cannot be run here.
    """
    module = importlib.import_module(f"{__package__}.{name}")
    return cast(Report, module.run(options))
