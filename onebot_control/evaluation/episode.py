"""Runs one episode in a worker: calls the function of a study for a case, and packs the outcome."""

import inspect
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache, partial
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

    def packed(self) -> bytes:
        """Pickle the work for workers; call this within ``sent_by_value``.

        Raises:
            OneBotError: the function cannot be sent.
        """
        name = getattr(self.function, "__qualname__", repr(self.function))
        return _packed(self, f"{name} cannot be sent to workers", "create what it uses inside it")


def packed_case(number: int, case: Case) -> bytes:
    """Pickle a case for workers.

    Raises:
        OneBotError: it cannot be sent.
    """
    return _packed(case, f"case {number} cannot be sent to workers", "create it in the episode")


def _packed(value: object, problem: str, remedy: str) -> bytes:
    try:
        return bytes(cloudpickle.dumps(value))
    except Exception as error:  # __reduce__ of an object may raise anything
        raise OneBotError(f"{problem}: {_shown(error)}; {remedy}") from None


@contextmanager
def sent_by_value(function: Episode) -> Iterator[None]:
    """Let pickles in this context include the function's module and the modules beside it."""
    with ExitStack() as stack:
        for module in _own_modules(function):
            cloudpickle.register_pickle_by_value(module)
            stack.callback(cloudpickle.unregister_pickle_by_value, module)
        yield


def module_of(function: Episode) -> ModuleType | None:
    """Return the module of a function or of a ``functools.partial`` of it."""
    while isinstance(function, partial):
        function = function.func
    return inspect.getmodule(function)


def _own_modules(function: Episode) -> Iterator[ModuleType]:
    """Yield the modules in the folder of the function's module, which a worker may lack."""
    module = module_of(function)
    file = getattr(module, "__file__", None)
    if module is None or file is None:
        return
    folder = Path(file).resolve().parent
    installed = {Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")}
    for other in [*sys.modules.values()]:
        name, file = getattr(other, "__name__", "__main__"), getattr(other, "__file__", None)
        if name == "__main__" or not file or name.partition(".")[0] in _PACKAGES:
            continue  # cloudpickle itself sends __main__ by value
        parents = Path(file).resolve().parents
        if folder in parents and installed.isdisjoint(parents):
            yield other


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
        return EpisodeOutcome(b"", _shown(error))


def run(work: Work, case: Case) -> EpisodeOutcome:
    """Run the episode of a case; an exception, except for Ctrl-C, becomes part of the outcome."""
    row, error = b"", None
    with _recorded(work.recorder is not None) as simulations:
        try:
            row = packed_row(work.function(Case(case)), case)
        except KeyboardInterrupt:
            raise
        except BaseException as raised:  # also sys.exit(), as nothing may end the worker
            error = _shown(raised)
        recordings = []
        if work.recorder and (work.keep == "all" or not succeeded(row, error, work.success)):
            try:
                recordings = [_recording(work.recorder, each) for each in simulations]
            except Exception as failed:  # the outcome is more important
                error = f"{error or ''} (its recording failed: {_shown(failed)})".strip()
    return EpisodeOutcome(row, error, recordings)


def succeeded(row: bytes, error: str | None, success: Sequence[str]) -> bool:
    """Return whether an episode succeeded: no error, and no ``success`` column is false."""
    if error is not None:
        return False
    returned = unpacked_row(row)
    return all(returned.get(name) is not False for name in success)


def _shown(error: BaseException) -> str:
    """Return an error as one line; a OneBotError without its type, as its text is a sentence."""
    text = ""
    with suppress(Exception):  # user code may raise anything here
        text = " ".join(text_of(error).split())
    if not isinstance(error, OneBotError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return printable(text)


@contextmanager
def _recorded(wanted: bool) -> Iterator[list[Simulation]]:
    """Record the simulations that start in this context, unless they are already recorded."""
    begun: list[Simulation] = []

    def observe(simulation: Simulation) -> None:
        if not simulation.moments:
            simulation.record(_KEPT, _KEPT_RATE)
        if not any(each is simulation for each in begun):
            begun.append(simulation)

    if wanted:
        observers.append(observe)
    try:
        yield begun
    finally:
        if wanted:
            observers.remove(observe)


def _recording(recorder: Recorder, simulation: Simulation) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "episode.rrd"
        recorder(simulation, file)
        return file.read_bytes()
