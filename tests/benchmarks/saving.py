"""The results of a run: as JSON, and as a section of a README."""

import dataclasses
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_description.errors import OneBotError
from tests.benchmarks import machine
from tests.benchmarks.report import Report, markdown_table

BEGIN, END = "<!-- benchmarks -->", "<!-- /benchmarks -->"


@dataclass(frozen=True)
class Results:
    """Results of a run of some benchmarks."""

    machine: dict[str, str | int]  # as ``machine.describe`` has it
    quick: bool  # it was a quick run: the times mean nothing
    reports: Sequence[Report]  # of the benchmarks, in the order they were run


def save(file: Path, results: Results) -> None:
    """Write results as JSON; what was in ``file`` is replaced as a whole or not at all.

    Raises:
        OneBotError: it cannot be written.
    """
    data = {
        "machine": results.machine,
        "quick": results.quick,
        "reports": [dataclasses.asdict(report) for report in results.reports],
    }
    _replace(file, json.dumps(data, indent=1) + "\n")


def load(file: Path) -> Results:
    """Read what ``save`` wrote.

    Raises:
        OneBotError: it cannot be read, or holds something else.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        reports = [Report.from_json(report) for report in data["reports"]]
        return Results(data["machine"], bool(data["quick"]), reports)
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise OneBotError(f"{file}: holds no results of onebot bench ({error!r})") from None


def markdown(results: Results, plot: str = "") -> str:
    """Return the section of a README.

    Args:
        results: of a run.
        plot: address of the plot, relative to the README; empty: none.
    """
    parts = [f"Measured by `onebot bench` on: {machine.sentence(results.machine)}."]
    if plot:
        parts.append(f"![How cost grows with joints and robots]({plot})")
    for report in results.reports:
        parts.append(f"**{report.name}**")
        if report.goals:
            parts.append("\n".join(f"- {goal.sentence()}" for goal in report.goals))
        # Folded: whoever wants the numbers opens it.
        parts += [f"<details><summary>{report.name}: the numbers</summary>"]
        parts += [markdown_table(report.rows), *report.notes, "</details>"]
        parts += [f"{plotted.title}: {plotted.note}" for plotted in report.growth if plotted.note]
    return "\n\n".join(parts) + "\n"


def write_section(file: Path, text: str, marks: tuple[str, str] = (BEGIN, END)) -> None:
    """Put ``text`` between the marks in ``file``.

    Raises:
        OneBotError: the file has no marks, or cannot be read or written.
    """
    try:
        old = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None
    before, begin, rest = old.partition(marks[0])
    _, end, after = rest.partition(marks[1])
    if not (begin and end):
        raise OneBotError(f"{file}: has no lines {' and '.join(marks)} to put the tables between")
    _replace(file, f"{before}{begin}\n{text}{end}{after}")


def _replace(file: Path, text: str) -> None:
    fresh = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        fresh.write_text(text, encoding="utf-8")
        fresh.replace(file)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise OneBotError(f"{file}: {error}") from None
