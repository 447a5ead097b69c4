"""Results of a benchmark: rows of a table, goals met or not, and how cost grows."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Value = str | int | float | None
Point = tuple[float, float]


@dataclass(frozen=True)
class Goal:
    """A limit that the project promises to keep."""

    what: str  # what is limited, such as "CPU per message over the relay's, N = 10"
    measured: float  # as measured, in ``unit``
    limit: float  # in ``unit``
    met: bool  # whether it was kept
    unit: str = ""  # of both; empty for a ratio
    at_least: bool = False  # the limit is the least allowed, not the most

    def sentence(self) -> str:
        """Return the goal and its result, such as "...: 1.2 (goal: at most 1.25): met"."""
        unit = f" {self.unit}" if self.unit else ""
        bound = "at least" if self.at_least else "at most"
        return (
            f"{self.what}: {text(self.measured)}{unit} (goal: {bound} {self.limit:g}{unit}): "
            f"{'met' if self.met else 'MISSED'}"
        )


def at_most(what: str, measured: float, limit: float, unit: str = "") -> Goal:
    """Return the goal that ``measured`` be no more than ``limit``; NaN never meets it."""
    return Goal(what, measured, limit, measured <= limit, unit)


def at_least(what: str, measured: float, limit: float, unit: str = "") -> Goal:
    """Return the goal that ``measured`` be no less than ``limit``; NaN never meets it."""
    return Goal(what, measured, limit, measured >= limit, unit, at_least=True)


@dataclass(frozen=True)
class Plot:
    """How cost grows: some curves over one quantity, on logarithmic axes."""

    title: str  # of the plot
    x: str  # name and unit of the horizontal axis
    y: str  # name and unit of the vertical axis
    curves: Mapping[str, Sequence[Point]]  # the points of each, (x, y), both above zero
    note: str = ""  # where it bends, and why


@dataclass(frozen=True)
class Report:
    """Results of a benchmark."""

    name: str  # of the benchmark, as in the registry
    # Of its table; a row may leave out columns, which stand in the order they first occur.
    rows: Sequence[Mapping[str, Value]]
    goals: Sequence[Goal] = ()  # that the project set itself
    notes: Sequence[str] = ()  # whole sentences on how it was measured, what was left out, and why
    growth: Sequence[Plot] = field(default=())  # plots of cost

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "Report":
        """Return what ``dataclasses.asdict`` wrote."""
        return cls(
            data["name"],
            data["rows"],
            [Goal(**goal) for goal in data["goals"]],
            data["notes"],
            [Plot(**plot) for plot in data["growth"]],
        )


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
        parts.append("\n".join(goal.sentence() for goal in report.goals))
    parts += [note for note in report.notes if note]
    if verdict:
        parts += [f"{plot.title}: {plot.note}" for plot in report.growth if plot.note]
    return "\n\n".join(parts) + "\n"
