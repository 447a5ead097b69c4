"""Writes the launcher's output: whole lines with the writer's name, never blocking the launcher.

One thread writes the lines of a bounded queue. A paused terminal or a reader that stalls must not
stop the robot: while the queue is full, further lines are counted and dropped.
"""

import os
import queue
import re
import select
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from onebot_description.errors import printable

_MAX_LINES = 4000
_COLORS = ("36", "32", "33", "35", "34", "96", "92", "93", "95", "94")  # ANSI foregrounds

# Control sequences other than colors, which a terminal would obey; names in files may hold them.
_OBEYED = re.compile(
    rb"[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f]|\x1b(?!\[[0-9;]*m)|\xc2[\x80-\x9f]"
    rb"|\xe2\x80[\x8e\x8f\xa8-\xae]|\xe2\x81[\xa6-\xa9]|\xd8\x9c"  # text direction, in UTF-8
)


def _escaped(line: bytes) -> bytes:
    return _OBEYED.sub(lambda match: match[0].decode().encode("unicode_escape"), line)


class OutputStream(NamedTuple):
    """Standard output or error."""

    descriptor: int
    color: bool


class Console:
    """Standard output and error, shared by the nodes and the launcher."""

    def __init__(self, program: str, names: Sequence[str]) -> None:
        """Start the thread that writes.

        Args:
            program: the prefix of the launcher's own messages.
            names: the names of the nodes, each of which gets a color.
        """
        self.out, self.err = (
            OutputStream(stream.fileno(), wants_color(stream.fileno()))
            if stream is not None
            else OutputStream(-1, False)  # a shell has closed it (>&-)
            for stream in (sys.stdout, sys.stderr)
        )
        self._program = program
        self._colors = {name: _COLORS[i % len(_COLORS)] for i, name in enumerate(names)}
        self._queue: queue.Queue[tuple[int, bytes] | None] = queue.Queue(_MAX_LINES)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write_lines, daemon=True)
        self._thread.start()

    def line(self, name: str, stream: OutputStream, text: bytes) -> None:
        """Write one line of the node called ``name``; ``text`` comes without its newline."""
        prefix = f"[{name}]"
        if stream.color:
            prefix = f"\x1b[{self._colors.get(name, '1')}m{prefix}\x1b[0m"
        self._put(stream, prefix.encode() + b" " + _escaped(text.rstrip(b"\r")) + b"\n")

    def print(self, text: str) -> None:
        """Write text, which may have several lines."""
        for line in text.split("\n"):
            self._put(self.out, printable(line).encode() + b"\n")

    def info(self, text: str) -> None:
        """Write one of the launcher's own messages."""
        self.print(f"[{self._program}] {text}")

    def warn(self, text: str) -> None:
        """Write one of the launcher's own messages about a problem."""
        start, end = ("\x1b[1;31m", "\x1b[0m") if self.err.color else ("", "")
        line = printable(f"[{self._program}] {text}")
        self._put(self.err, f"{start}{line}{end}\n".encode())

    def close(self, timeout: float) -> None:
        """Write the queued lines; ``timeout`` (s) limits how long, in case the reader stalls."""
        with suppress(queue.Full):
            self._queue.put(None, timeout=timeout)
        self._thread.join(timeout)

    def _put(self, stream: OutputStream, line: bytes) -> None:
        if self._dropped:
            line = f"({self._dropped} lines were not shown: output stalled)\n".encode() + line
        try:
            self._queue.put_nowait((stream.descriptor, line))
            self._dropped = 0
        except queue.Full:
            self._dropped += 1

    def _write_lines(self) -> None:
        closed = {-1}
        while (item := self._queue.get()) is not None:
            descriptor, line = item
            if descriptor in closed:
                continue
            try:
                _write(descriptor, line)
            except OSError:  # the reader or the terminal is gone, or the disk is full
                closed.add(descriptor)


def _write(descriptor: int, line: bytes) -> None:
    while line:
        try:
            line = line[os.write(descriptor, line) :]
        except BlockingIOError:  # another process has made the terminal non-blocking
            select.select([], [descriptor], [])


def wants_color(descriptor: int) -> bool:
    """Return whether to color output: ``descriptor`` is a terminal, and NO_COLOR is not set."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return os.isatty(descriptor)
