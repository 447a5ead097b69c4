"""Helpers shared by the tests."""

import ctypes
import os
import shutil
import signal
import subprocess
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import pytest

T = TypeVar("T")
P = TypeVar("P", bound="RunningProcess")

# Seconds that a failing test waits: with a load of 20 a process is ten times as slow.
PATIENCE = 180.0


def wait_for(condition: Callable[[], T], what: str, timeout: float = PATIENCE) -> T:
    """Poll ``condition`` until it is truthy and return its value.

    Args:
        condition: called about every 20 ms. An IndexError counts as false: the last message of a
            list is asked for before one has come.
        what: what is awaited, for the failure message.
        timeout: seconds; generous, because it only matters when the test fails.

    Raises:
        AssertionError: the condition stayed false.
    """
    deadline = time.monotonic() + timeout
    while True:
        with suppress(IndexError):
            if value := condition():
                return value
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout:g} s in vain for {what}")
        time.sleep(0.02)


@contextmanager
def stopped(process: int) -> Iterator[None]:
    """Stop a child by SIGSTOP, and continue it by SIGCONT at the end."""
    os.kill(process, signal.SIGSTOP)
    os.waitid(os.P_PID, process, os.WSTOPPED | os.WNOWAIT)  # its threads run on until then
    yield
    os.kill(process, signal.SIGCONT)


@contextmanager
def starved(process: int) -> Iterator[None]:
    """Give a child no processor time, for more than half a second; no signal tells it so."""
    seize, interrupt, detach, every_thread = 0x4206, 0x4207, 17, 0x40000000  # as in sys/ptrace.h
    ptrace = ctypes.CDLL(None).ptrace
    ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
    threads = [int(name) for name in os.listdir(f"/proc/{process}/task")]
    for thread in threads:
        assert ptrace(seize, thread, None, None) == ptrace(interrupt, thread, None, None) == 0
        os.waitpid(thread, every_thread)
    began = time.monotonic()  # only now does none of them run
    yield
    wait_for(lambda: time.monotonic() > began + 0.8, "the end of the stop")
    for thread in threads:
        assert ptrace(detach, thread, None, None) == 0


def assert_time_grows_with_size(seconds: Callable[[int], float], size: int) -> None:
    """Ten times the size takes about ten times as long; its square would take a hundred times.

    The least of up to five runs of each, so that what else the machine does hardly matters.

    Args:
        seconds: does work of a size, and returns the processor time that it took.
        size: the larger one.

    Raises:
        AssertionError: it always took more than 40 times as long.
    """
    small, large = float("inf"), float("inf")
    for _ in range(5):
        small = min(small, seconds(size // 10))
        large = min(large, seconds(size))
        if large < 40 * small:
            return
    raise AssertionError(f"{size // 10} took {small:.4f} s, {size} took {large:.4f} s")


def run_to_end(
    command: Sequence[str | bytes | Path], *, timeout: float = PATIENCE, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command, with the options of ``subprocess.run``; its exit code and what it printed."""
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)


class RunningProcess:
    """A process with its output kept; stopped with Ctrl-C at the end.

    With ``check``, it has to end with exit code 0 and without a traceback.
    """

    def __init__(
        self,
        words: Sequence[str],
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
        *,
        check: bool = True,
    ) -> None:
        self._check = check
        written = tempfile.mkdtemp()  # is read after its end, too
        weakref.finalize(self, shutil.rmtree, written)
        self._out, self._err = Path(written, "out"), Path(written, "err")
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                cwd=folder,
                start_new_session=True,
                env={**os.environ, "PYTHONFAULTHANDLER": "1", **(environment or {})},
            )

    @property
    def out(self) -> str:
        """What it has written to standard output so far."""
        return self._out.read_text()

    @property
    def err(self) -> str:
        """What it has written to standard error so far."""
        return self._err.read_text()

    @property
    def output(self) -> str:
        """All it has written so far."""
        return self.out + self.err

    def says(self, text: str) -> None:
        """Wait until it has written ``text``."""

        def condition() -> bool:
            ended = self.process.poll() is not None
            found = text in self.output
            assert found or not ended, self.output
            return found

        wait_for(condition, f"{text!r} in the output")

    def wait(self, timeout: float = PATIENCE) -> int:
        """The exit code, once it ends by itself."""
        return self.process.wait(timeout)

    def interrupt(self, timeout: float = PATIENCE) -> int:
        """Press Ctrl-C, which all processes of a terminal's foreground get; the exit code."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(timeout)

    def __enter__(self: P) -> P:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            if kind is not None and self.process.poll() is None:
                self.process.send_signal(signal.SIGCONT)  # the test may have stopped it
            code = self.interrupt()
        except subprocess.TimeoutExpired:
            self.process.send_signal(signal.SIGABRT)  # its stacks go to its output
            self.process.wait(PATIENCE)
            print(f"--- output of the process, which hung:\n{self.output}")
            raise
        finally:
            if self.process.poll() is None:
                self.process.kill()
        if kind is not None:
            print(f"--- output of the process:\n{self.output}")
        elif self._check:
            assert code == 0, self.output
            assert "Traceback" not in self.output, self.output


def lines_of_ours(output: str) -> list[str]:
    """The lines of a process but those of Fast DDS, such as errors of shared memory."""
    return [line for line in output.splitlines() if " -> Function " not in line]


def require_program(name: str, package: str = "") -> str:
    """Return the path of a program; skip where it is missing, but fail in CI, which installs it."""
    path = shutil.which(name)
    require(path is not None, f'the program "{name}"', package or name)
    return str(path)


def require(there: bool, what: str, package: str) -> None:
    """Skip where something of a Debian package is missing, but fail in CI, which installs it."""
    if not there:
        skip_for(f"{what}: apt-get install {package}")


def skip_for(missing: str) -> None:
    """Skip for what is missing, but fail in CI, where nothing may be."""
    reason = f"this test needs {missing}"
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason, allow_module_level=True)
