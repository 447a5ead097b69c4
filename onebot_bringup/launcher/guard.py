"""Kills what a launcher leaves behind that was itself killed (SIGKILL, out of memory).

Runs as its own small process, ``python -I -S guard.py [FOLDER ...]``, with a pipe from the launcher
as its standard input. The launcher writes ``+GROUP`` for each process group that it starts and
``-GROUP`` for each that is gone. The pipe closes when the launcher ends, however it ends: what is
left then is told to stop, and killed if it does not, and the folders are removed.
"""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

# The launcher's end of the guard (see ``guard.py``), which outlives a killed launcher.


class Guard:
    """A process that kills the groups it was told of, should the launcher die without doing so."""

    def __init__(self, folders: Sequence[Path] = ()) -> None:
        """Start it; without it (no memory, no processes left) the launcher works all the same.

        Args:
            folders: temporary ones, which it removes should the launcher not live to do so.
        """
        script = Path(__file__).with_name("guard.py")
        try:
            self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
                [sys.executable, "-I", "-S", str(script), *map(str, folders)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError:
            self._process = None

    def add(self, group: int) -> None:
        """Answer for the process group ``group`` from now on."""
        self._tell(f"+{group}\n")

    def discard(self, group: int) -> None:
        """Forget ``group``: it is gone."""
        self._tell(f"-{group}\n")

    def close(self) -> None:
        """End it; it kills what it still answers for."""
        if self._process is None:
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
            self._process.wait(timeout=1.0)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()

    def _tell(self, line: str) -> None:
        if self._process is None:
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line.encode())
            self._process.stdin.flush()
        except OSError:  # it was killed; the nodes still ask to die with the launcher
            self._process = None


# Process groups: signal one, see whether any of it still lives, and die with the parent.

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_DEAD = frozenset("ZX")


def signal_group(group: int, number: int) -> None:
    """Send a signal to each process of ``group``; one that is gone already is no error."""
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):
        pass


def group_alive(group: int) -> bool:
    """Return whether a process of ``group`` still runs; zombies do not count."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not sys.platform.startswith("linux") or _any_running(group)


def _any_running(group: int) -> bool:
    """Look through /proc: where nothing reaps orphans, their zombies stay in the group."""
    return any(_runs_in(stat, group) for stat in Path("/proc").glob("[0-9]*/stat"))


def _runs_in(stat: Path, group: int) -> bool:
    """Return whether the process of this /proc file is in ``group`` and no zombie."""
    try:
        # proc(5): "pid (comm) state ppid pgrp ..."; comm may itself hold spaces and parentheses.
        state, _, process_group = stat.read_text(errors="replace").rpartition(")")[2].split()[:3]
    except (OSError, ValueError):
        return False  # it ended while we looked
    return int(process_group) == group and state not in _DEAD


def child_setup(hold_interrupt: bool) -> Callable[[], None]:
    """Return what a new child runs before its program: it asks to die with the launcher.

    Everything is looked up here, in the parent: between fork and exec only calls are made.
    SIGTERM, so that a node can still close its files; what ignores it, the guard kills.
    """
    prctl = ctypes.CDLL(None).prctl if sys.platform.startswith("linux") else None
    parent = os.getpid()

    def setup() -> None:
        if hold_interrupt:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
            if os.getppid() != parent:  # it died before we could ask
                os._exit(1)

    return setup


_TERMINATE_FOR = 4.0  # seconds


def main() -> None:
    """Follow the launcher's groups until it ends; then end them."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        group = int(line[1:])
        groups.add(group) if line[0] == "+" else groups.discard(group)
    if groups:
        end(groups)
        for folder in sys.argv[1:]:
            shutil.rmtree(folder, ignore_errors=True)


def end(groups: set[int]) -> None:
    """Stop all processes of ``groups``: SIGTERM, and SIGKILL for what is left after a while."""
    deadline = time.monotonic() + _TERMINATE_FOR
    for group in groups:
        signal_group(group, signal.SIGTERM)
    while any(group_alive(group) for group in groups):
        if time.monotonic() > deadline:
            for group in groups:
                signal_group(group, signal.SIGKILL)
            return
        time.sleep(0.05)


if __name__ == "__main__":
    main()
