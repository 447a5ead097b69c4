"""A picture of a recording, drawn without any display: what the viewer would show, as a PNG."""

import contextlib
import io
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

from onebot_bringup.viewer.framing import Framing, framed, robot_view
from onebot_bringup.viewer.headless import (
    NO_RENDERER,
    PATIENCE,
    TOO_OLD,
    Progress,
    UnreadableError,
    freeze,
    headless_viewer,
    is_complete,
)
from onebot_description.errors import OneBotError

__all__ = [
    "NO_RENDERER",
    "TOO_OLD",
    "Framing",
    "UnreadableError",
    "check_picture",
    "headless_viewer",
    "is_complete",
    "render",
    "still",
]

# The window's frame, above the viewer itself, is empty when the top panel is hidden (pixels).
_TITLE_BAR = 37
# What surrounds a view that fills the window: less than this, and cut off evenly (pixels).
_AROUND = (12, 76)
_ALIKE = 3  # pictures in a row that make a still one


def render(
    source: Path | str,
    png: Path,
    width: int = 1280,
    height: int = 720,
    *,
    framing: Framing | None = None,
    not_before_ns: int = 0,
    progress: Progress = print,
) -> None:
    """Draw a recording at its end into ``png``, with the layout saved in it.

    The picture is there as a whole or not at all: one of that name is replaced at the end.

    Args:
        source: the recording's file, or the address of a server of one.
        png: the picture to write.
        width: pixels.
        height: pixels.
        framing: what is in the picture; None for the whole layout as it is.
        not_before_ns: a time that the recording has to reach first, nanoseconds: a server sends
            what was before its viewers came, the oldest first.
        progress: told what is waited for, when that takes over two seconds.

    Raises:
        OneBotError: there is no such recording, nothing to draw with, or nothing in 3D.
        UnreadableError: the recording cannot be read.
    """
    if isinstance(source, Path) and not source.is_file():
        raise OneBotError(f"there is no recording {source}")
    framing = framing or Framing()
    around = (0, _TITLE_BAR) if framing.dashboard else _AROUND
    window = width + around[0], height + around[1]
    # Absolute: a name that begins with a dash would be an option.
    address = str(source.absolute()) if isinstance(source, Path) else source
    with headless_viewer(address, *window, progress) as client:
        freeze(client, not_before_ns, progress)
        view = _frame(client, framing)
        shot = Image.open(io.BytesIO(still(client, progress, view)))
    # The title bar's height is in logical points, one pixel each without a display.
    left, top = (0, _TITLE_BAR) if view is None else _margins(shot, width, height)
    with _replacing(png) as file:
        shot.crop((left, top, left + width, top + height)).save(file, "PNG")


def check_picture(png: Path) -> None:
    """Refuse a picture that cannot be written, before any work is done for it.

    Raises:
        OneBotError: with what is wrong.
    """
    if png.suffix.lower() != ".png":
        raise OneBotError(f"{png}: a picture's name must end in .png")
    if not png.parent.is_dir():
        raise OneBotError(f"{png}: there is no folder {png.parent}")
    if png.is_dir():
        raise OneBotError(f"{png}: is a folder")
    if not os.access(png.parent, os.W_OK):
        raise OneBotError(f"{png}: the folder {png.parent} cannot be written to")


def still(client: ViewerClient, progress: Progress = print, view: str | None = None) -> bytes:
    """Return a PNG once three in a row are equal and complete, or the last one after a minute.

    Args:
        client: the viewer's.
        progress: told what is waited for, when that takes over two seconds.
        view: of this view only; None for the whole window.
    """
    start = told = time.monotonic()
    shots: list[bytes] = []
    while True:
        shots = [*shots[1 - _ALIKE :], client.take_screenshot(view)]
        if len(shots) == _ALIKE and len(set(shots)) == 1 and not client.get_state().loading:
            return shots[-1]
        now = time.monotonic()
        if now - start > PATIENCE:
            return shots[-1]
        if now - told > 2.0:
            told = now
            progress(f"waiting for the picture: it still changes ({now - start:.0f} s)")


def _frame(client: ViewerClient, framing: Framing) -> str | None:
    """Arrange the viewer; return the view that is the picture, None for all of them."""
    if framing.as_it_is:
        return None
    state = client.get_state()
    view = ""
    if framing.of_robot:
        view = robot_view({view.view_id: (view.view_class, view.name) for view in state.views})
    layout = client.get_blueprint().blueprint
    client.set_blueprint(framed(layout, view, framing), store_id=state.active_recording)
    return None if framing.dashboard else view


def _margins(shot: Image.Image, width: int, height: int) -> tuple[int, int]:
    """What to leave out at the left and at the top, so that the middle stays the middle."""
    spare = shot.width - width, shot.height - height
    if min(spare) < 0:
        raise OneBotError(
            f"the viewer drew {shot.width} x {shot.height} pixels instead of {width} x {height}"
        )
    return spare[0] // 2, spare[1] // 2


@contextlib.contextmanager
def _replacing(path: Path) -> "Iterator[io.BufferedWriter]":
    """Write a file beside ``path`` that takes its place once it is whole."""
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix, delete=False
        ) as file:
            try:
                yield file  # type: ignore[misc]
                file.flush()
                os.chmod(file.name, 0o666 & ~_umask())
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise
    except OSError as error:
        raise OneBotError(f"{path}: {error.strerror}") from error


def _umask() -> int:
    """What new files are not: temporary ones are their owner's only."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
