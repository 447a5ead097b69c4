"""Runs the episodes of a study in processes of this computer, each kept for many episodes."""

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, InvalidStateError, TimeoutError, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple
from unittest.mock import patch

from pebble import ProcessExpired, ProcessPool

from onebot_control.evaluation.episode import run_packed, unpacked
from onebot_control.evaluation.rows import EpisodeOutcome, Outcomes, machine_facts
from onebot_description.errors import OneBotError

DIED = "its worker died twice: killed, out of memory, or a crash in compiled code"
_CHECK = 1.0  # s between checks of pools that may have ended
_MOST_BROKEN = 100  # processes in a row that end before they run anything
_starting = threading.Lock()


class _Process(SpawnProcess):
    """A process that does not import the script of the study, and whose numpy has no threads.

    A script that calls ``evaluate`` would do so again in each process; what is needed of it comes
    by value.
    """

    @property
    def exitcode(self) -> int | None:
        """The exit code; never 0, with which pebble would wait for the episode that has exited."""
        code = super().exitcode
        return 1 if code == 0 else code

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:
        from onebot_description.ros.process_start import blas_variables

        added, main = blas_variables(), sys.modules["__main__"]
        hidden = patch.multiple(main, create=True, __file__=None, __spec__=None)
        with _starting, hidden, _interrupts_blocked():
            os.environ.update(added)
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                for name in added:
                    del os.environ[name]


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in this thread, and so in processes that it starts, from their beginning."""
    if sys.platform == "win32":
        yield
        return
    former_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former_mask)


class _Context(SpawnContext):
    Process = _Process


_stack = ExitStack()  # resources that a worker holds until it ends
_packed = b""  # the work of this worker


def prepare_worker() -> None:
    """Give this process a ROS domain of its own, for nodes in lockstep."""
    if sys.platform != "linux":
        return  # there, an installed ROS has the domain of the environment
    from onebot_description.ros.domains import used_domain

    try:
        _stack.enter_context(used_domain())
    except OneBotError as error:  # pure episodes need none
        os.environ["ROS_DOMAIN_ID"] = str(error)


def _start(packed: bytes) -> None:
    global _packed
    _packed = packed
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    prepare_worker()
    with suppress(Exception):  # it is reported by the first episode
        unpacked(packed)  # now, as imports are no part of an episode's time


def _run(case: bytes) -> EpisodeOutcome:
    return run_packed(_packed, case)


class _Task(NamedTuple):
    number: int
    case: bytes
    died: bool = False  # whether a worker has died of it


class Processes:
    """Processes of this computer.

    Each has its own pool, so that one that is killed while it holds a lock of its pool cannot
    stop the others.

    Attributes:
        facts: what is recorded of this computer.
    """

    def __init__(self, packed: bytes, workers: int | None) -> None:
        """Choose how many.

        Args:
            packed: the work.
            workers: how many processes; None for one on each processor.
        """
        self._packed, self._count = packed, workers or _processors()
        self.facts = machine_facts()

    def run(self, cases: Iterator[tuple[int, bytes]], timeout: float) -> Outcomes:
        """Run episodes; yield their outcomes as they come.

        Args:
            cases: numbers and packed cases.
            timeout: s of wall time, after which an episode is ended.
        """
        return _run_all(self._packed, cases, self._count, timeout)


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):  # Linux; a container may have fewer than the computer
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _run_all(
    packed: bytes, cases: Iterator[tuple[int, bytes]], workers: int, timeout: float
) -> Outcomes:
    idle = [_pool(packed) for _ in range(workers)]
    running: dict[Future[EpisodeOutcome], tuple[ProcessPool, _Task]] = {}
    retries, broken = deque[_Task](), 0
    try:
        while True:
            while idle and (task := retries.popleft() if retries else _next(cases)):
                pool = idle.pop()
                with suppress(RuntimeError):  # the process died while it was idle
                    running[pool.schedule(_run, (task.case,), timeout=timeout)] = pool, task
                    continue
                _end([pool])
                idle.append(_pool(packed))
                retries.append(task)
            if not running:
                return
            for future in wait(running, _CHECK, FIRST_COMPLETED).done:
                pool, task = running.pop(future)
                outcome = None
                try:
                    outcome = future.result()
                except TimeoutError:
                    outcome = too_long(timeout)
                except (ProcessExpired, BrokenProcessPool) as error:
                    _end([pool])
                    pool = _pool(packed)
                    ran = isinstance(error, ProcessExpired)  # otherwise it died before the episode
                    broken += not ran
                    if ran and task.died:
                        outcome = EpisodeOutcome(b"", DIED)
                    else:
                        retries.append(task._replace(died=task.died or ran))
                idle.append(pool)
                if outcome is not None:
                    broken = 0
                    yield task.number, outcome
                if broken > _MOST_BROKEN:
                    raise OneBotError("the workers end before they run an episode")
            for future, (pool, _) in running.items():
                if not pool.active:
                    with suppress(InvalidStateError):  # it has just got its result
                        future.set_exception(BrokenProcessPool())
    finally:
        _end([*idle, *(pool for pool, _ in running.values())])


def _pool(packed: bytes) -> ProcessPool:
    context: Any = _Context()  # pebble's types know the contexts of multiprocessing only
    return ProcessPool(1, initializer=_start, initargs=(packed,), context=context)


def _next(cases: Iterator[tuple[int, bytes]]) -> _Task | None:
    case = next(cases, None)
    return None if case is None else _Task(*case)


def too_long(timeout: float) -> EpisodeOutcome:
    """Return the outcome of an episode that was ended."""
    return EpisodeOutcome(b"", f"it took longer than {timeout:g} s, and was ended")


def _end(pools: list[ProcessPool]) -> None:
    for pool in pools:
        pool.stop()  # type: ignore[no-untyped-call]
    for pool in pools:
        pool.join()
