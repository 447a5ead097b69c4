"""Finds and removes shared memory of Fast DDS that killed processes left behind.

Each participant has a segment ``fastrtps_<16 digits>``, and keeps a file of that name with ``_el``
locked while it lives. It receives at ports, ``fastrtps_port<number>``, which are reused.
"""

import os
import re
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

FOLDER = Path("/dev/shm")
_SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")
_PORT = re.compile(r"fastrtps_port[0-9]+")
_READY = (2).to_bytes(4, "little")  # first in a port: Boost's InitializedSegment
YOUNG = 10.0  # s; a younger participant may not have locked its file yet


class Segments(NamedTuple):
    """The segments in a folder."""

    used: list[Path]
    stale: list[Path]  # unused
    stale_bytes: int


def find_segments(folder: Path = FOLDER) -> Segments:
    """Find the segments of living and of ended processes."""
    used, stale, size = [], [], 0
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if not _SEGMENT.fullmatch(path.name):
            continue
        with suppress(OSError):  # it has ended just now, or is another user's
            status = path.stat()
            if time.time() - status.st_mtime < YOUNG or _is_locked(_lock_of(path)):
                used.append(path)
            else:
                stale.append(path)
                size += status.st_size
    return Segments(used, stale, size)


def remove_broken_ports(folder: Path = FOLDER) -> None:
    """Remove ports whose creation was not finished, for example because shared memory was full.

    A process that opens such a port waits for minutes in ``rclpy.init`` or ``create_node``, even if
    the port is removed meanwhile, so call this first.
    """
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _PORT.fullmatch(entry.name):
                with suppress(OSError):  # it was removed just now, or is another user's
                    is_old = time.time() - entry.stat().st_mtime > YOUNG
                    if is_old and not Path(entry.path).read_bytes().startswith(_READY):
                        os.unlink(entry.path)


def remove_stale_in_background(folder: Path = FOLDER) -> threading.Thread:
    """Remove what killed processes left behind, in a thread, which is returned.

    It is safe while other processes start: young segments stay, and names are never reused.
    """

    def remove() -> None:
        with suppress(OSError):  # the folder may not be read
            for path in find_segments(folder).stale:
                with suppress(OSError):  # another user's
                    path.unlink()
                    _lock_of(path).unlink(missing_ok=True)

    thread = threading.Thread(target=remove, daemon=True)
    thread.start()
    return thread


def _lock_of(segment: Path) -> Path:
    return segment.with_name(f"{segment.name}_el")


def _is_locked(path: Path) -> bool:
    import fcntl  # Windows has none

    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        # A shared lock, released immediately, so that it keeps no process from starting.
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(file)
    return False
