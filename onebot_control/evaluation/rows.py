"""Rows of a study: packed by workers, journalled as they come, and put together as a table."""

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
    """What comes of an episode: what it returned, packed, or an error; and its recordings."""

    row: bytes
    error: str | None
    recordings: Sequence[bytes] = ()


Outcomes = Generator[tuple[int, EpisodeOutcome], None, None]
"""The outcomes of cases by their numbers, as they come; it is closed to end the episodes."""


def packed_row(returned: object, case: Case) -> bytes:
    """Return what an episode has returned, as the stream of an Arrow table with one row.

    Raises:
        OneBotError: it is not a mapping from names to what can be a cell, or it has another value
            for a column of the case.
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
        raise OneBotError(f'the episode returned "{name}": {shortened(repr(value))}; no such cell')
    table, sink = pa.Table.from_pylist([row]), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return bytes(sink.getvalue())


def unpacked_row(row: bytes) -> dict[str, Any]:
    """Return what ``packed_row`` has packed; nothing of an empty row."""
    values = pa.ipc.open_stream(row).read_all().to_pylist() if row else []
    return dict(values[0]) if values else {}


def _plain(value: Any) -> Any:
    """Return a value with numpy's arrays and scalars, and containers, as Python's."""
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

    Types depend on all values together, so not on which row came first. A column whose values have
    no common type has them as text.

    Args:
        cases: the cases.
        outcomes: what came of each.
        facts: what the metadata of the table records.
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
    """Return a value as text that is the same in each process."""
    return getattr(value, "__qualname__", None) or _ADDRESS.sub("", str(value))


def fact_of(table: pa.Table, name: str) -> Any:
    """Return one of the facts in the metadata of a table; None if it has none."""
    text = (table.schema.metadata or {}).get(name.encode())
    return None if text is None else json.loads(text)


def machine_facts() -> dict[str, str]:
    """Return the versions of what computes an episode, and the processor it runs on."""
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
    """The outcomes of a study on disk as they come, in an Arrow IPC stream.

    What a killed process has left can be read up to the last whole row.
    """

    def __init__(self, path: Path, study: str, done: Mapping[int, EpisodeOutcome]) -> None:
        """Begin a journal with what is done already.

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
        with suppress(OSError):  # the disk is full, which has been reported
            self._writer.close()
            self._file.close()


def read_journal(path: Path, study: str) -> dict[int, EpisodeOutcome]:
    """Return the outcomes in a journal, by the number of the case.

    Raises:
        OneBotError: there is none, or it is of another study.
    """
    done: dict[int, EpisodeOutcome] = {}
    try:
        with path.open("rb") as file, pa.ipc.open_stream(file) as reader:
            found = (reader.schema.metadata or {}).get(_STUDY, b"").decode()
            if found != study:
                text = f"{path} is of another study ({found or 'no name'}), not of {study}"
                raise OneBotError(f"{text}; remove it, or leave out --resume")
            with suppress(pa.ArrowException, OSError):  # the last row of a killed process
                for batch in reader:
                    done |= {
                        row["case"]: EpisodeOutcome(row["row"], row[ERROR])
                        for row in batch.to_pylist()
                    }
    except FileNotFoundError:
        raise OneBotError(f"there is no journal {path} to resume; leave out --resume") from None
    except (pa.ArrowException, OSError) as error:
        raise OneBotError(f"{path} is no journal of a study: {shortened(str(error))}") from None
    return done
