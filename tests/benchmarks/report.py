"""Options of a benchmark and its results: rows of a table, and goals met or not."""

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from onebot_description.errors import OneBotError

Value = str | int | float | None

BEGIN, END = "<!-- benchmarks -->", "<!-- /benchmarks -->"


def say_on_stderr(text: str) -> None:
    """Print a line of progress, with the time of day, beside the results on standard output."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Options:
    """Options of a benchmark."""

    quick: bool = False  # do a little of everything, to check the answers; the times mean nothing
    # Reports progress, a line at a time.
    say: Callable[[str], None] = field(default=say_on_stderr, repr=False)

    def choose(self, full: int, quick: int) -> int:
        """``full``, or ``quick`` in quick mode: for counts of rounds, messages and the like."""
        return quick if self.quick else full


@dataclass(frozen=True)
class Goal:
    """A limit that the project promises to keep."""

    what: str  # what is limited, such as "CPU per message over the relay's, N = 10"
    measured: float  # as measured, in ``unit``
    limit: float  # in ``unit``
    met: bool  # whether it was kept
    unit: str = ""  # of both; empty for a ratio
    at_least: bool = False  # the limit is the least allowed, not the most

    @property
    def result(self) -> str:
        """What was measured, such as "1.20 s", and whether the goal was missed."""
        return f"{text(self.measured)} {self.unit}".rstrip() + ("" if self.met else " (MISSED)")

    @property
    def bound(self) -> str:
        """The limit, such as "at most 1.25"."""
        return f"at {'least' if self.at_least else 'most'} {self.limit:g} {self.unit}".rstrip()


def at_most(what: str, measured: float, limit: float, unit: str = "") -> Goal:
    """Return the goal that ``measured`` be no more than ``limit``; NaN never meets it."""
    return Goal(what, measured, limit, measured <= limit, unit)


def at_least(what: str, measured: float, limit: float, unit: str = "") -> Goal:
    """Return the goal that ``measured`` be no less than ``limit``; NaN never meets it."""
    return Goal(what, measured, limit, measured >= limit, unit, at_least=True)


@dataclass(frozen=True)
class Report:
    """Results of a benchmark."""

    name: str  # of the benchmark, as in the registry
    # Of its table; a row may leave out columns, which stand in the order they first occur.
    rows: Sequence[Mapping[str, Value]]
    goals: Sequence[Goal] = ()  # that the project set itself
    notes: Sequence[str] = ()  # whole sentences on how it was measured, what was left out, and why


def columns(rows: Sequence[Mapping[str, Value]]) -> list[str]:
    """Return the names of all columns, in the order in which they first occur."""
    return list(dict.fromkeys(name for row in rows for name in row))


def text(value: Value) -> str:
    """Return a number to three significant digits, as a table shows it; None as a dash."""
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    if not math.isfinite(value):
        return str(value)
    if value == 0.0:
        return "0"
    places = max(0, 2 - math.floor(math.log10(abs(value))))
    # Beyond a thousand the digits before the point stand for themselves.
    return f"{value:.{places}f}" if places < 7 else f"{value:.2e}"


def plain_table(rows: Sequence[Mapping[str, Value]]) -> str:
    """Return rows as an aligned table for a terminal: words to the left, numbers to the right."""
    names = columns(rows)
    cells = [[text(row.get(name)) for name in names] for row in rows]
    widths = [max(map(len, column)) for column in zip(names, *cells, strict=True)]
    numeric = [
        all(not isinstance(row.get(name), str) for row in rows if row.get(name) is not None)
        for name in names
    ]
    lines = [names, ["-" * width for width in widths], *cells]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in lines
    )


def markdown_table(rows: Sequence[Mapping[str, Value]]) -> str:
    """Return rows as a table in Markdown."""
    names = columns(rows)
    lines = [names, ["---"] * len(names)]
    lines += [[text(row.get(name)).replace("|", "\\|") for name in names] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def plain(report: Report, *, verdict: bool = True) -> str:
    """Return a report as text for a terminal.

    Args:
        report: what was found.
        verdict: say which goals were met; not after a quick run, whose times mean nothing.
    """
    parts = [f"== {report.name}", plain_table(report.rows)]
    if verdict and report.goals:
        parts.append(
            "\n".join(f"{goal.what}: {goal.result} (goal: {goal.bound})" for goal in report.goals)
        )
    parts += [note for note in report.notes if note]
    return "\n\n".join(parts) + "\n"


def markdown(machine: str, reports: Sequence[Report]) -> str:
    """Return the goals of a run as a section of a README."""
    goals = [
        {"Benchmark": report.name, "What": goal.what, "Measured": goal.result, "Goal": goal.bound}
        for report in reports
        for goal in report.goals
    ]
    return f"Measured by `python -m tests.benchmarks` on: {machine}.\n\n{markdown_table(goals)}\n"


def write_section(file: Path, section: str) -> None:
    """Replace what stands between the marks in ``file``.

    Raises:
        OneBotError: the file has no marks, or cannot be read or written.
    """
    try:
        before, begin, rest = file.read_text(encoding="utf-8").partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise OneBotError(f"{file}: has no lines {BEGIN} and {END} to put the tables between")
        file.write_text(f"{before}{begin}\n{section}{end}{after}", encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None
