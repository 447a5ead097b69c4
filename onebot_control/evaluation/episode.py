"""Runs one episode in a worker: calls the function of a study for a case, and packs the outcome."""

import inspect
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, NamedTuple

import cloudpickle

from onebot_control.evaluation.cases import Case
from onebot_control.evaluation.rows import EpisodeOutcome, packed_row, text_of, unpacked_row
from onebot_control.simulation import Simulation, observers
from onebot_description.errors import OneBotError, printable

Episode = Callable[[Case], Mapping[str, Any] | None]
Recorder = Callable[[Simulation, Path], object]

_KEPT, _KEPT_RATE = 60.0, 20.0  # recorded part of an episode: last simulated s, and rate, Hz
_PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")


class Work(NamedTuple):
    """The work of the workers, for each case.

    Attributes:
        function: the episode.
        success: columns that are false in an unsuccessful episode.
        recorder: writes the recording of a simulation to a file; None for no recordings.
        keep: which episodes are recorded, "all" or "failed".
    """

    function: Episode
    success: Sequence[str] = ()
    recorder: Recorder | None = None
    keep: str = "failed"


def packed(value: object, what: str) -> bytes:
    """Pickle the work or a case for workers; ``what`` is its name in errors.

    Raises:
        OneBotError: it cannot be sent.
    """
    try:
        return bytes(cloudpickle.dumps(value))
    except Exception as error:  # __reduce__ of an object may raise anything
        text = f"{what} cannot be sent to workers: {sentence(error)}"
        raise OneBotError(f"{text}; create in the episode what it needs") from None


def module_of(function: Episode) -> ModuleType | None:
    """Return the module of a function or of a ``functools.partial`` of it."""
    return inspect.getmodule(getattr(function, "func", function))


def send_by_value(function: Episode) -> None:
    """Let pickles include the function's module and those in its folder, which a worker may lack.

    Cloudpickle itself includes ``__main__``.
    """
    file = getattr(module_of(function), "__file__", None)
    if file is None:
        return
    folder = Path(file).resolve().parent
    installed = {Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")}
    for name, module in [*sys.modules.items()]:
        parents = Path(getattr(module, "__file__", None) or "").resolve().parents
        is_own = folder in parents and installed.isdisjoint(parents)
        if is_own and name.partition(".")[0] not in ("__main__", *_PACKAGES):
            cloudpickle.register_pickle_by_value(module)


@lru_cache(maxsize=1)
def unpacked(packed: bytes) -> Work:
    """Return the work; all episodes of a worker share its objects, so globals persist."""
    work: Work = cloudpickle.loads(packed)
    return work


def run_packed(packed: bytes, case: bytes) -> EpisodeOutcome:
    """Run the episode of a packed case with packed work."""
    try:
        return run(unpacked(packed), cloudpickle.loads(case))
    except (Exception, KeyboardInterrupt) as error:  # user code may raise anything
        return EpisodeOutcome(b"", sentence(error))


def run(work: Work, case: Case) -> EpisodeOutcome:
    """Run the episode of a case; an exception, except for Ctrl-C, becomes part of the outcome."""
    row, error, recording = b"", None, b""
    with _recorded(work.recorder is not None) as simulations:
        try:
            row = packed_row(work.function(Case(case)), case)
        except KeyboardInterrupt:
            raise
        except BaseException as raised:  # also sys.exit(), as nothing may end the worker
            error = sentence(raised)
        is_wanted = work.keep == "all" or not succeeded(row, error, work.success)
        if work.recorder and simulations and is_wanted:
            try:
                recording = _recording(work.recorder, simulations[0])
            except (OSError, OneBotError) as raised:  # such as a full disk; the row stays
                error = error or f"its recording failed: {sentence(raised)}"
    return EpisodeOutcome(row, error, recording)


def succeeded(row: bytes, error: str | None, success: Sequence[str]) -> bool:
    """Return whether an episode succeeded: no error, and no ``success`` column is false."""
    returned = unpacked_row(row)
    return error is None and all(returned.get(name) is not False for name in success)


def sentence(error: BaseException) -> str:
    """Return an error as one line; a OneBotError without its type, as its text is a sentence."""
    text = printable(" ".join(text_of(error).split()))
    if isinstance(error, OneBotError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextmanager
def _recorded(wanted: bool) -> Iterator[Sequence[Simulation]]:
    """If wanted, record the simulations that start in this context, unless already recorded.

    Yields:
        The one that started last.
    """
    begun: list[Simulation] = []

    def observe(simulation: Simulation) -> None:
        begun[:] = [simulation]
        if wanted and not simulation.moments:
            simulation.record(_KEPT, _KEPT_RATE)

    observers.append(observe)
    try:
        yield begun
    finally:
        observers.remove(observe)


def _recording(recorder: Recorder, simulation: Simulation) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "episode.rrd"
        recorder(simulation, file)
        return file.read_bytes()
