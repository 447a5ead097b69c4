"""What a bringup publishes of a robot's files, and how it notices that they have changed."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

FileSignature = tuple[int, int, int]
Signature = tuple[FileSignature | None, ...]


def signature_of(files: Sequence[Path]) -> Signature:
    """Return what changes when one of ``files`` is edited, replaced or removed."""
    return tuple(_signature(file) for file in files)


def _signature(file: Path) -> FileSignature | None:
    try:
        status = file.stat()
    except OSError:  # editors replace files: it is gone for a moment
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def digest_of(urdf: str) -> str:
    """Return a short name for a URDF text that no other text has."""
    return hashlib.sha256(urdf.encode()).hexdigest()
