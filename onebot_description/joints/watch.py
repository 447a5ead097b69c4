"""Noticing that files were saved, at the price of a few stat calls."""

import os
from collections.abc import Iterable
from pathlib import Path

Signature = tuple[int, int, int] | None


class FileWatch:
    """Tells when any of some files has been saved and has come to rest.

    It looks at the files by name, so that an editor may write a new file and rename it over the old
    one. A file counts as saved once two looks in a row find it the same, because an editor may also
    empty it and then fill it.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        """Watch ``files`` from their present state on; none need exist."""
        self._known = {file: _signature(file) for file in files}
        self._last = dict(self._known)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files watched."""
        return tuple(self._known)

    def watch(self, files: Iterable[Path]) -> None:
        """Watch these files instead; those already watched keep their state."""
        wanted = list(files)
        self._known = {file: self._known.get(file, _signature(file)) for file in wanted}
        self._last = {file: self._last.get(file, self._known[file]) for file in wanted}

    def saved(self) -> list[Path]:
        """Return the files saved since the last call; a file that is gone is not saved."""
        saved = []
        for file, last in self._last.items():
            now = _signature(file)
            if now == last and now != self._known[file]:
                self._known[file] = now
                if now is not None:
                    saved.append(file)
            self._last[file] = now
        return saved


def _signature(file: Path) -> Signature:
    try:
        status = os.stat(file)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
