"""What the benchmarks measure with: processor time, memory, latencies, and runs in turn."""

import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from onebot_description.errors import OneBotError
from tests.domains import claimed_domain

T = TypeVar("T")
CHECKOUT = Path(__file__).resolve().parents[2]
_STOP_FOR = 10.0  # seconds
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)


class WrongAnswer(OneBotError):
    """What was measured gave a wrong answer, so its speed is of no interest."""


def cpu_ns(*pids: int) -> int:
    """Processor time of processes with all their threads that still run, in nanoseconds.

    The scheduler's own count (/proc/PID/task/TID/schedstat), which the kernel brings up to date at
    least at every tick: measure over a second rather than over milliseconds.
    """
    total = 0
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").iterdir():
            try:
                total += int((task / "schedstat").read_text().split()[0])
            except FileNotFoundError:
                continue  # a thread that has just ended
    return total


def rss_bytes(*pids: int) -> int:
    """Resident memory of processes (VmRSS), in bytes; what they share counts for each."""
    total = 0
    for pid in pids:
        status = Path(f"/proc/{pid}/status").read_text()
        total += next(
            1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")
        )
    return total


def process_tree(pid: int) -> list[int]:
    """Return a process and all that descend from it, as far as they live."""
    found = [pid]
    for parent in found:
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            try:
                found += [int(child) for child in task.read_text().split()]
            except OSError:
                continue
    return found


def percentile(values: ArrayLike, percent: float) -> float:
    """Return the value that ``percent`` of ``values`` do not exceed; NaN of none."""
    array = np.asarray(values, float)
    return float(np.percentile(array, percent)) if array.size else float("nan")


def median(values: ArrayLike) -> float:
    """Return the middle one of ``values``; NaN of none."""
    return percentile(values, 50.0)


def in_turn(variants: Mapping[str, Callable[[], T]], rounds: int) -> dict[str, list[T]]:
    """Run all variants in turn, ``rounds`` times, so that noise hits them alike.

    Every other round goes backwards, so that none is always measured after the same one.

    Returns:
        What each variant returned, in the order of the rounds.
    """
    results: dict[str, list[T]] = {name: [] for name in variants}
    for number in range(rounds):
        names = list(variants)
        for name in reversed(names) if number % 2 else names:
            results[name].append(variants[name]())
    return results


def seconds_per_call(function: Callable[[], object], least: float = 0.05) -> float:
    """Wall-clock time of one call, over as many as take ``least`` seconds; after a first one."""
    function()
    count = 1
    while True:
        began = time.perf_counter()
        for _ in range(count):
            function()
        took = time.perf_counter() - began
        if took >= least:
            return took / count
        count = max(count + 1, int(1.2 * count * least / max(took, 1e-9)))
        count = min(count, 1_000_000)


@contextmanager
def ros_domain() -> Iterator[dict[str, str]]:
    """An environment for nodes that no others discover: a domain of its own, on this host only."""
    with claimed_domain() as domain:
        environment = {
            name: value for name, value in os.environ.items() if name != "ROS_LOCALHOST_ONLY"
        }
        environment["ROS_DOMAIN_ID"] = str(domain)
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        yield environment


class Running:
    """A process with all it starts, for the time of a ``with`` block; Ctrl-C ends it.

    Attributes:
        process: the process.
    """

    def __init__(
        self,
        command: Sequence[str],
        environment: Mapping[str, str],
        *,
        name: str = "",
        pipes: bool = False,
    ) -> None:
        """Start ``command`` in the checkout.

        Args:
            command: the program and its arguments.
            environment: all of it.
            name: for messages; default: the program's.
            pipes: connect standard input and output, as text; else output is kept in a file.
        """
        self._name = name or Path(command[0]).name
        self._interrupted = False
        self._log = tempfile.NamedTemporaryFile(suffix=".log")
        try:
            self.process: subprocess.Popen[str] = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE if pipes else subprocess.DEVNULL,
                stdout=subprocess.PIPE if pipes else self._log,
                stderr=self._log,
                text=True,
                env=dict(environment),
                cwd=CHECKOUT,
                start_new_session=True,
                preexec_fn=_prepare_child,
            )
        except OSError as error:
            self._log.close()
            raise OneBotError(f"{self._name} cannot be started: {error}") from None

    @property
    def output(self) -> str:
        """All it has printed so far (with pipes: on standard error)."""
        return Path(self._log.name).read_text(errors="replace")

    @property
    def pids(self) -> list[int]:
        """The process and all it has started."""
        return process_tree(self.process.pid)

    def check(self) -> None:
        """Raise OneBotError, with the end of its output, if it has ended."""
        code = self.process.poll()
        if code is not None:
            lines = self.output.strip().splitlines()[-5:]
            said = "".join(f"\n  {line}" for line in lines) or " nothing"
            raise OneBotError(f"{self._name} ended with exit code {code}; it said:{said}")

    def wait_for(self, condition: Callable[[], T], what: str, timeout: float = 60.0) -> T:
        """Poll ``condition`` until it is true, while the process lives; return its value.

        Raises:
            OneBotError: the process ended, or it took longer than ``timeout`` seconds.
        """
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            self.check()
            if time.monotonic() > deadline:
                raise OneBotError(f"waited {timeout:g} s in vain for {what}")
            time.sleep(0.01)
        return value

    def interrupt(self) -> None:
        """Press Ctrl-C, without waiting for the end; the end of the block does that."""
        if not self._interrupted and self.process.poll() is None:
            self._interrupted = True
            self._signal(signal.SIGINT)

    def __enter__(self) -> "Running":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._stop()
        finally:
            self._signal(signal.SIGKILL)
            self.process.wait()
            for pipe in (self.process.stdin, self.process.stdout):
                if pipe is not None:
                    pipe.close()
            self._log.close()

    def _stop(self) -> None:
        self.interrupt()
        try:
            self.process.wait(_STOP_FOR)
        except subprocess.TimeoutExpired:
            print(f"{self._name} did not stop and is killed", file=sys.stderr)

    def _signal(self, number: int) -> None:
        try:
            os.killpg(self.process.pid, number)
        except ProcessLookupError:
            pass


def _prepare_child() -> None:
    """In a child: receive SIGINT when the benchmark ends, even if that is killed."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
    # A shell's background job ignores SIGINT, and hands that down.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
