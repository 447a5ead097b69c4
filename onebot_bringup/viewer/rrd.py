"""Checks Rerun's recording files (.rrd)."""

import warnings
from pathlib import Path

from onebot_description.errors import OneBotError
from onebot_description.ros.parameters.bounded_yaml import open_regular

_STARTS = (b"RRF", b"RRIO")  # any version of Rerun writes one of them
_PROPERTIES = "/__properties"  # the recording's name and start


def check_rrd(rrd: Path) -> None:
    """Check that a file begins as Rerun's recordings do.

    Raises:
        OneBotError: it does not, or cannot be read.
    """
    try:
        with open_regular(rrd) as file:
            start = file.read(4)
    except OSError as error:
        raise OneBotError(f"{rrd}: {error.strerror}") from error
    if not start.startswith(_STARTS):
        raise OneBotError(f"{rrd} is no recording of Rerun")


def has_content(rrd: Path) -> bool | None:
    """Return whether a recording contains anything to draw.

    Little of the file is read: frame sizes, and data up to the first that can be drawn.

    Returns:
        None if unknown: the file was cut short, is still being written, or has another format
        version.
    """
    from rerun.chunk import RrdReader  # slower to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # some files have no table of contents
            reader = RrdReader(str(rrd))
            return any(
                not chunk.entity_path.startswith(_PROPERTIES)
                for store in reader.recordings()
                for chunk in reader.stream(store=store)
            )
    except (RuntimeError, ValueError, OSError):
        return None
