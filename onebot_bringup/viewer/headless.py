"""Rerun's viewer without a window: started, loaded to the end, and held still."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from rerun.experimental import ViewerClient, ViewerState

from onebot_bringup.viewer.processes import LOOPBACK, Child, free_port
from onebot_description.errors import OneBotError

NO_RENDERER = (
    "no graphics adapter was found to draw with: install Mesa's software renderer "
    "(Debian and Ubuntu: apt install mesa-vulkan-drivers)"
)
TOO_OLD = (
    "pictures need rerun-sdk 0.41 or newer, and that needs Python 3.11 or newer; everything else "
    "works without"
)
PATIENCE = 60.0  # seconds
Progress = Callable[[str], None]
# A view may complain for a moment, while its data come in; a complaint that stays belongs to the
# picture. It has to outlast both, so that neither a slow nor a quick machine ends it early.
_COMPLAINT = 5.0  # seconds
_LOOKS = 20
# A file that cannot be loaded leaves no trace but in the log; time for it to get there.
_LOST = 1.0  # seconds


class UnreadableError(OneBotError):
    """The viewer cannot read what it is to show."""


@contextmanager
def headless_viewer(
    source: str, width: int = 1280, height: int = 720, progress: Progress = print
) -> Iterator[ViewerClient]:
    """Show ``source`` (a file or a server's address) in a viewer without a window.

    Yields:
        Its client, once everything has been loaded and is shown without an error.

    Raises:
        OneBotError: there is nothing to draw with, or nothing is shown in a minute.
        UnreadableError: the source cannot be read.
    """
    if not hasattr(ViewerClient, "get_state"):
        raise OneBotError(TOO_OLD)
    port = free_port(0)
    size = f"{width}x{height}"
    child = Child(
        ["--headless", "--port", str(port), "--window-size", size, "--hide-welcome-screen", source],
        {
            "RUST_LOG": "error",  # a warning of the software renderer would pop up in the picture
            # Without Vulkan it would try OpenGL, which needs a display, and crash.
            "WGPU_BACKEND": os.environ.get("WGPU_BACKEND", "vulkan"),
        },
    )
    try:
        yield _Settling(child, port, source, progress).client()
    finally:
        child.stop()


def is_complete(state: ViewerState) -> bool:
    """Return whether everything is loaded and no view complains."""
    return _is_loaded(state) and not _reports(state)


def freeze(client: ViewerClient, not_before_ns: int = 0, progress: Progress = print) -> None:
    """Stop at the end of what is there now, whatever comes in or plays on.

    Args:
        client: the viewer's.
        not_before_ns: wait until there is something of that time, nanoseconds on the timeline.
        progress: told that it waits, when that takes over two seconds.
    """
    start = told = time.monotonic()
    while (found := _timeline(client)) is not None:
        line, end, kind = found
        client.set_time(line, play_state="paused", **_moment(kind, end))
        now = time.monotonic()
        if end >= not_before_ns or now - start > PATIENCE:
            return
        if now - told > 2.0:
            told = now
            progress(f"waiting for the picture: the history comes in ({now - start:.0f} s)")
        time.sleep(0.05)


def _timeline(client: ViewerClient) -> tuple[str, int, str] | None:
    """The active timeline, its end and its kind; None if there is none."""
    state = client.get_state()
    for recording in state.recordings:
        if recording.store_id != state.active_recording:
            continue
        for line in recording.timelines:
            if line.name == recording.current_timeline and line.end is not None:
                return line.name, line.end, line.time_type
    return None


def _moment(kind: str, end: int) -> dict[str, Any]:
    """The end of a timeline, exactly, as ``set_time`` takes it; nanoseconds unless a sequence."""
    if kind == "timestamp":
        return {"timestamp": np.datetime64(end, "ns")}
    if kind == "duration":
        return {"duration": np.timedelta64(end, "ns")}
    return {"sequence": end}


class _Settling:
    """Waits until the viewer shows its views, loaded and free of errors."""

    def __init__(self, child: Child, port: int, source: str, progress: Progress) -> None:
        self._child = child
        self._address = f"rerun+http://{LOOPBACK}:{port}/proxy"
        self._source = source
        self._progress = progress
        self._client: ViewerClient | None = None
        self._start = self._told = time.monotonic()
        self._complaint: tuple[list[str], float, int] = ([], self._start, 0)

    def client(self) -> ViewerClient:
        state = None
        while time.monotonic() - self._start < PATIENCE:
            if not self._child.running:
                raise OneBotError(_why(self._child))
            try:
                self._client = self._client or ViewerClient.connect(self._address)
                state = self._client.get_state()
                if is_complete(state) or self._still_complains(state):
                    return self._client
                self._check_loading(state)
            except (RuntimeError, OSError):
                self._client = None  # it does not listen yet
            self._tell(state)
            time.sleep(0.05)
        if self._client is not None and state is not None and state.views:
            return self._client  # with errors in the picture, which is what a user would see, too
        raise OneBotError(f"nothing was shown within {PATIENCE:.0f} s: {_unfinished(state)}")

    def _still_complains(self, state: ViewerState) -> bool:
        """Return whether the same complaints, with everything loaded, have been there for long."""
        reports, now = _reports(state), time.monotonic()
        known, since, looks = self._complaint
        if reports != known or not _is_loaded(state):
            self._complaint = (reports, now, 0)
            return False
        self._complaint = (known, since, looks + 1)
        if now - since < _COMPLAINT or looks < _LOOKS:
            return False
        self._progress(f"the picture shows an error: {_unfinished(state)}")
        return True

    def _check_loading(self, state: ViewerState) -> None:
        if state.recordings or state.loading or time.monotonic() - self._start < _LOST:
            return
        assert self._client is not None
        for entry in self._client.get_logs():
            if entry.level == "ERROR":
                reason = entry.message.splitlines()[0].rpartition(": ")[2]
                raise UnreadableError(f"{self._source} cannot be shown: {reason}")

    def _tell(self, state: ViewerState | None) -> None:
        now = time.monotonic()
        if now - self._told > 2.0:
            self._told = now
            waited = f"({now - self._start:.0f} s)"
            self._progress(f"waiting for the picture: {_unfinished(state)} {waited}")


def _is_loaded(state: ViewerState) -> bool:
    return bool(state.views) and not state.loading


def _reports(state: ViewerState) -> list[str]:
    return [f"{view.name}: {report.summary}" for view in state.views for report in view.reports]


def _unfinished(state: ViewerState | None) -> str:
    if state is None:
        return "the viewer starts"
    loading = [source.status or source.name for source in state.loading]
    return "; ".join([*loading, *_reports(state)][:3]) or "the viewer has no view yet"


def _why(child: Child) -> str:
    output = child.output()
    if "adapter" in output.lower():
        return NO_RENDERER
    return f"the viewer ended: {child.last_words()}"
