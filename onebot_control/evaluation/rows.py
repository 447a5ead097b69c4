"""Rows of a study: packed by workers, written to a journal, and combined in a table."""

import hashlib
import json
import os
import platform
import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from onebot_control.evaluation.cases import ERROR, Case, checked_row
from onebot_description.atomic_write import writing
from onebot_description.errors import OneBotError, shortened
from onebot_description.parameters.values import plain

PROCESSOR = "processor"
"""The name of the processor among the ``machine_facts``."""

_UNFIT = (pa.ArrowException, OverflowError, UnicodeError)
_EMPTY = str(pa.struct([]))  # the type of an empty mapping, which Parquet does not have
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")  # differs from process to process
_PACKAGES = ("onebot-robots", "numpy", "pybullet", "pybullet-arm64", "embreex", "pyarrow")
_JOURNAL = pa.schema([("case", pa.int64()), ("row", pa.binary()), (ERROR, pa.string())])
_STUDY = b"study"


class EpisodeOutcome(NamedTuple):
    """The outcome of an episode: its packed return value or an error, and its recording."""

    row: bytes
    error: str | None
    recording: bytes = b""


_Write = Callable[[int, EpisodeOutcome], None]

Outcomes = Generator[tuple[int, EpisodeOutcome], None, None]
"""The numbers and outcomes of cases, in the order of completion; closing it ends the episodes."""


def packed_row(returned: object, case: Case) -> bytes:
    """Pack the return value of an episode as the stream of an Arrow table with one row.

    Raises:
        OneBotError: it is not a mapping from names to values, or it has another value for a column
            of the case.
    """
    row = checked_row({} if returned is None else returned, "the returned value")
    for name in row.keys() & case.keys():
        if [row[name]] != [case[name]]:  # lists, in which an object equals itself, also an array
            raise OneBotError(f'the episode returned "{name}", which is a column of the case')
    columns = {name: _column([value]) for name, value in row.items() if name not in case}
    table, sink = pa.table(columns), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


def unpacked_row(row: bytes) -> dict[str, Any]:
    """Return the row packed by ``packed_row``; empty bytes are an empty row."""
    values = pa.ipc.open_stream(row).read_all().to_pylist() if row else []
    return dict(values[0]) if values else {}


def table_of(
    cases: Sequence[Case], outcomes: Sequence[EpisodeOutcome], facts: Mapping[str, Any]
) -> pa.Table:
    """Return the table of a study: the columns of cases and returned mappings, then ``error``.

    Types are determined from all values together, regardless of their order.

    Args:
        cases: the cases.
        outcomes: the outcome of each case.
        facts: values for the metadata of the table.
    """
    columns: dict[str, list[Any]] = {}
    for number, (case, outcome) in enumerate(zip(cases, outcomes, strict=True)):
        for name, value in {**case, **unpacked_row(outcome.row)}.items():
            columns.setdefault(name, [None] * len(cases))[number] = value
    arrays = {name: _column(values) for name, values in columns.items()}
    arrays[ERROR] = pa.array([outcome.error for outcome in outcomes], pa.string())
    texts = {name: json.dumps(value) for name, value in facts.items()}
    return pa.table(arrays).replace_schema_metadata(texts)


def _column(values: Sequence[Any]) -> pa.Array:
    """Return values as an array; as text if they have no common type, or none for a file."""
    with suppress(*_UNFIT):
        array = pa.array([*map(plain, values)])
        if _EMPTY not in str(array.type):
            return array
    return pa.array([None if value is None else text_of(value) for value in values])


def text_of(value: object) -> str:
    """Return a value as text that is the same in every process."""
    text = getattr(value, "__qualname__", None) or _ADDRESS.sub("", str(value))
    return text.encode(errors="backslashreplace").decode()  # no table has surrogates


def fact_of(table: pa.Table, name: str) -> Any:
    """Return one of the facts in the metadata of a table; None if it is missing."""
    text = (table.schema.metadata or {}).get(name.encode())
    return None if text is None else json.loads(text)


def machine_facts() -> dict[str, str]:
    """Return the versions of the packages that compute an episode, and the processor."""
    facts = {"python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            facts[package] = metadata.version(package)
    model = platform.processor()
    with suppress(OSError):  # Linux only
        text = Path("/proc/cpuinfo").read_text()
        model = next(iter(re.findall(r"model name\s*: (.*)", text)), model)
    return {**facts, PROCESSOR: f"{model} ({platform.machine()})"}


def study_digest(name: str, source: str, cases: Sequence[Case]) -> str:
    """Return a text that identifies a study: its function, source and cases."""
    digest = hashlib.sha256(f"{name}\n{source}".encode())
    for case in cases:
        digest.update(repr({key: text_of(value) for key, value in case.items()}).encode())
    return f"{name}, {len(cases)} cases, {digest.hexdigest()[:16]}"


@contextmanager
def journal_of(path: Path, study: str, done: Mapping[int, EpisodeOutcome]) -> Iterator[_Write]:
    """Create a file of a study's outcomes in the order of completion, as an Arrow IPC stream.

    The file of a killed process can be read up to the last complete row.

    Args:
        path: the file; an existing one is replaced.
        study: the study's digest.
        done: the outcomes that are already known, by the number of the case.

    Yields:
        A function that adds the outcome of a case.

    Raises:
        OneBotError: the file cannot be written.
    """
    new = path.with_name(f".{path.name}-{os.getpid()}")
    schema = _JOURNAL.with_metadata({_STUDY: study.encode()})

    def write(number: int, outcome: EpisodeOutcome) -> None:
        row = {"case": number, "row": outcome.row, ERROR: outcome.error}
        writer.write_batch(pa.RecordBatch.from_pylist([row], schema=_JOURNAL))

    with writing(path), new.open("wb", buffering=0) as file:
        with pa.ipc.new_stream(file, schema) as writer:
            for number, outcome in done.items():
                write(number, outcome)
            new.replace(path)
            yield write


def read_journal(path: Path, study: str) -> dict[int, EpisodeOutcome]:
    """Return the outcomes in a journal, by the number of the case.

    Raises:
        OneBotError: there is no journal, or it belongs to another study.
    """
    done: dict[int, EpisodeOutcome] = {}
    try:
        with path.open("rb") as file, pa.ipc.open_stream(file) as reader:
            found = (reader.schema.metadata or {}).get(_STUDY, b"").decode()
            with suppress(pa.ArrowException, OSError):  # the last row of a killed process
                for batch in reader:
                    for row in batch.to_pylist():
                        done[row["case"]] = EpisodeOutcome(row["row"], row[ERROR])
    except (pa.ArrowException, OSError) as error:
        text = f"{path} is not the journal of a study: {shortened(str(error))}"
        raise OneBotError(f"{text}; omit --resume") from None
    if found != study:
        text = f"{path} belongs to another study ({found or 'no name'}), not to {study}"
        raise OneBotError(f"{text}; remove it, or omit --resume")
    return done
