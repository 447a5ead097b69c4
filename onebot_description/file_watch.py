"""Notices that files were saved and are complete again, and reads them in the background.

An editor may empty a file and then fill it, write a new one and rename it over the old one, or save
several at once. So files are polled by name, by one stat call each, and a change counts once all of
them have been at rest for a moment; for a longer one where a file is empty or gone, which most are
before they are filled.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

T = TypeVar("T")

FileState = tuple[int, int, int] | None  # time of modification (ns), size, inode; None: no file
_UNREAD = (-1, -1, -1)
_REST = 0.2  # seconds without a change until a change counts
_REST_EMPTY = 1.0  # the same, where a changed file is empty or gone


def _states(files: Iterable[Path]) -> dict[Path, FileState]:
    """Return for each file what changes when it is edited, replaced or removed."""
    return {file: _state(file) for file in files}


def _state(file: Path) -> FileState:
    try:
        status = os.stat(file)
    except (OSError, ValueError):  # the latter of a name with a null byte
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def _has_content(state: FileState) -> bool:
    return state is not None and state[1] > 0


class Changes(NamedTuple):
    """Which files have changed."""

    saved: list[Path]  # written or replaced
    removed: list[Path]  # deleted, or renamed to something else


class FileWatch:
    """Reports which of some files have changed, once all of them are at rest."""

    def __init__(
        self,
        files: Iterable[Path],
        *,
        since_ns: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch ``files``; none need exist.

        Files that were written later than ``since_ns``, ns since 1970, count as changed; ``clock``
        gives seconds.
        """
        self._last = _states(files)
        self._known = dict(self._last)
        for file, state in self._last.items():
            if since_ns is not None and (state is None or state[0] > since_ns):
                self._known[file] = _UNREAD
        self._clock = clock
        self._since = clock()  # when the files were first found as they were last

    @property
    def files(self) -> tuple[Path, ...]:
        """The files watched."""
        return tuple(self._known)

    def watch(self, files: Iterable[Path]) -> None:
        """Watch these files instead; those already watched keep their state."""
        names = tuple(files)
        new = _states(file for file in names if file not in self._known)
        states, last = self._known | new, self._last | new
        self._known = {file: states[file] for file in names}
        self._last = {file: last[file] for file in names}

    def poll(self) -> Changes:
        """Look at the files; return what has happened to them since it was last returned.

        Nothing is returned before all of the files have been at rest.
        """
        last, self._last, now = self._last, _states(self._known), self._clock()
        if self._last != last:
            self._since = now
        changed = [file for file, state in self._last.items() if state != self._known[file]]
        complete = all(_has_content(self._last[file]) for file in changed)
        if not changed or now - self._since < (_REST if complete else _REST_EMPTY):
            return Changes([], [])
        self._known = dict(self._last)
        saved = [file for file in changed if self._known[file] is not None]
        return Changes(saved, [file for file in changed if file not in saved])


def in_background(read: Callable[[], T]) -> "Future[T]":
    """Call ``read`` in a thread, to be polled for: a node works on while it reads a file."""
    from concurrent.futures import Future  # it imports logging, and few processes need it

    reading: Future[T] = Future()

    def run() -> None:
        try:
            reading.set_result(read())
        except BaseException as error:
            reading.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return reading
