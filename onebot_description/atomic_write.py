"""Writes files whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from onebot_description.errors import OneBotError


@contextmanager
def writing(what: object) -> Iterator[None]:
    """Turn an OSError in this context into an OneBotError that names the file."""
    try:
        yield
    except OSError as error:
        raise OneBotError(f"{what} cannot be written: {error.strerror}") from None


def write_whole(path: Path, data: bytes) -> None:
    """Write a file atomically; an existing file is replaced and keeps its mode; links stay links.

    Raises:
        OSError: the file cannot be written; nothing has changed.
    """
    path = path.resolve()
    new = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        new.write_bytes(data)
        if path.exists():
            shutil.copymode(path, new)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def refuse_unwritable(path: Path, *, folder: bool = False) -> None:
    """Raise the OSError that creating a file, or a new ``folder``, at a path would raise.

    It tries, because permissions alone do not decide, for example for root or on a read-only file
    system. An existing file does not change.
    """
    is_new = not path.exists()
    if folder:
        path.mkdir()
        path.rmdir()
        return
    target = path.resolve()
    target.open("ab").close()
    if is_new:
        target.unlink()
