"""Rows of a study: packed by workers, written to a journal, and combined in a table."""

import hashlib
import json
import os
import platform
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from onebot_control.evaluation.cases import ERROR, Case
from onebot_description.errors import OneBotError, shortened
from onebot_description.parameters.values import plain

_UNFIT = (pa.ArrowException, OverflowError, UnicodeError)
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")  # differs from process to process
_PACKAGES = ("onebot-robots", "numpy", "pybullet", "pybullet-arm64", "embreex", "pyarrow")
_JOURNAL = pa.schema([("case", pa.int64()), ("row", pa.binary()), (ERROR, pa.string())])
_STUDY = b"study"


class EpisodeOutcome(NamedTuple):
    """The outcome of an episode: its packed return value or an error, and its recordings."""

    row: bytes
    error: str | None
    recordings: Sequence[bytes] = ()


Outcomes = Generator[tuple[int, EpisodeOutcome], None, None]
"""The numbers and outcomes of cases, in the order of completion; closing it ends the episodes."""


def packed_row(returned: object, case: Case) -> bytes:
    """Pack the return value of an episode as the stream of an Arrow table with one row.

    Raises:
        OneBotError: it is not a mapping from names to valid cells, or it has another value for a
            column of the case.
    """
    if returned is None:
        returned = {}
    if not isinstance(returned, Mapping):
        text = f"the episode returned {shortened(repr(returned))}"
        raise OneBotError(f'{text}; return a mapping, such as {{"reached": True}}')
    row = {}
    for name, value in returned.items():
        if not isinstance(name, str) or name in ("", ERROR):
            raise OneBotError(f"the episode returned {name!r}, which cannot name a column")
        if name in case:
            if case[name] is not value and case[name] != value:
                raise OneBotError(f'the episode returned "{name}", which is a column of the case')
            continue
        row[name] = _plain(value)
        with suppress(*_UNFIT):
            pa.array([row[name]])
            continue
        text = f'the episode returned "{name}": {shortened(repr(value))}'
        raise OneBotError(f"{text}, which cannot be a cell")
    table, sink = pa.Table.from_pylist([row]), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


def unpacked_row(row: bytes) -> dict[str, Any]:
    """Return the row packed by ``packed_row``; empty bytes are an empty row."""
    values = pa.ipc.open_stream(row).read_all().to_pylist() if row else []
    return dict(values[0]) if values else {}


def _plain(value: Any) -> Any:
    """Convert numpy arrays and scalars, sets and paths in a value to plain Python values."""
    value = plain(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | set | frozenset):
        return [*map(_plain, value if isinstance(value, list) else sorted(value, key=repr))]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def table_of(
    cases: Sequence[Case], outcomes: Sequence[EpisodeOutcome], facts: Mapping[str, Any]
) -> pa.Table:
    """Return the table of a study: the columns of cases and returned mappings, then ``error``.

    Types are determined from all values together, regardless of their order. The values of a column
    without a common type are converted to text.

    Args:
        cases: the cases.
        outcomes: the outcome of each case.
        facts: values for the metadata of the table.
    """
    columns: dict[str, list[Any]] = {}
    for number, (case, outcome) in enumerate(zip(cases, outcomes, strict=True)):
        for name, value in {**_plain(case), **unpacked_row(outcome.row)}.items():
            columns.setdefault(name, [None] * len(cases))[number] = value
    arrays = {name: _column(values) for name, values in columns.items()}
    arrays[ERROR] = pa.array([outcome.error for outcome in outcomes], pa.string())
    texts = {name: json.dumps(value) for name, value in facts.items()}
    return pa.table(arrays).replace_schema_metadata(texts)


def _column(values: Sequence[Any]) -> pa.Array:
    with suppress(*_UNFIT):
        return pa.array(values)
    return pa.array([None if value is None else text_of(value) for value in values])


def text_of(value: object) -> str:
    """Return a value as text that is the same in every process."""
    return getattr(value, "__qualname__", None) or _ADDRESS.sub("", str(value))


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
    models = []
    with suppress(OSError):  # Linux only
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        models = [line.partition(": ")[2] for line in lines if line.startswith("model name")]
    facts["processor"] = f"{next(iter(models), platform.processor())} ({platform.machine()})"
    return facts


def study_digest(name: str, source: str, cases: Sequence[Case]) -> str:
    """Return a text that identifies a study: its function, source and cases."""
    digest = hashlib.sha256(f"{name}\n{source}".encode())
    for case in cases:
        digest.update(repr({key: text_of(value) for key, value in case.items()}).encode())
    return f"{name}, {len(cases)} cases, {digest.hexdigest()[:16]}"


class Journal(AbstractContextManager["Journal"]):
    """A file of a study's outcomes in the order of completion, as an Arrow IPC stream.

    The file of a killed process can be read up to the last complete row.
    """

    def __init__(self, path: Path, study: str, done: Mapping[int, EpisodeOutcome]) -> None:
        """Create the journal, with the outcomes that are already known.

        Raises:
            OneBotError: it cannot be written.
        """
        self.path, new = path, path.with_name(f".{path.name}-{os.getpid()}")
        schema = _JOURNAL.with_metadata({_STUDY: study.encode()})
        try:
            self._file = new.open("wb")
            self._writer = pa.ipc.new_stream(self._file, schema)
            for number, outcome in done.items():
                self.write(number, outcome)
            new.replace(path)
        except OSError as error:
            raise OneBotError(f"{path} cannot be written: {error.strerror}") from None

    def write(self, number: int, outcome: EpisodeOutcome) -> None:
        """Add the outcome of a case.

        Raises:
            OneBotError: it cannot be written.
        """
        row = {"case": number, "row": outcome.row, ERROR: outcome.error}
        try:
            self._writer.write_batch(pa.RecordBatch.from_pylist([row], schema=_JOURNAL))
            self._file.flush()
        except OSError as error:
            raise OneBotError(f"{self.path} cannot be written: {error.strerror}") from None

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # the disk is full, as reported before
            self._writer.close()
            self._file.close()


def read_journal(path: Path, study: str) -> dict[int, EpisodeOutcome]:
    """Return the outcomes in a journal, by the number of the case.

    Raises:
        OneBotError: there is no journal, or it belongs to another study.
    """
    done: dict[int, EpisodeOutcome] = {}
    try:
        with path.open("rb") as file, pa.ipc.open_stream(file) as reader:
            found = (reader.schema.metadata or {}).get(_STUDY, b"").decode()
            if found != study:
                text = f"{path} belongs to another study ({found or 'no name'}), not to {study}"
                raise OneBotError(f"{text}; remove it, or omit --resume")
            with suppress(pa.ArrowException, OSError):  # the last row of a killed process
                for batch in reader:
                    done |= {
                        row["case"]: EpisodeOutcome(row["row"], row[ERROR])
                        for row in batch.to_pylist()
                    }
    except FileNotFoundError:
        raise OneBotError(f"there is no journal {path} to resume; omit --resume") from None
    except (pa.ArrowException, OSError) as error:
        text = f"{path} is not the journal of a study: {shortened(str(error))}"
        raise OneBotError(text) from None
    return done
