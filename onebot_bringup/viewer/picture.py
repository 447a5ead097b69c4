"""A picture of a recording, drawn without any display: what the viewer would show, as a PNG."""

import io
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
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
Progress = Callable[[str], None]
# The window's frame, above the viewer itself, is empty when the top panel is hidden (pixels).
_TITLE_BAR = 37
_PATIENCE = 60.0  # seconds


def render(
    rrd: Path,
    png: Path,
    width: int = 1280,
    height: int = 720,
    *,
    progress: Progress = print,
) -> None:
    """Draw the recording ``rrd`` at its end, with the view saved in it, into ``png``.

    Args:
        rrd: the recording.
        png: the picture to write.
        width: pixels.
        height: pixels.
        progress: told what is waited for, when that takes over two seconds.

    Raises:
        OneBotError: there is no such recording, or nothing to draw with.
    """
    if not rrd.is_file():
        raise OneBotError(f"there is no recording {rrd}")
    with headless_viewer(str(rrd), width, height + _TITLE_BAR, progress) as client:
        image = Image.open(io.BytesIO(still(client, progress)))
        # The title bar's height is in logical points, one pixel each without a display.
        image.crop((0, _TITLE_BAR, width, _TITLE_BAR + height)).save(png)


@contextmanager
def headless_viewer(
    source: str, width: int = 1280, height: int = 720, progress: Progress = print
) -> Iterator[ViewerClient]:
    """Show ``source`` (a file or a server's address) in a viewer without a window.

    Yields:
        Its client, once everything has been loaded and is shown without an error.

    Raises:
        OneBotError: there is nothing to draw with, or nothing is shown in a minute.
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
        yield _settled(child, port, progress)
    finally:
        child.stop()


def _settled(child: Child, port: int, progress: Progress) -> ViewerClient:
    """Wait until the viewer shows its views, loaded and free of errors."""
    start = told = time.monotonic()
    state = None
    client: ViewerClient | None = None
    while (now := time.monotonic()) - start < _PATIENCE:
        if not child.running:
            raise OneBotError(_why(child))
        try:
            client = client or ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            state = client.get_state()
            if is_complete(state):
                return client
        except (RuntimeError, OSError):
            client = None  # it does not listen yet
        if now - told > 2.0:
            told = now
            progress(f"waiting for the picture: {_unfinished(state)} ({now - start:.0f} s)")
        time.sleep(0.1)
    if client is not None and state is not None and state.views:
        return client  # with errors in the picture, which is what a user would see, too
    raise OneBotError(f"nothing was shown within {_PATIENCE:.0f} s: {_unfinished(state)}")


def is_complete(state: ViewerState) -> bool:
    """Return whether everything is loaded and no view complains."""
    quiet = not any(view.reports for view in state.views)
    return bool(state.views) and not state.loading and quiet


def still(client: ViewerClient, progress: Progress = print) -> bytes:
    """Return a PNG once three in a row are equal, or the last one after a minute."""
    start = told = time.monotonic()
    shots: list[bytes] = []
    while len(shots) < 3 or len(set(shots[-3:])) > 1:
        shots = [*shots[-2:], client.take_screenshot()]
        now = time.monotonic()
        if now - start > _PATIENCE:
            break
        if now - told > 2.0:
            told = now
            progress(f"waiting for the picture: it still changes ({now - start:.0f} s)")
    return shots[-1]


def _unfinished(state: ViewerState | None) -> str:
    if state is None:
        return "the viewer starts"
    reports = [f"{view.name}: {report.summary}" for view in state.views for report in view.reports]
    loading = [source.status or source.name for source in state.loading]
    return "; ".join([*loading, *reports][:3]) or "the viewer has no view yet"


def _why(child: Child) -> str:
    output = child.output()
    if "adapter" in output.lower():
        return NO_RENDERER
    return f"the viewer ended: {child.last_words()}"
