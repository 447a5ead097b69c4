"""Detects that files were saved completely, and reads them in the background.

An editor may empty a file and then fill it, write a new one and rename it over the old one, or save
several together. Files are therefore polled by name, with one stat call each. A change counts once
no file has changed for a moment; for longer if a file is empty or missing, because it may be about
to be filled.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

T = TypeVar("T")

FileState = tuple[int, int, int] | None  # time of modification (ns), size, inode; None: no file
_UNREAD = (-1, -1, -1)
_REST = 0.2  # seconds without a change until a change counts
_REST_EMPTY = 1.0  # the same, if a changed file is empty or missing


def file_states(files: Iterable[Path]) -> dict[Path, FileState]:
    """Return a state of each file that differs after it was edited, replaced or removed."""
    return {file: _state(file) for file in files}


def _state(file: Path) -> FileState:
    try:
        status = os.stat(file)
    except (OSError, ValueError):  # ValueError: a name with a null byte
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


class FileWatch:
    """Reports which watched files have changed, once all have stopped changing."""

    def __init__(
        self,
        files: Iterable[Path],
        *,
        since_ns: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch files.

        Args:
            files: files to watch; they need not exist.
            since_ns: files written after this time (ns since 1970) count as changed.
            clock: returns seconds.
        """
        self._last = file_states(files)
        self._known = dict(self._last)
        for file, state in self._last.items():
            if since_ns is not None and (state is None or state[0] > since_ns):
                self._known[file] = _UNREAD
        self._clock = clock
        self._since = clock()  # when the files were first seen in their last state

    @property
    def files(self) -> tuple[Path, ...]:
        """The watched files."""
        return tuple(self._known)

    def watch(self, files: Iterable[Path]) -> None:
        """Watch these files instead; those already watched keep their state."""
        names = tuple(files)
        new = file_states(file for file in names if file not in self._known)
        states, last = self._known | new, self._last | new
        self._known = {file: states[file] for file in names}
        self._last = {file: last[file] for file in names}

    def poll(self) -> list[Path]:
        """Check the files; return those saved or removed since the last result.

        The result is empty until no file has changed for a moment.
        """
        last, self._last, now = self._last, file_states(self._known), self._clock()
        if self._last != last:
            self._since = now
        changed = [file for file, state in self._last.items() if state != self._known[file]]
        complete = all(state and state[1] for state in map(self._last.get, changed))
        if not changed or now - self._since < (_REST if complete else _REST_EMPTY):
            return []
        self._known = dict(self._last)
        return changed


class Reloader(Generic[T]):
    """Reads files again, in the background, whenever one of them was edited.

    Attributes:
        watched: the watch of the files.
    """

    def __init__(
        self, read: Callable[[], T], files: Iterable[Path], since_ns: int | None = None
    ) -> None:
        """Watch ``files``, which ``read`` reads; for ``since_ns`` see FileWatch."""
        self.watched = FileWatch(files, since_ns=since_ns)
        self._read = read
        self._edited: list[Path] = []
        self._is_due = False  # whether to read once the current reading has ended
        self._reading: Future[T] | None = None

    @property
    def edited(self) -> str:
        """The files that were edited since the last applied result, joined by commas."""
        return ", ".join(map(str, dict.fromkeys(self._edited)))

    @property
    def is_reading(self) -> bool:
        """Whether files are being read, or will be at the next poll."""
        return self._is_due or self._reading is not None

    def read_soon(self) -> None:
        """Read the files at the next poll, edited or not."""
        self._is_due = True

    def applied(self) -> None:
        """Clear the list of edited files, because the last result is in use."""
        self._edited.clear()

    def poll(self) -> T | None:
        """Return what was read, once that is done; call it several times a second.

        Raises what ``read`` raises.
        """
        edited = self.watched.poll()
        self._edited += edited
        self._is_due |= bool(edited)
        if self._is_due and self._reading is None:
            self._is_due, self._reading = False, in_background(self._read)
        if self._reading is None or not self._reading.done():
            return None
        reading, self._reading = self._reading, None
        return reading.result()


def in_background(read: Callable[[], T]) -> Future[T]:
    """Call ``read`` in a thread; return its Future, to poll while the node continues to work."""
    from concurrent.futures import Future  # it imports logging, and few processes need it

    reading: Future[T] = Future()

    def run() -> None:
        try:
            reading.set_result(read())
        except BaseException as error:
            reading.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return reading
