"""The launcher's output: whole lines, prefixed with who wrote them, never blocking.

A paused terminal or a reader that stalls must not stop the robot: what cannot be written now waits
in a buffer, and when that is full, further lines are counted and dropped.
"""

import asyncio
import os
import re
import select
import time
from collections.abc import Callable, Sequence
from typing import TextIO

from onebot_description.errors import printable

_CHUNK = 4096  # bytes; poll() promises room for this much in a pipe (PIPE_BUF)
_BUFFER = 1_000_000  # bytes
_RETRY = 0.02  # seconds
_COLOURS = ("36", "32", "33", "35", "34", "96", "92", "93", "95", "94")  # ANSI foregrounds


# What a terminal would obey, but for colours: names come from files, and nodes print them.
_OBEYED = re.compile(
    rb"[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f]|\x1b(?!\[[0-9;]*m)|\xc2[\x80-\x9f]"
    rb"|\xe2\x80[\x8e\x8f\xa8-\xae]|\xe2\x81[\xa6-\xa9]|\xd8\x9c"  # turns the text, in UTF-8
)


def _escaped(line: bytes) -> bytes:
    return _OBEYED.sub(lambda found: found[0].decode().encode("unicode_escape"), line)


class OutputStream:
    """One file descriptor, written to without ever blocking."""

    broken: bool  # the reader is gone; everything written from now on is discarded
    colour: bool  # whether to colour what is written

    def __init__(
        self, stream: TextIO | None, reader_left: Callable[[], object] = lambda: None
    ) -> None:
        """Write to the descriptor of ``stream``.

        Args:
            stream: None if it is closed.
            reader_left: called when it turns out that nobody reads any more.
        """
        self._descriptor = -1 if stream is None else stream.fileno()
        self._reader_left = reader_left
        self._buffer = bytearray()
        self._dropped = 0
        self._retry: asyncio.TimerHandle | None = None
        self.broken = stream is None
        self.colour = not self.broken and wants_colour(self._descriptor)

    @property
    def pending(self) -> bool:
        """Whether something still waits to be written."""
        return bool(self._buffer)

    def write(self, line: bytes) -> None:
        """Write ``line``, which ends with a newline, or keep it for later."""
        if self.broken:
            return
        if len(self._buffer) > _BUFFER:
            self._dropped += 1
            return
        self._buffer += line
        if self._retry is None:
            self._pump()

    def _pump(self) -> None:
        """Write as much of what waits as can be written without blocking; try again later."""
        self._retry = None
        while self._buffer and self._writable():
            try:
                written = os.write(self._descriptor, self._buffer[:_CHUNK])
            except OSError:  # the reader or the terminal is gone, or the disk is full
                self.broken = True
                self._buffer.clear()
                self._reader_left()
                return
            del self._buffer[:written]
        if self._dropped and not self._buffer:
            self._buffer += f"({self._dropped} lines were not shown: output stalled)\n".encode()
            self._dropped = 0
        if self._buffer:
            self._retry = asyncio.get_running_loop().call_later(_RETRY, self._pump)

    def _writable(self) -> bool:
        poll = select.poll()
        poll.register(self._descriptor, select.POLLOUT)
        return bool(poll.poll(0))


class Console:
    """Standard output and error, shared by the nodes and the launcher."""

    def __init__(
        self,
        out: TextIO | None,
        err: TextIO | None,
        names: Sequence[str],
        reader_left: Callable[[], object],
    ) -> None:
        """Write to ``out`` and ``err``, within an event loop.

        Args:
            out: standard output.
            err: standard error.
            names: of the nodes; each gets its own colour.
            reader_left: called when nobody reads ``out`` any more.
        """
        self.out = OutputStream(out, reader_left)
        self.err = OutputStream(err)
        self._colours = {name: _COLOURS[i % len(_COLOURS)] for i, name in enumerate(names)}

    @property
    def pending(self) -> bool:
        """Whether either has something to be written."""
        return self.out.pending or self.err.pending

    def line(self, name: str, stream: OutputStream, text: bytes) -> None:
        """Write one line of the node called ``name``; ``text`` comes without its newline."""
        prefix = f"[{name}]"
        if stream.colour:
            prefix = f"\x1b[{self._colours.get(name, '1')}m{prefix}\x1b[0m"
        stream.write(prefix.encode() + b" " + _escaped(text.rstrip(b"\r")) + b"\n")

    def info(self, text: str) -> None:
        """Write a message of the launcher's own."""
        for line in text.split("\n"):
            self.out.write(printable(line).encode() + b"\n")

    def warn(self, text: str) -> None:
        """Write a message of the launcher's own on something that went wrong."""
        start, end = ("\x1b[1;31m", "\x1b[0m") if self.err.colour else ("", "")
        for line in text.split("\n"):
            self.err.write(f"{start}{printable(line)}{end}\n".encode())

    async def flush(self, timeout: float) -> None:
        """Let what waits be written, for at most ``timeout`` seconds."""
        deadline = time.monotonic() + timeout
        while self.pending and time.monotonic() < deadline:
            await asyncio.sleep(_RETRY)


def wants_colour(descriptor: int) -> bool:
    """Return whether to colour what goes to ``descriptor``: a terminal, and NO_COLOR not set."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return os.isatty(descriptor)
