"""One episode in a worker: the function of a study is run for a case; this is what comes of it."""

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

_KEPT, _KEPT_RATE = 60.0, 20.0  # how much of an episode is recorded: simulated s, and Hz
_PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")


class Work(NamedTuple):
    """What workers do for each case.

    Attributes:
        function: the episode.
        success: columns that are false in an episode without success.
        recorder: writes the recording of a simulation to a file; None if none is kept.
        keep: which episodes are recorded, "all" or "failed".
    """

    function: Episode
    success: Sequence[str] = ()
    recorder: Recorder | None = None
    keep: str = "failed"

    def packed(self) -> bytes:
        """Return it for workers, within ``sent_by_value``.

        Raises:
            OneBotError: the function cannot be sent.
        """
        name = getattr(self.function, "__qualname__", repr(self.function))
        return _packed(self, f"{name} cannot be sent to workers", "make what it uses within it")


def packed_case(number: int, case: Case) -> bytes:
    """Return a case for workers.

    Raises:
        OneBotError: it cannot be sent.
    """
    return _packed(case, f"case {number} cannot be sent to workers", "let the episode make that")


def _packed(value: object, problem: str, remedy: str) -> bytes:
    try:
        return bytes(cloudpickle.dumps(value))
    except Exception as error:  # whatever __reduce__ of an object raises
        raise OneBotError(f"{problem}: {_shown(error)}; {remedy}") from None


@contextmanager
def sent_by_value(function: Episode) -> Iterator[None]:
    """Have what is packed in this context hold the function's module and those beside it."""
    with ExitStack() as stack:
        for module in _own_modules(function):
            cloudpickle.register_pickle_by_value(module)
            stack.callback(cloudpickle.unregister_pickle_by_value, module)
        yield


def module_of(function: Episode) -> ModuleType | None:
    """Return the module of a function, also of a ``functools.partial`` of it."""
    while isinstance(function, partial):
        function = function.func
    return inspect.getmodule(function)


def _own_modules(function: Episode) -> Iterator[ModuleType]:
    """Yield the modules that a worker may lack: those in the folder of the function's module."""
    module = module_of(function)
    file = getattr(module, "__file__", None)
    if module is None or file is None:
        return
    folder = Path(file).resolve().parent
    installed = {Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")}
    for other in [*sys.modules.values()]:
        name, file = getattr(other, "__name__", "__main__"), getattr(other, "__file__", None)
        if name == "__main__" or not file or name.partition(".")[0] in _PACKAGES:
            continue  # cloudpickle itself takes __main__ by value
        parents = Path(file).resolve().parents
        if folder in parents and installed.isdisjoint(parents):
            yield other


@lru_cache(maxsize=1)
def unpacked(packed: bytes) -> Work:
    """Return the work, the same objects for all episodes of a worker: globals stay."""
    work: Work = cloudpickle.loads(packed)
    return work


def run_packed(packed: bytes, case: bytes) -> EpisodeOutcome:
    """Run the episode of a packed case by packed work."""
    try:
        return run(unpacked(packed), cloudpickle.loads(case))
    except (Exception, KeyboardInterrupt) as error:  # its own code may raise anything
        return EpisodeOutcome(b"", _shown(error))


def run(work: Work, case: Case) -> EpisodeOutcome:
    """Run the episode of a case; what it raises is an outcome, too, except by Ctrl-C."""
    row, error = b"", None
    with _recorded(work.recorder is not None) as simulations:
        try:
            row = packed_row(work.function(Case(case)), case)
        except KeyboardInterrupt:
            raise
        except BaseException as raised:  # also sys.exit(); nothing may end the worker
            error = _shown(raised)
        recordings = []
        if work.recorder and (work.keep == "all" or not succeeded(row, error, work.success)):
            try:
                recordings = [_recording(work.recorder, each) for each in simulations]
            except Exception as failed:  # the outcome is more important
                error = f"{error or ''} (its recording failed: {_shown(failed)})".strip()
    return EpisodeOutcome(row, error, recordings)


def succeeded(row: bytes, error: str | None, success: Sequence[str]) -> bool:
    """Return whether an episode had success: no error, and none of its columns is false."""
    if error is not None:
        return False
    returned = unpacked_row(row)
    return all(returned.get(name) is not False for name in success)


def _shown(error: BaseException) -> str:
    """Return an error as one line; a OneBotError by its text, as it is a sentence."""
    text = ""
    with suppress(Exception):  # its own code may raise anything here
        text = " ".join(text_of(error).split())
    if not isinstance(error, OneBotError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return printable(text)


@contextmanager
def _recorded(wanted: bool) -> Iterator[list[Simulation]]:
    """Record the simulations that begin in this context, unless they are recorded already."""
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
