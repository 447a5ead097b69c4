"""The output of a study: its progress, success by factor, and files of its table."""

import math
import sys
import time
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import pyarrow as pa
from pyarrow import csv, parquet

from onebot_control.evaluation.cases import ERROR
from onebot_control.evaluation.rows import fact_of, text_of
from onebot_description.atomic_write import write_whole, writing
from onebot_description.errors import OneBotError, did_you_mean, listing, printable

_MAX_LEVELS = 8  # maximum number of listed values of a factor
_MAX_ERRORS = 3  # maximum number of listed errors
_EVERY = {True: 0.2, False: 30.0}  # s between lines of progress, on a terminal or elsewhere


class Progress:
    """Shows the number of finished episodes, rate, time left and the first error on stderr."""

    def __init__(self, total: int, done: int) -> None:
        """Start with ``done`` finished episodes."""
        self._total, self._first, self._done = total, done, done
        self._failed = self._errors = 0
        self._began = self._printed = time.monotonic()
        self._live = sys.stderr.isatty()

    def add(self, success: bool, number: int, error: str | None) -> None:
        """Count the episode of a case."""
        self._done += 1
        self._failed += not success
        self._errors += error is not None
        if error and self._errors == 1:
            print(f"{f'case {number}: {error}':78}", file=sys.stderr)
        now = time.monotonic()
        if now >= self._printed + _EVERY[self._live] or self._done == self._total:
            self._printed = now
            rate = (self._done - self._first) / (now - self._began)
            minutes, seconds = divmod(round((self._total - self._done) / rate), 60)
            filled = round(20 * self._done / self._total)
            bar = f"[{'#' * filled}{'.' * (20 - filled)}] {self._done} of {self._total}"
            text = f"{bar}, {self._failed} failed, {rate:.3g} per second"
            end = "\r" if self._live and self._done < self._total else "\n"
            print(f"{f'{text}, {minutes}:{seconds:02} left':78}", end=end, file=sys.stderr)


def share(table: pa.Table, name: str) -> float:
    """Return the mean of a column of booleans or numbers; NaN if an episode has no number.

    An episode without a boolean counts as unsuccessful.

    Raises:
        OneBotError: there is no such column, or it has no mean.
    """
    from pyarrow import compute  # slow to import

    if name not in table.column_names:
        hint = did_you_mean(name, table.column_names, "columns")
        raise OneBotError(f'the episodes return no "{name}"{hint}')
    column = table[name]
    if pa.types.is_boolean(column.type):
        column = column.fill_null(False)
    try:
        mean = compute.mean(column, skip_nulls=False).as_py()
    except pa.ArrowException:
        raise OneBotError(f'"{name}" has no mean: it is a column of {column.type}') from None
    return math.nan if mean is None else float(mean)


def summary(table: pa.Table) -> str:
    """Return the success of a study as text, in total and by factor, with 95 % intervals.

    An episode with an error counts as unsuccessful.

    Args:
        table: the result of ``evaluate``, or its Parquet file read again.
    """
    errors = table[ERROR].to_pylist()
    columns = {
        name: [value is True for value in table[name].to_pylist()]
        for name in fact_of(table, "success") or ()
        if name in table.column_names and pa.types.is_boolean(table[name].type)
    } or {"without error": [error is None for error in errors]}
    failed = [error for error in errors if error is not None]
    title = f"{fact_of(table, 'study') or 'study'}: {len(table)} episodes"
    lines = [f"{title}, {len(failed)} with an error"]
    for name, values in columns.items():
        lines.append(f"{name}: {_share(values)}")
        for factor in fact_of(table, "factors") or ():
            lines += _shares(factor, [*map(text_of, table[factor].to_pylist())], values)
    rows = enumerate(zip(*columns.values(), strict=True))
    missed = [str(number) for number, row in rows if not all(row)]
    lines.append(f"cases without success: {listing(missed)}")
    for error in [*dict.fromkeys(failed)][:_MAX_ERRORS]:
        lines.append(f"error of case {errors.index(error)}: {error}")
    return "\n".join(map(printable, lines))


def _shares(factor: str, levels: list[str], values: list[bool]) -> list[str]:
    by_level: dict[str, list[bool]] = {}
    for level, value in zip(levels, values, strict=True):
        by_level.setdefault(level, []).append(value)
    if len(by_level) > _MAX_LEVELS:
        return [f"  {factor}: {len(by_level)} values"]
    width = max(map(len, by_level))
    return [f"  {factor} {level:{width}}  {_share(each)}" for level, each in by_level.items()]


def _share(values: list[bool]) -> str:
    """Return a proportion with its confidence interval (Wilson score)."""
    from scipy.stats import binomtest

    low, high = binomtest(sum(values), len(values)).proportion_ci(method="wilson")
    text = f"{sum(values)} of {len(values)}, {100 * sum(values) / len(values):.1f} %"
    return f"{text} ({100 * low:.1f} to {100 * high:.1f} %)"


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table to a file: Parquet, CSV, or JUnit's XML, by the suffix of its name.

    Raises:
        OneBotError: it cannot be written.
    """
    data = BytesIO()
    WRITERS[path.suffix](table, data)
    with writing(path):
        write_whole(path, data.getvalue())


def _write_csv(table: pa.Table, file: BytesIO) -> None:
    """Write what CSV has not as text: lists, mappings, bytes and UUIDs."""
    for index, column in enumerate(table.columns):
        kind = column.type
        is_other = pa.types.is_binary(kind) or isinstance(kind, pa.BaseExtensionType)
        if is_other or pa.types.is_nested(kind):
            cells = [None if value is None else str(value) for value in column.to_pylist()]
            table = table.set_column(index, table.column_names[index], pa.array(cells))
    csv.write_csv(table, file)


def _write_junit(table: pa.Table, file: BytesIO) -> None:
    """Write one test case per episode, with a failure if unsuccessful, or an error."""
    study = str(fact_of(table, "study") or "study")
    factors, success = fact_of(table, "factors") or (), fact_of(table, "success") or ()
    suite = ElementTree.Element("testsuite", name=study, tests=str(len(table)))
    for number, row in enumerate(table.to_pylist()):
        values = ", ".join(f"{name}={text_of(row[name])}" for name in factors)
        title = printable(f"{number}: {values}")
        case = ElementTree.SubElement(suite, "testcase", classname=study, name=title)
        if row[ERROR] is not None:
            ElementTree.SubElement(case, "error", message=row[ERROR])
        elif missed := [name for name in success if row.get(name) is False]:
            text = printable(f"not {', '.join(missed)}: {row}")
            ElementTree.SubElement(case, "failure", message=text)
    for kind in ("failure", "error"):
        suite.set(f"{kind}s", str(len(suite.findall(f"*/{kind}"))))
    ElementTree.ElementTree(suite).write(file, encoding="utf-8", xml_declaration=True)


WRITERS = {".parquet": parquet.write_table, ".csv": _write_csv, ".xml": _write_junit}
"""Functions that write a table, by the suffix of the file."""
