"""Watches the files of a description, and loads it again in the background after an edit."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError
from onebot_description.file_watch import Reloader


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


def load_followed(
    model: str, arguments: Mapping[str, str] | None = None
) -> tuple[Description, Source]:
    """Load a description; return it with its source, which is needed to follow edits."""
    read_ns = time.time_ns()
    description = load_description(model, arguments)
    files = tuple(map(str, description.files))
    return description, Source(model, arguments or {}, files, read_ns)


class DescriptionFiles(Reloader[Description]):
    """Loads a description in the background whenever one of its files was edited."""

    def __init__(self, source: Source) -> None:
        self.model = source.model

        def load() -> Description:
            return load_description(source.model, source.arguments)

        super().__init__(load, map(Path, source.files), source.read_ns)

    def poll(self) -> Description | None:
        """Return the edited description once it is loaded; call it several times a second.

        Raises:
            OneBotError: the files in their current state cannot be used.
        """
        try:
            description = super().poll()
        except OneBotError:
            from onebot_description.description.xacro import included_files

            # The mistake may be in a file that this very edit includes.
            self.watched.watch((*self.watched.files, *included_files(self.model)))
            raise
        if description is not None:
            self.watched.watch(description.files)
        return description
