"""Where the elements of a published URDF were written.

A bringup knows the files; its nodes get the text alone, in which no line is that of a file.
"""

import json
import os
import zlib
from pathlib import Path

from onebot_description.description.description import Description

# The environment variable with the folder that the places are kept in.
PLACES = "ONEBOT_PLACES"


def digest_of(urdf: str) -> str:
    """Return a short name for a URDF text, which an edited one does not have."""
    return f"{len(urdf):x}-{zlib.crc32(urdf.encode()):08x}"


def keep_places(description: Description) -> None:
    """Have processes that get the description's text know where it was written."""
    if folder := os.environ.get(PLACES):
        Path(folder, digest_of(description.urdf)).write_text(json.dumps(description.places))


def kept_places(urdf: str) -> list[str]:
    """Return where each element of a text was written; none if that is not known."""
    folder = os.environ.get(PLACES)
    try:
        return list(json.loads(Path(folder, digest_of(urdf)).read_text())) if folder else []
    except (OSError, UnicodeEncodeError):
        return []
