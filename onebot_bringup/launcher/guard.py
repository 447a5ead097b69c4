"""Ends the nodes of a launcher that was itself killed (SIGKILL, out of memory).

Linux's signal on the parent's death is not enough: it does not reach the processes that a node has
started, and it is a single signal, so either a recorder could not close its file, or a node that
ignores SIGTERM would live on. So the launcher starts this file as a small separate process with a
pipe as its standard input. The pipe closes when the launcher ends, however it ends; the remaining
process groups then get SIGTERM, and SIGKILL after a while.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

TERMINATE_FOR = 4.0  # seconds from SIGTERM to SIGKILL: nothing is left after 5 s
_POLL = 0.05  # seconds
_DEAD = frozenset("ZX")  # states in /proc


class Guard:
    """The launcher's end of the pipe.

    Each line is ``+GROUP``, ``-GROUP`` for a group that is gone, or a temporary folder to remove.
    """

    def __init__(self) -> None:
        # Both ends stay open and do not block, so writing is harmless if the guard has died.
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        self._closed = False
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__],
            stdin=self._read,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def add(self, group: int) -> None:
        """End the process group ``group`` if the launcher is killed."""
        self._write_line(f"+{group}")

    def discard(self, group: int) -> None:
        """Forget ``group``, which is gone."""
        self._write_line(f"-{group}")

    def remove_later(self, folder: Path) -> None:
        """Remove ``folder`` if the launcher is killed."""
        self._write_line(str(folder))

    def close(self) -> None:
        """End the guard, which ends the groups that it still knows; again, it does nothing."""
        if self._closed:
            return
        self._closed = True
        os.close(self._write)
        os.close(self._read)
        try:
            self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _write_line(self, line: str) -> None:
        if self._closed:
            return  # the descriptor may be another file's by now
        with contextlib.suppress(OSError):
            os.write(self._write, f"{line}\n".encode())


def signal_group(group: int, number: int) -> None:
    """Send a signal to each process of ``group``; it is not an error if they are already gone."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, number)


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
    """Look for running processes in /proc; unreaped zombies of orphans stay in the group."""
    return any(_runs_in(stat, group) for stat in Path("/proc").glob("[0-9]*/stat"))


def _runs_in(stat: Path, group: int) -> bool:
    """Return whether the process of this /proc file is in ``group`` and not a zombie."""
    try:
        # proc(5): "pid (comm) state ppid pgrp ..."; comm may itself hold spaces and parentheses.
        state, _, process_group = stat.read_text(errors="replace").rpartition(")")[2].split()[:3]
    except (OSError, ValueError):
        return False  # it has just ended
    return int(process_group) == group and state not in _DEAD


def main() -> None:
    """Follow the launcher's groups until it ends; then end them."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    folders: list[str] = []
    for line in map(str.rstrip, sys.stdin):
        if line[0] == "+":
            groups.add(int(line))
        elif line[0] == "-":
            groups.discard(-int(line))
        else:
            folders.append(line)
    if groups:
        end(groups)
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)


def end(groups: set[int]) -> None:
    """Stop all processes of ``groups``: SIGTERM, and after a while SIGKILL for the rest."""
    deadline = time.monotonic() + TERMINATE_FOR
    for group in groups:
        signal_group(group, signal.SIGTERM)
    while any(group_alive(group) for group in groups):
        if time.monotonic() > deadline:
            for group in groups:
                signal_group(group, signal.SIGKILL)
            return
        time.sleep(_POLL)


if __name__ == "__main__":
    main()
