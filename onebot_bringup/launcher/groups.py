"""Process groups: signal one, see whether any of it still lives, and die with the parent.

Also imported by ``guard.py``, which runs without this package: standard library only.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

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
