"""Provides PyBullet as ``engine``, and its worlds; logs what its C code prints."""

import contextlib
import ctypes
import logging
import os
import re
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterator
from functools import partial
from typing import IO, Any

__all__ = ["Bullet", "captured", "engine", "log", "logger", "scratch_file"]

logger = logging.getLogger("onebot_control.physics")

# File descriptors belong to the process: two captures at once would restore each other's.
_lock = threading.RLock()
# The C library that PyBullet prints with; on Windows, it is not among the process's own symbols.
_LIBC = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
# Bullet's prefix of each warning names a line of its sources.
_ORIGIN = re.compile(r"b3(?:Warning|Error|Printf)\[[^\]]*\]:\s*")


@contextlib.contextmanager
def scratch_file() -> Iterator[tuple[IO[bytes], str]]:
    """Yield an empty file, and a path that opens it again.

    On Linux the file is in memory, so that a killed process leaves nothing behind.
    """
    if sys.platform == "linux":
        with open(os.memfd_create("onebot"), "w+b") as file:
            yield file, f"/proc/self/fd/{file.fileno()}"
    else:
        with tempfile.TemporaryDirectory() as folder, open(f"{folder}/scratch", "w+b") as file:
            yield file, file.name


@contextlib.contextmanager
def captured(*descriptors: int) -> Iterator[list[str]]:
    """Capture everything that the process writes to ``descriptors`` (default: 1, stdout).

    Output of other threads is captured too, so the lines should be logged. Closed descriptors are
    skipped.

    Yields:
        A list, which is filled with the captured lines when the block ends, even by an exception.
    """
    lines: list[str] = []
    with _lock, scratch_file() as (file, _), contextlib.ExitStack() as restoring:
        _flush()
        for descriptor in descriptors or (1,):
            # A closed descriptor can neither be captured nor restored.
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
            text = _ORIGIN.sub("\n", file.read().decode(errors="replace"))
            lines += filter(None, map(str.strip, text.split("\n")))


def log(lines: list[str]) -> None:
    """Log captured lines as warnings."""
    for line in lines:
        logger.warning("PyBullet: %s", line)


def _flush() -> None:
    """Flush the buffers of C and Python to the current descriptors."""
    for stream in (sys.stdout, sys.stderr):
        # In a test runner or without a terminal, a stream may be None or closed.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            stream.flush()
    _LIBC.fflush(None)


def _restore(saved: int, descriptor: int) -> None:
    os.dup2(saved, descriptor)
    os.close(saved)


class _Engine:
    """The module pybullet, imported at its first use, because the import takes 0.3 s."""

    def __getattr__(self, name: str) -> Any:
        # PyBullet prints a line when it is imported.
        with captured(1, 2):
            import pybullet
        value = getattr(pybullet, name)
        setattr(self, name, value)  # cached: __getattr__ is not called for it again
        return value


engine = _Engine()


class Bullet:
    """A PyBullet world, with the functions of ``engine`` without their physicsClientId.

    Attributes:
        client: its physicsClientId.
        close: frees the world, as garbage collection does.
    """

    def __init__(self) -> None:
        """Create an empty world."""
        self.client: int = engine.connect(engine.DIRECT)
        self.close = weakref.finalize(self, engine.disconnect, self.client)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(engine, name), physicsClientId=self.client)
        setattr(self, name, function)  # cached: __getattr__ is not called for it again
        return function
