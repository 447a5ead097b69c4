"""What a bringup publishes of a robot's files, and how it notices that they have changed."""

import json
import time
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

FileSignature = tuple[int, int, int]
Signature = tuple[FileSignature | None, ...]
LOOK_EVERY = 0.1  # seconds; an edit counts when two looks in a row agree


class Known(NamedTuple):
    """What is known of a robot's files when they have been read.

    Attributes:
        digest: of the URDF that came out.
        files: each file, as it was then.
    """

    digest: str
    files: Mapping[Path, FileSignature | None]

    @classmethod
    def of(
        cls, urdf: str, files: Iterable[Path], before: Mapping[Path, FileSignature | None]
    ) -> "Known":
        """Return it for ``files``; those looked at ``before`` they were read, as they were then."""
        return cls(digest_of(urdf), {file: before.get(file, _signature(file)) for file in files})

    def to_json(self) -> str:
        """Return it as text."""
        files = {str(file): signature for file, signature in self.files.items()}
        return json.dumps({"digest": self.digest, "files": files})

    @classmethod
    def from_json(cls, text: str) -> "Known":
        """Return what ``to_json`` has written."""
        content = json.loads(text)
        files = {Path(name): value and tuple(value) for name, value in content["files"].items()}
        return cls(content["digest"], files)

    def wait_for_edit(self) -> None:
        """Return when a file is another one than is known, and is no longer being written."""
        known, files = tuple(self.files.values()), tuple(self.files)
        now = known
        while True:
            last, now = now, signature_of(files)
            if now != known and now == last:
                return
            time.sleep(LOOK_EVERY)


def signatures(files: Iterable[Path]) -> dict[Path, FileSignature | None]:
    """Return what changes of each file when it is edited, replaced or removed."""
    return {file: _signature(file) for file in files}


def signature_of(files: Sequence[Path]) -> Signature:
    """Return what changes when one of ``files`` is edited, replaced or removed."""
    return tuple(signatures(files).values())


def _signature(file: Path) -> FileSignature | None:
    try:
        status = file.stat()
    except OSError:  # editors replace files: it is gone for a moment
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def digest_of(urdf: str) -> str:
    """Return a short name for a URDF text, which an edited one does not have."""
    return f"{len(urdf):x}-{zlib.crc32(urdf.encode()):08x}"
