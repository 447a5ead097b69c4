"""Whatever a test run starts ends with it, also if the run is killed.

A killed run would leave its nodes behind, and a later one that claims their ROS domain would
discover them. So a process marks the environment of all that it starts, and another process, which
survives it in a session of its own, kills what carries the mark once it is gone.
"""

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

_MARKS = "ONEBOT_TEST_RUNS"  # of this process and of those that started it
_ATTEMPTS = 100  # a process may start another while it is being killed


def end_with_this_process() -> None:
    """Have all that this process starts from now on killed when it ends, however it ends."""
    mark = f"[{os.getpid()}-{time.monotonic_ns()}]"
    process = os.pidfd_open(os.getpid())
    subprocess.Popen(
        [sys.executable, "-IS", __file__, str(process), mark],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=[process],
        start_new_session=True,
    ).returncode = 0  # nobody waits for it
    os.close(process)
    os.environ[_MARKS] = os.environ.get(_MARKS, "") + mark


def marked(mark: str, word: str = "") -> list[int]:
    """Return the running processes with the mark, and ``word`` in their command line."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            # A zombie has an empty command line.
            command = (folder / "cmdline").read_bytes()
            if command and word.encode() in command:
                if mark.encode() in (folder / "environ").read_bytes():
                    pids.append(int(folder.name))
        except OSError:
            continue
    return [pid for pid in pids if pid != os.getpid()]


def _main(process: int, mark: str) -> None:
    select.select([process], [], [])  # readable when the process has ended
    for _ in range(_ATTEMPTS):
        orphans = marked(mark)
        if not orphans:
            break
        for pid in orphans:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.05)


if __name__ == "__main__":
    _main(int(sys.argv[1]), sys.argv[2])
