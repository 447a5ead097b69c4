"""Kills what a launcher leaves behind that was itself killed (SIGKILL, out of memory).

Runs as its own small process, ``python -I -S guard.py [FOLDER ...]``, with a pipe from the launcher
as its standard input. The launcher writes ``+GROUP`` for each process group that it starts and
``-GROUP`` for each that is gone. The pipe closes when the launcher ends, however it ends: what is
left then is told to stop, and killed if it does not, and the folders are removed.
"""

import shutil
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from groups import group_alive, signal_group  # type: ignore[import-not-found] # noqa: E402

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
