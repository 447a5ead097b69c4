"""PyBullet as ``engine``; what its C code writes past Python is caught and logged."""

import contextlib
import ctypes
import logging
import os
import re
import sys
import threading
from collections.abc import Iterator
from typing import BinaryIO

__all__ = ["captured", "engine", "log", "logger"]

logger = logging.getLogger("onebot_control.simulation")

# File descriptors belong to the process: two captures at once would restore each other's.
_lock = threading.RLock()
_LIBC = ctypes.CDLL(None)
# Bullet opens each warning with the place in its sources.
_ORIGIN = re.compile(r"b3(?:Warning|Error|Printf)\[[^\]]*\]:\s*")


@contextlib.contextmanager
def captured(*descriptors: int) -> Iterator[list[str]]:
    """Catch everything the process writes to ``descriptors`` (default: 1, stdout) meanwhile.

    Other threads' output to them is caught too, which is why it should not be thrown away. A
    descriptor that is closed is left alone.

    Yields:
        A list that, once the block has ended (well or badly), holds the lines written.
    """
    lines: list[str] = []
    with _lock, _memory() as file, contextlib.ExitStack() as restoring:
        _flush()
        for descriptor in descriptors or (1,):
            # A closed descriptor has nothing to write to, nor to restore.
            with contextlib.suppress(OSError):
                saved = os.dup(descriptor)
                restoring.callback(_restore, saved, descriptor)
                os.dup2(file.fileno(), descriptor)
        try:
            yield lines
        finally:
            _flush()
            restoring.close()
            file.seek(0)
            lines += _lines(file.read().decode(errors="replace"))


def log(lines: list[str]) -> None:
    """Log caught lines as warnings."""
    for line in lines:
        logger.warning("PyBullet: %s", line)


def _memory() -> BinaryIO:
    """A file that is on no disk."""
    return open(os.memfd_create("captured"), "w+b")


def _flush() -> None:
    """Push out what C's and Python's own buffers hold, so that it lands where it belongs."""
    for stream in (sys.stdout, sys.stderr):
        # Under a test runner or without a terminal there may be none, or a closed one.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            stream.flush()
    _LIBC.fflush(None)


def _restore(saved: int, descriptor: int) -> None:
    os.dup2(saved, descriptor)
    os.close(saved)


def _lines(text: str) -> list[str]:
    """Cut the C code's output into messages; it ends some of them without a new line."""
    return [line.strip() for line in _ORIGIN.sub("\n", text).splitlines() if line.strip()]


# PyBullet prints a line about itself when it is imported.
with captured(1, 2):
    import pybullet as engine
