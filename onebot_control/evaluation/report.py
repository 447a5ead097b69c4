"""The output of a study: its progress, success by factor, and files of its table."""

import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from io import BytesIO
from pathlib import Path
from statistics import fmean
from xml.etree import ElementTree

import pyarrow as pa
from pyarrow import csv, parquet

from onebot_control.evaluation.cases import ERROR
from onebot_control.evaluation.rows import fact_of, text_of
from onebot_description.atomic_write import write_whole
from onebot_description.errors import OneBotError, did_you_mean, listing, printable

_MAX_LEVELS = 8  # maximum number of listed values of a factor
_MAX_ERRORS = 3  # maximum number of listed errors
_Z = 1.959964  # number of standard deviations that contain 95 % of a normal distribution
_EVERY = {True: 0.2, False: 30.0}  # s between lines of progress, on a terminal or elsewhere


class Progress(AbstractContextManager["Progress"]):
    """Shows the number of finished episodes, rate, time left and the first error on stderr."""

    def __init__(self, total: int, done: int, shown: bool) -> None:
        """Start with ``done`` finished episodes."""
        self._total, self._done, self._failed, self._shown = total, done, 0, shown
        self._live, self._error = sys.stderr.isatty(), ""
        self._began = time.monotonic()
        self._first: tuple[float, int] | None = None  # time and count at the first outcome
        self._next = self._began + _EVERY[self._live]

    def add(self, success: bool, number: int, error: str | None) -> None:
        """Count the episode of a case."""
        self._done += 1
        self._failed += not success
        now = time.monotonic()
        self._first = self._first or (now, self._done)
        if not self._shown:
            return
        if error and not self._error:
            self._error = error
            print(f"{f'case {number}: {error}':78}", file=sys.stderr)
        if now >= self._next or self._done == self._total:
            self._next = now + _EVERY[self._live]
            filled = round(20 * self._done / self._total)
            bar = f"[{'#' * filled}{'.' * (20 - filled)}] {self._done} of {self._total}"
            text = f"{bar}, {self._failed} failed{self._pace(now, *self._first)}"
            print(f"{text:78}", end="\r" if self._live else "\n", file=sys.stderr, flush=True)

    def _pace(self, now: float, first: float, before: int) -> str:
        """Return the rate since the first outcome, without the start-up."""
        if now - first < first - self._began or self._done == before:
            return ""  # too early: all workers end their first episodes at about the same time
        rate = (self._done - before) / (now - first)
        minutes, seconds = divmod(round((self._total - self._done) / rate), 60)
        return f", {rate:.3g} per second, {minutes}:{seconds:02} left"

    def __exit__(self, *_: object) -> None:
        if self._shown and self._live:
            print(file=sys.stderr)


def share(table: pa.Table, name: str) -> float:
    """Return the mean of a column of booleans or numbers; NaN if an episode has no number.

    An episode without a boolean counts as unsuccessful.

    Raises:
        OneBotError: there is no such column although an episode had no error, or it has no mean.
    """
    if name not in table.column_names:
        if table[ERROR].null_count:
            hint = did_you_mean(name, table.column_names, "columns")
            raise OneBotError(f'the episodes return no "{name}"{hint}')
        return 0.0
    values = table[name].to_pylist()
    if all(value is None or isinstance(value, bool) for value in values):
        return sum(map(bool, values)) / len(values)
    try:
        return math.nan if None in values else fmean(values)
    except TypeError:
        text = f'"{name}" has no mean: it is a column of {table[name].type}'
        raise OneBotError(text) from None


def interval(successes: int, count: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a proportion (Wilson score)."""
    share, square = successes / count, _Z * _Z / count
    middle = (share + square / 2.0) / (1.0 + square)
    half = _Z * math.sqrt(share * (1.0 - share) / count + square / (4.0 * count)) / (1.0 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


def summary(table: pa.Table) -> str:
    """Return the success of a study as text, in total and by factor, with 95 % intervals.

    An episode with an error counts as unsuccessful.

    Args:
        table: the result of ``evaluate``, or its Parquet file read again.
    """
    names = [
        name
        for name in fact_of(table, "success") or ()
        if name in table.column_names and pa.types.is_boolean(table[name].type)
    ]
    columns = {name: [value is True for value in table[name].to_pylist()] for name in names}
    errors = table[ERROR].to_pylist()
    columns = columns or {"without error": [error is None for error in errors]}
    failed = [error for error in errors if error is not None]
    title = f"{fact_of(table, 'study') or 'study'}: {len(table)} episodes"
    lines = [f"{title}, {len(failed)} with an error"]
    for name, values in columns.items():
        lines += _shares(name, values, table, fact_of(table, "factors") or ())
    missed = [
        number for number, row in enumerate(zip(*columns.values(), strict=True)) if not all(row)
    ]
    lines.append(f"cases without success: {listing(map(str, missed))}")
    for error in [*dict.fromkeys(failed)][:_MAX_ERRORS]:
        lines.append(f"error of case {errors.index(error)}: {error}")
    return "\n".join(map(printable, lines))


def _shares(
    name: str, values: Sequence[bool], table: pa.Table, factors: Sequence[str]
) -> list[str]:
    lines = [f"{name}: {_share(values)}"]
    for factor in factors:
        levels: dict[str, list[bool]] = {}
        for level, value in zip(table[factor].to_pylist(), values, strict=True):
            levels.setdefault(text_of(level), []).append(value)
        if len(levels) > _MAX_LEVELS:
            lines.append(f"  {factor}: {len(levels)} values")
            continue
        width = max(map(len, levels))
        lines += [f"  {factor} {level:{width}}  {_share(each)}" for level, each in levels.items()]
    return lines


def _share(values: Sequence[bool]) -> str:
    low, high = interval(sum(values), len(values))
    text = f"{sum(values)} of {len(values)}, {100 * sum(values) / len(values):.1f} %"
    return f"{text} ({100 * low:.1f} to {100 * high:.1f} %)"


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table to a file: Parquet, CSV, or JUnit's XML, by the suffix of its name.

    Raises:
        OneBotError: it cannot be written.
    """
    data = BytesIO()
    WRITERS[path.suffix](table, data)
    try:
        write_whole(path, data.getvalue())
    except OSError as error:
        raise OneBotError(f"{path} cannot be written: {error.strerror}") from None


def _write_csv(table: pa.Table, file: BytesIO) -> None:
    columns = {
        name: _cells(column) if pa.types.is_nested(column.type) else column
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    csv.write_csv(pa.table(columns), file)


def _cells(column: pa.ChunkedArray) -> pa.Array:
    """Return lists and mappings as text, since CSV has none."""
    return pa.array([None if value is None else str(value) for value in column.to_pylist()])


def _write_junit(table: pa.Table, file: BytesIO) -> None:
    """Write one test case per episode, with a failure if unsuccessful, or an error."""
    study = str(fact_of(table, "study") or "study")
    factors, success = fact_of(table, "factors") or (), fact_of(table, "success") or ()
    suite = ElementTree.Element("testsuite", name=study)
    counts = Counter(tests=len(table), failures=0, errors=0)
    for number, row in enumerate(table.to_pylist()):
        values = ", ".join(f"{name}={text_of(row[name])}" for name in factors)
        case = ElementTree.SubElement(
            suite, "testcase", classname=study, name=printable(f"{number}: {values}")
        )
        if row[ERROR] is not None:
            counts["errors"] += 1
            ElementTree.SubElement(case, "error", message=row[ERROR])
        elif missed := [name for name in success if row.get(name) is False]:
            counts["failures"] += 1
            text = printable(f"not {', '.join(missed)}: {row}")
            ElementTree.SubElement(case, "failure", message=text)
    suite.attrib.update({name: str(count) for name, count in counts.items()})
    ElementTree.ElementTree(suite).write(file, encoding="utf-8", xml_declaration=True)


WRITERS = {".parquet": parquet.write_table, ".csv": _write_csv, ".xml": _write_junit}
"""Functions that write a table, by the suffix of the file."""
