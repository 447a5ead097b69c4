"""Writes files whole or not at all."""

import os
import shutil
from pathlib import Path


def write_whole(path: Path, data: bytes) -> None:
    """Write a file; an older one is replaced and gives its mode; a link stays a link."""
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
    """Raise the OSError that making a file or a new ``folder`` at a path would end with.

    It is tried: permissions alone do not tell, for example of root or a read-only file system. What
    is there stays as it is.
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
