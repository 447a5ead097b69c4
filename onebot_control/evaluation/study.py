"""``evaluate``: runs an episode for each case of a study, and returns a table of the results."""

import inspect
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Annotated, Any

import cloudpickle
import pyarrow as pa

from onebot_control.evaluation.cases import Case, checked_cases
from onebot_control.evaluation.episode import (
    Episode,
    Recorder,
    Work,
    module_of,
    packed,
    run,
    send_by_value,
    succeeded,
)
from onebot_control.evaluation.report import Progress
from onebot_control.evaluation.rows import (
    Outcomes,
    journal_of,
    machine_facts,
    read_journal,
    study_digest,
    table_of,
)
from onebot_control.evaluation.workers import run_in_processes
from onebot_description.atomic_write import writing
from onebot_description.errors import OneBotError
from onebot_description.parameters.arguments import checked
from onebot_description.parameters.values import Rule

SUCCESS = ("reached", "success")
"""Columns that, if returned by episodes, are false in an unsuccessful episode."""


@checked
def evaluate(
    function: Episode,
    cases: Iterable[Mapping[str, Any]],
    workers: Annotated[int, Rule(at_least=0, at_most=10_000)] | None = None,
    *,
    on: Annotated[str, Rule(choices=("processes", "ray"))] = "processes",
    timeout: Annotated[float, Rule(above=0.0, infinite=True)] = 600.0,
    success: Sequence[str] = SUCCESS,
    journal: str | Path | None = None,
    resume: bool = False,
    recorder: Recorder | None = None,
    recordings: str | Path = "recordings",
    keep: Annotated[str, Rule(choices=("all", "failed"))] = "failed",
    progress: bool | None = None,
) -> pa.Table:
    """Run a function for each case, and return a table with one row per case, in the same order.

    The table is bit-identical for any number of processes or nodes, if they have the same type of
    processor. An episode that raises, times out or kills its worker twice becomes a row with an
    error. The function and the modules beside it are sent to the workers by value; a worker runs
    many episodes, so the function's globals persist between them.

    Args:
        function: the episode. It receives the case, and returns a mapping from names to numbers,
            strings, booleans or lists of these, which becomes a row; or None for no columns.
        cases: one mapping per case, such as ``grid(seed=range(100))``.
        workers: number of concurrent episodes; None for one per processor, 0 to run them in this
            process, one after another and without a timeout.
        on: "processes" for processes of this computer, or "ray" for a Ray cluster, to which this
            process then stays connected.
        timeout: s of wall time after which an episode is ended.
        success: columns that are false in an unsuccessful episode.
        journal: a file to which each row is written at once; None for no journal.
        resume: continue from the rows in the journal.
        recorder: writes the recording of a simulation to a file (.rrd); None for no recordings.
        recordings: folder of the recordings, which are named after the number of the case.
        keep: which episodes are recorded, "all" or "failed".
        progress: show the progress on stderr; None: only on a terminal.

    Returns:
        The columns of the cases, those of the returned mappings, and ``error``, None or a sentence.
        The metadata contains the versions, the processor and the factors.

    Raises:
        OneBotError: cases, function, journal or cluster cannot be used.
        KeyboardInterrupt: Ctrl-C was pressed; the journal contains the finished episodes.
    """
    listed = checked_cases(cases)
    if resume and journal is None:
        raise OneBotError("resume: there is no journal to continue from; write journal=FILE")
    name = getattr(function, "__qualname__", type(function).__name__)
    study = study_digest(name, _source(function), listed)
    done = read_journal(Path(journal), study) if journal is not None and resume else {}
    send_by_value(function)
    work = Work(function, tuple(success), recorder, keep)
    pending = ((n, packed(case, f"case {n}")) for n, case in enumerate(listed) if n not in done)
    is_shown = sys.stderr.isatty() if progress is None else progress
    with ExitStack() as stack:
        write = journal and stack.enter_context(journal_of(Path(journal), study, done))
        if is_shown:
            print(f"running {len(listed) - len(done)} episodes on {on} ...", file=sys.stderr)
        count = workers and min(workers, len(listed))
        facts, outcomes = _started(on, work, pending, count, timeout)
        stack.enter_context(closing(outcomes))
        bar = Progress(len(listed), len(done)) if is_shown else None
        for number, outcome in outcomes:
            done[number] = outcome._replace(recording=b"")
            if write:
                write(number, outcome)
            if recorder:
                _write_recording(Path(recordings, f"{number}.rrd"), outcome.recording)
            if bar:
                bar.add(succeeded(outcome.row, outcome.error, success), number, outcome.error)
    facts |= {"study": name, "success": success, "factors": _factors(listed)}
    return table_of(listed, [done[number] for number in range(len(listed))], facts)


def _started(
    on: str, work: Work, cases: Iterator[tuple[int, bytes]], workers: int | None, timeout: float
) -> tuple[dict[str, Any], Outcomes]:
    """Return facts about the computers, and the outcomes of the episodes as they end."""
    if workers == 0:  # one after another, for example for a debugger
        return machine_facts(), ((n, run(work, cloudpickle.loads(case))) for n, case in cases)
    sent = packed(work, "the episode")
    if on == "processes":
        count = workers or _processors()
        return machine_facts(), run_in_processes(sent, cases, count, timeout)
    try:
        from onebot_control.evaluation import on_ray
    except ModuleNotFoundError:
        raise OneBotError("Ray is not installed: pip install 'onebot-robots[cluster]'") from None
    return on_ray.connected(sent), on_ray.run_on_ray(sent, cases, workers, timeout)


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):  # Linux; a container may be limited to a few
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _factors(cases: Sequence[Case]) -> list[str]:
    """Return the names of the values that differ among the cases."""
    names = dict.fromkeys(name for case in cases for name in case)
    return [name for name in names if len({repr(case.get(name)) for case in cases}) > 1]


def _source(function: Episode) -> str:
    """Return the source of the function's module, or of the function in a notebook, or ""."""
    for what in (module_of(function), function):
        with suppress(OSError, TypeError):  # there is none
            return inspect.getsource(what)  # type: ignore[arg-type] # None is a TypeError
    return ""


def _write_recording(file: Path, recording: bytes) -> None:
    with writing(file):
        file.unlink(missing_ok=True)  # left by an earlier run
        if recording:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(recording)
