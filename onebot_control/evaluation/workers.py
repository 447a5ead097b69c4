"""Runs the episodes of a study in processes of this computer, each reused for many episodes."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Future,
    ThreadPoolExecutor,
    TimeoutError,
    wait,
)
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from typing import Any, TypeAlias
from unittest.mock import patch

from pebble import ProcessExpired, ProcessPool

from onebot_control.evaluation.episode import run_packed, unpacked
from onebot_control.evaluation.rows import EpisodeOutcome, Outcomes
from onebot_description.errors import OneBotError

DIED = "its worker died twice: killed, out of memory, or a crash in compiled code"
_CHECK = 0.5  # s between checks of a pool that may have ended
_MAX_BROKEN = 100  # maximum number of consecutive processes that end before they run anything
_Future: TypeAlias = "Future[EpisodeOutcome]"
_starting = threading.Lock()


class _Process(SpawnProcess):
    """A process that does not import the script of the study, and whose numpy has no threads.

    A script that calls ``evaluate`` would do so again in each process; the required parts of it are
    sent by value.
    """

    @property
    def exitcode(self) -> int | None:
        """The exit code, but never 0, as pebble would then wait for the episode forever."""
        code = super().exitcode
        return 1 if code == 0 else code

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Any:
        from onebot_description.ros.process_start import blas_variables

        main = sys.modules["__main__"]
        as_no_script = patch.multiple(main, create=True, __file__=None, __spec__=None)
        with _starting, as_no_script, _ctrl_c_blocked():
            os.environ.update(added := blas_variables())
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                for name in added:
                    del os.environ[name]


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Block Ctrl-C in this thread, and so in processes that it starts; Windows cannot."""
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


def _start(packed: bytes) -> None:
    global _packed
    _packed = packed
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    _take_domain()
    with suppress(Exception):  # the first episode reports it
        unpacked(packed)  # now, so that imports do not count as an episode's time


def _take_domain() -> None:
    """Give this process a separate ROS domain, for nodes in lockstep."""
    if sys.platform != "linux":
        return  # there, an installed ROS uses the domain of the environment
    from onebot_description.ros.domains import used_domain

    try:
        _stack.enter_context(used_domain())
    except OneBotError as error:  # episodes without ROS need no domain
        os.environ["ROS_DOMAIN_ID"] = str(error)


def _run(case: bytes) -> EpisodeOutcome:
    return run_packed(_packed, case)


class Worker:
    """A process that runs episodes, one at a time, and is replaced when it ends.

    Each worker has a separate pool, so that a process that is killed while it holds a lock of its
    pool cannot stop the others.
    """

    def __init__(self, packed: bytes) -> None:
        """Start without a process; the first episode starts it.

        Args:
            packed: the work.
        """
        self._packed, self._is_open, self._lock = packed, True, threading.Lock()
        self._pool = self._new_pool()

    def run(self, case: bytes, timeout: float) -> EpisodeOutcome:
        """Run an episode, and once more if the process dies.

        Args:
            case: the packed case.
            timeout: s of wall time after which the episode is ended.

        Raises:
            OneBotError: processes end before they run anything.
        """
        died = False
        for _ in range(_MAX_BROKEN):
            try:
                return self._outcome(case, timeout)
            except TimeoutError:
                return EpisodeOutcome(b"", f"it took longer than {timeout:g} s, and was ended")
            except ProcessExpired:
                if died:
                    return EpisodeOutcome(b"", DIED)
                died = True
            except RuntimeError:  # the pool is broken: the process died before the episode
                pass
            self._replace_pool()
        raise OneBotError("the workers end before they run an episode")

    def _outcome(self, case: bytes, timeout: float) -> EpisodeOutcome:
        future = self._pool.schedule(_run, (case,), timeout=timeout)
        while not wait([future], _CHECK).done:
            if not self._pool.active:
                raise RuntimeError
        return future.result()

    def _replace_pool(self) -> None:
        with self._lock:
            if not self._is_open:
                raise CancelledError
            self._end_pool()
            self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPool:
        context: Any = _Context()  # pebble's types only accept the contexts of multiprocessing
        return ProcessPool(1, initializer=_start, initargs=(self._packed,), context=context)

    def _end_pool(self) -> None:
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._is_open = False
            self._end_pool()


def run_in_processes(
    packed: bytes, cases: Iterator[tuple[int, bytes]], count: int, timeout: float
) -> Outcomes:
    """Run episodes in processes of this computer; yield their outcomes as they end.

    Args:
        packed: the work.
        cases: numbers and packed cases.
        count: number of processes.
        timeout: s of wall time after which an episode is ended.
    """
    workers, idle = [Worker(packed) for _ in range(count)], SimpleQueue[Worker]()
    for worker in workers:
        idle.put(worker)

    def run(case: bytes) -> EpisodeOutcome:
        worker = idle.get()
        try:
            return worker.run(case, timeout)
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(count) as threads:
        try:
            for number, future in as_they_come(
                lambda case: threads.submit(run, case), cases, count
            ):
                yield number, future.result()
        finally:
            with ThreadPoolExecutor(count) as closing:  # all at once: some may take seconds
                closing.map(Worker.close, workers)


def as_they_come(
    submit: Callable[[bytes], _Future], cases: Iterator[tuple[int, bytes]], limit: int
) -> Iterator[tuple[int, _Future]]:
    """Keep up to ``limit`` cases running; yield the numbers and futures of finished ones."""
    running: dict[_Future, int] = {}
    while True:
        while len(running) < limit and (task := next(cases, None)):
            running[submit(task[1])] = task[0]
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future
