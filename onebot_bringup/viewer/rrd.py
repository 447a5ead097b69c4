"""Checks Rerun's recording files (.rrd), and saves the recording that a viewer's page serves."""

import http.client
import time
import warnings
from collections.abc import Hashable, Iterator
from pathlib import Path

from onebot_bringup.serving.ports import LOOPBACK
from onebot_bringup.serving.rerun_messages import (
    GRPC_WEB,
    HEAD,
    LAYOUT,
    REQUEST,
    SERVICE,
    content,
    length,
    logged_ns,
    subject,
)
from onebot_description.errors import OneBotError
from onebot_description.ros.parameters.bounded_yaml import open_regular

_STARTS = (b"RRF", b"RRIO")  # any version of Rerun writes one of them
_FILE_HEAD = 12  # bytes: magic number, version and options
_NOTHING = 200  # bytes; a shorter file has no complete message
_PROPERTIES = "/__properties"  # the recording's name and start


def check_rrd(rrd: Path) -> None:
    """Check that a file begins as Rerun's recordings do.

    Raises:
        OneBotError: it does not, or it is missing or empty.
    """
    try:
        with open_regular(rrd) as file:
            start = file.read(4)
            size = file.seek(0, 2)
    except FileNotFoundError:
        raise OneBotError(f"there is no recording {rrd}") from None
    except OSError as error:
        raise OneBotError(f"{rrd}: {error.strerror}") from error
    if not start:
        raise OneBotError(f"{rrd} is empty")
    if not start.startswith(_STARTS):
        raise OneBotError(f"{rrd} is no recording of Rerun")
    if size < _NOTHING:
        raise OneBotError(f"{rrd} was cut short before anything was in it")


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


# --- what a page serves ---------------------------------------------------------------------------

_QUIET = 5.0  # seconds without a message, after which nothing moves
_PATIENCE = 60.0  # seconds
_LARGE = 1 << 14  # bytes: pictures, clouds and maps, of which only the newest is drawn


def save_served(port: int, rrd: Path) -> None:
    """Save the recording that a page serves now.

    Args:
        port: the page's port on 127.0.0.1.
        rrd: the file to write.

    Raises:
        OneBotError: the page does not respond.
    """
    messages: dict[Hashable, bytes] = {}
    try:
        for message in _served(port):
            about = subject(message) if len(message) > _LARGE else object()
            messages.pop(about, None)
            messages[about] = message
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise OneBotError(f"the viewer's page at port {port} does not respond: {error}") from error
    with rrd.open("wb") as file:
        file.write(_file_head())
        for message in messages.values():
            kind, data = content(message)
            file.write(kind.to_bytes(8, "little") + len(data).to_bytes(8, "little") + data)


def _served(port: int) -> Iterator[bytes]:
    """Yield the messages of a page until the layout and current data have come, or none comes."""
    now_ns, deadline = time.time_ns(), time.monotonic() + _PATIENCE
    laid_out = False
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=_PATIENCE)
    try:
        headers = {"Content-Type": GRPC_WEB}
        connection.request("POST", f"/{SERVICE}/ReadMessages", REQUEST, headers)
        response = connection.getresponse()
        if response.status != http.HTTPStatus.OK:
            raise http.client.HTTPException(f"{response.status} {response.reason}")
        connection.sock.settimeout(_QUIET)
        while time.monotonic() < deadline:
            head = response.read(HEAD)
            message = head + response.read(length(head))
            if len(message) <= HEAD or head[0]:
                return  # the server has closed the stream
            yield message
            laid_out = laid_out or content(message)[0] == LAYOUT
            if laid_out and logged_ns(message) > now_ns:
                return
    except TimeoutError:
        pass
    finally:
        connection.close()


def _file_head() -> bytes:
    """Return the bytes that files of this version of Rerun begin with."""
    import rerun as rr  # slower to import

    stream = rr.RecordingStream("onebot_head")
    return bytes(stream.memory_recording().drain_as_bytes())[:_FILE_HEAD]
