"""Watches the files of a description, and loads it again in the background after an edit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError
from onebot_description.file_watch import FileWatch, in_background

if TYPE_CHECKING:
    from concurrent.futures import Future


class Source(NamedTuple):
    """The file, arguments and time from which a description was read."""

    model: str  # a URDF or xacro file
    arguments: Mapping[str, str]  # xacro arguments, by name
    files: tuple[str, ...]  # the model, and the files that it includes
    read_ns: int  # time of reading, ns since 1970; files written later count as edited

    def to_json(self) -> str:
        """Return it as text, for a command line."""
        return json.dumps(self._asdict())

    @classmethod
    def from_json(cls, text: str) -> Source:
        """Return the Source from a text of ``to_json``."""
        content = json.loads(text)
        return cls(**{**content, "files": tuple(content["files"])})


class DescriptionFiles:
    """Loads a description in the background whenever one of its files was edited."""

    def __init__(self, source: Source) -> None:
        self.model = source.model
        self._load = partial(load_description, source.model, source.arguments)
        self._watch = FileWatch(map(Path, source.files), since_ns=source.read_ns)
        self._edited: list[Path] = []  # since the robot was loaded
        self._is_due = False
        self._loading: Future[Description] | None = None

    @property
    def edited(self) -> str:
        """The files that were edited since the last applied description, joined by commas."""
        return ", ".join(map(str, dict.fromkeys(self._edited)))

    def applied(self) -> None:
        """Clear the list of edited files, because the new description is in use."""
        self._edited.clear()

    def poll(self) -> Description | None:
        """Return the edited description once it is loaded; call it several times a second.

        Raises:
            OneBotError: the files in their current state cannot be used.
        """
        saved, removed = self._watch.poll()
        self._edited += [*saved, *removed]
        self._is_due |= bool(saved or removed)
        if self._is_due and self._loading is None:
            self._is_due, self._loading = False, in_background(self._load)
        if self._loading is None or not self._loading.done():
            return None
        loading, self._loading = self._loading, None
        try:
            description = loading.result()
        except OneBotError:
            from onebot_description.description.xacro import included_files

            # The mistake may be in a file that was included only just now.
            self._watch.watch((*self._watch.files, *included_files(self.model)))
            raise
        self._watch.watch(description.files)
        return description
