"""Runs the episodes of a study in processes of this computer, each reused for many episodes."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, TimeoutError, wait
from contextlib import ExitStack, suppress
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from typing import Any
from unittest.mock import patch

from pebble import ProcessExpired, ProcessPool

from onebot_control.evaluation.episode import run_packed, unpacked
from onebot_control.evaluation.rows import EpisodeOutcome, Outcomes
from onebot_description.errors import OneBotError

DIED = "its worker died twice: killed, out of memory, or a crash in compiled code"
_CHECK = 0.5  # s between checks of a pool that may have ended
_MAX_BROKEN = 100  # maximum number of processes that end before they run an episode
_starting = threading.Lock()
_stack = ExitStack()  # resources that a worker holds until it ends


class _Process(SpawnProcess):
    """A process that does not import the script of the study.

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
        main = sys.modules["__main__"]
        with _starting, patch.multiple(main, create=True, __file__=None, __spec__=None):
            if sys.platform != "win32":  # the process inherits that this thread ignores Ctrl-C
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            return SpawnProcess._Popen(process_obj)


class _Context(SpawnContext):
    Process = _Process


def _start(packed: bytes) -> None:
    from onebot_description.ros.domains import used_domain

    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    if sys.platform == "linux":  # elsewhere, an installed ROS uses the domain of the environment
        try:
            _stack.enter_context(used_domain())
        except OneBotError as error:  # episodes without ROS need no domain
            os.environ["ROS_DOMAIN_ID"] = str(error)
    with suppress(Exception):  # the first episode reports it
        unpacked(packed)  # now, so that imports do not count as an episode's time


class Worker:
    """A process that runs episodes, one at a time, and is replaced when it ends.

    Each worker has a separate pool, so that a process that is killed while it holds a lock of its
    pool cannot stop the others.
    """

    def __init__(self, packed: bytes, ended: threading.Event) -> None:
        """Start without a process; the first episode starts it.

        Args:
            packed: the work.
            ended: ends an episode when it is set.
        """
        self._packed, self._ended = packed, ended
        self._open()

    def _open(self) -> None:
        context: Any = _Context()  # pebble's types only accept the contexts of multiprocessing
        self._pool = ProcessPool(1, initializer=_start, initargs=(self._packed,), context=context)

    def close(self) -> None:
        """End the process."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()

    def run(self, case: bytes, timeout: float) -> EpisodeOutcome:
        """Run an episode, and once more if the process dies.

        Args:
            case: the packed case.
            timeout: s of wall time after which the episode is ended.

        Raises:
            OneBotError: processes end before they run anything, or ``ended`` is set.
        """
        has_died = False
        for _ in range(_MAX_BROKEN):
            try:
                future = self._pool.schedule(run_packed, (self._packed, case), timeout=timeout)
                while not wait([future], _CHECK).done:
                    if self._ended.is_set() or not self._pool.active:
                        raise RuntimeError
                return future.result()
            except TimeoutError:
                return EpisodeOutcome(b"", f"it took longer than {timeout:g} s, and was ended")
            except ProcessExpired:
                if has_died:
                    return EpisodeOutcome(b"", DIED)
                has_died = True
            except RuntimeError:  # the pool is broken: the process died before the episode
                if self._ended.is_set():
                    break
            self.close()
            self._open()
        raise OneBotError("the workers end before they run an episode")


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
    from onebot_description.ros.process_start import blas_variables

    idle, ended = SimpleQueue[Worker](), threading.Event()
    for _ in range(count):
        idle.put(Worker(packed, ended))

    def run(case: bytes) -> EpisodeOutcome:
        worker = idle.get()
        try:
            return worker.run(case, timeout)
        finally:
            idle.put(worker)

    running: dict[Future[EpisodeOutcome], int] = {}
    with patch.dict(os.environ, blas_variables()), ThreadPoolExecutor(count) as threads:
        try:
            while True:
                # Twice their number, so that no process waits for its next episode.
                while len(running) < 2 * count and (task := next(cases, None)):
                    running[threads.submit(run, task[1])] = task[0]
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        finally:
            ended.set()
            for waiting in running:
                waiting.cancel()
            for _ in range(count):  # all at once: some may take seconds
                threads.submit(lambda: idle.get().close())
