"""Notices that files were saved and are complete again, at the price of one stat call a file.

An editor may empty a file and then fill it, write a new one and rename it over the old one, or save
several at once. So files are polled by name, and a change counts when two polls in a row find all
of them the same.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

FileState = tuple[int, int, int] | None  # time of modification (ns), size, inode; None: no file
_UNREAD = (-1, -1, -1)


def file_states(files: Iterable[Path]) -> dict[Path, FileState]:
    """Return for each file what changes when it is edited, replaced or removed."""
    return {file: _state(file) for file in files}


def _state(file: Path) -> FileState:
    try:
        status = os.stat(file)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


class FileWatch:
    """Reports which of some files have changed, once all of them are at rest."""

    def __init__(
        self,
        files: Iterable[Path],
        *,
        known: Mapping[Path, FileState] | None = None,
        unread: bool = False,
    ) -> None:
        """Watch ``files``; none need exist.

        Args:
            files: by name.
            known: states that count as unchanged; by default, the present ones do.
            unread: report all files as changed the first time that they are at rest.
        """
        self._known: dict[Path, FileState] = dict.fromkeys(files, _UNREAD)
        if not unread:
            self._known = file_states(self._known) | dict(known or {})
        self._last = dict(self._known)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files watched."""
        return tuple(self._known)

    def watch(self, files: Iterable[Path]) -> None:
        """Watch these files instead; those already watched keep their state."""
        wanted = tuple(files)
        new = file_states(file for file in wanted if file not in self._known)
        known, last = self._known | new, self._last | new
        self._known = {file: known[file] for file in wanted}
        self._last = {file: last[file] for file in wanted}

    def changed(self) -> list[Path]:
        """Poll the files; return those edited, replaced or removed since they were last reported.

        Nothing is returned while any of the files differs from the poll before.
        """
        last, self._last = self._last, file_states(self._known)
        if self._last != last:
            return []
        known, self._known = self._known, dict(last)
        return [file for file, state in last.items() if state != known[file]]

    def saved(self) -> list[Path]:
        """Return those ``changed`` that exist: what is gone is not saved."""
        return [file for file in self.changed() if self._known[file] is not None]
