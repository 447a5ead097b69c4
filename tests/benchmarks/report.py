"""What a benchmark has measured, as a table in the terminal and in the README."""

import datetime
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from onebot_description.errors import OneBotError
from tests.readme import CHECKOUT
from tests.support import run_to_end

_HEAD = "| Benchmark | What | Measured | Goal |\n| --- | --- | --- | --- |"
BEGIN, END = "<!-- benchmarks -->", "<!-- /benchmarks -->"
_PACKAGES = ("onebot-robots", "ros-jazzy-rclpy", "numpy", "rerun-sdk", "pybullet", "yourdfpy")


class Result(NamedTuple):
    """A row of the table: what was measured, and the goal that the project promises to keep."""

    what: str  # such as "10 joints: CPU per message over the floor"
    measured: float  # in ``unit``
    at_most: float = float("nan")  # NaN: no such goal
    at_least: float = float("nan")
    unit: str = ""  # empty for a ratio

    @property
    def met(self) -> bool:
        """Whether the goal was kept; NaN never keeps one."""
        return not self.goal or self.measured <= self.at_most or self.measured >= self.at_least

    @property
    def goal(self) -> str:
        """The goal, such as "at most 1.25"; empty if there is none."""
        for words, limit in (("at most", self.at_most), ("at least", self.at_least)):
            if limit == limit:
                return f"{words} {limit:g} {self.unit}".rstrip()
        return ""

    def row(self) -> list[str]:
        """Cells of the table."""
        number = f"{self.measured:.0f}" if self.measured >= 100 else f"{self.measured:#.3g}"
        missed = "" if self.met else " (MISSED)"
        return [self.what, f"{number} {self.unit}".rstrip() + missed, self.goal]


Report = Sequence[Result]


def table(reports: dict[str, Report]) -> str:
    """Return the results of benchmarks, by name, as one table in Markdown."""
    return "\n".join([_HEAD, *_rows(reports)])


def _rows(reports: dict[str, Report]) -> list[str]:
    lines = [[name, *result.row()] for name, report in reports.items() for result in report]
    return [f"| {' | '.join(line)} |" for line in lines]


def machine() -> str:
    """Describe this machine and its software; call it before anything is run.

    ``load before`` is the average number of processes that wanted a core in the minute before: on
    an idle machine it is near 0.
    """
    models = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    # With a + where files differ from the commit.
    describe = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    commit = run_to_end(describe, cwd=CHECKOUT).stdout.strip()
    facts = {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "cpu": next(iter(models), platform.machine()),
        "cores": len(os.sched_getaffinity(0)),
        "memory": f"{memory:.0f} GB",
        "kernel": f"{platform.system()} {platform.release()}",
        "load before": f"{os.getloadavg()[0]:.2f}",
        "commit": commit,
        "python": platform.python_version(),
        **{package: metadata.version(package) for package in _PACKAGES},
    }
    return ", ".join(f"{name} {value}" for name, value in facts.items())


def write_section(file: Path, machine: str, reports: dict[str, Report]) -> None:
    """Write the table between the marks in ``file``; rows of other benchmarks stay in it.

    Raises:
        OneBotError: the file has no marks.
    """
    before, begin, rest = file.read_text(encoding="utf-8").partition(BEGIN)
    middle, end, after = rest.partition(END)
    if not (begin and end):
        raise OneBotError(f"{file}: has no lines {BEGIN} and {END} to put the table between")
    _, _, old = middle.partition(f"{_HEAD}\n")
    kept = [row for row in old.splitlines() if row.split("|")[1].strip() not in reports]
    older = " Rows of other benchmarks are older." if kept else ""
    rows = "\n".join([_HEAD, *kept, *_rows(reports)])
    section = f"Measured by `python -m tests.benchmarks` on: {machine}.{older}\n\n{rows}\n"
    file.write_text(f"{before}{begin}\n{section}{end}{after}", encoding="utf-8")
