"""What a process needs to leave nothing behind, even if it is killed (SIGKILL, out of memory).

Its children end with it by Linux's signal on a parent's death. That signal does not reach what a
child has started: a node that starts processes has to give them the same.
"""

import ctypes
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def die_with_this_thread(sent: int = signal.SIGKILL) -> Callable[[], None] | None:
    """Return a ``preexec_fn`` for a child that is killed when the calling thread ends.

    It is None where the system has no such signal. Linux follows the *thread* that starts the
    child, so that has to be one that lives as long as the process: the main thread.

    Args:
        sent: the signal that the child gets.
    """
    if sys.platform != "linux":
        return None
    parent = os.getpid()
    libc = ctypes.CDLL(None)  # before the fork, because the child may not allocate much

    def arrange() -> None:
        libc.prctl(_PR_SET_PDEATHSIG, sent)
        if os.getppid() != parent:  # the parent died before the call above
            os._exit(1)

    return arrange


def temporary_folder(kind: str) -> tempfile.TemporaryDirectory[str]:
    """Make a temporary folder, and remove those of this kind whose process was killed."""
    prefix = f"onebot-{kind}-"  # the id of the process follows
    processes = Path("/proc")
    if processes.is_dir():  # Linux has it
        for folder in Path(tempfile.gettempdir()).glob(f"{prefix}*"):
            process = folder.name.removeprefix(prefix).partition("-")[0]
            if not Path(processes, process).exists():
                shutil.rmtree(folder, ignore_errors=True)
    return tempfile.TemporaryDirectory(prefix=f"{prefix}{os.getpid()}-", ignore_cleanup_errors=True)
