"""A description's files: an edit loads the robot again, while its node works on."""

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
    """What a description was read from."""

    model: str  # a URDF or xacro file
    arguments: Mapping[str, str]  # xacro's
    files: tuple[str, ...]  # the model, and what it includes
    read_ns: int  # when, since 1970: what is written later is an edit

    def to_json(self) -> str:
        """Return it as text, for a command line."""
        return json.dumps(self._asdict())

    @classmethod
    def from_json(cls, text: str) -> Source:
        """Return what ``to_json`` has written."""
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
        """The files edited since the last description that could be used."""
        return ", ".join(map(str, dict.fromkeys(self._edited)))

    def applied(self) -> None:
        """Begin a new list of edited files: the description is in use."""
        self._edited.clear()

    def poll(self) -> Description | None:
        """Return the edited robot once it is loaded; to be called several times a second.

        Raises OneBotError if the files as they are now cannot be used.
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
