"""Draws a picture (PNG) of a recording as the viewer would show it, without any display."""

import copy
import io
import os
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient, ViewerState

from onebot_bringup.serving.ports import LOOPBACK, free_port
from onebot_bringup.viewer.blueprint import ROBOT_VIEW
from onebot_bringup.viewer.display_server import Child, open_recording
from onebot_description.atomic_write import write_whole
from onebot_description.errors import OneBotError
from onebot_description.file_watch import in_background
from onebot_description.geometry.poses import Triple

T = TypeVar("T")

NO_RENDERER = (
    "no graphics adapter was found to draw with: install Mesa's software renderer "
    "(Debian and Ubuntu: apt install mesa-vulkan-drivers)"
)
TOO_OLD = (
    "pictures need rerun-sdk 0.41 or newer, which needs Python 3.11 or newer; everything else "
    "works without it"
)
PATIENCE = 60.0  # seconds
_REPORT_AFTER = 2.0  # seconds
_PAUSE = 0.05  # seconds
Progress = Callable[[str], None]
# A view may briefly report an error while its data comes in; after this time (seconds), the error
# is part of the picture.
_LASTING = 5.0
# A file that cannot be loaded leaves a trace only in the log; this is the time to wait for it.
_LOST = 1.0  # seconds
# The window's frame, above the viewer itself, is empty when the top panel is hidden (pixels).
_TITLE_BAR = 37
# Maximum margins, in x and y, around a view that fills the window (pixels); they are cut off.
_AROUND = (12, 76)
_ALIKE = 3  # equal pictures in a row after which the picture counts as still


@dataclass(frozen=True)
class Framing:
    """What a picture shows, and from where."""

    dashboard: bool = True  # the whole layout with its plots; False: only the robot
    eye: Triple | None = None  # position of the eye, m in the fixed frame; None: as in the layout
    target: Triple | None = None  # the point in the middle of the picture, likewise


def render(
    source: Path,
    png: Path,
    width: int = 1280,
    height: int = 720,
    *,
    framing: Framing | None = None,
    progress: Progress = print,
) -> None:
    """Draw the end of a recording into ``png``, with the layout saved in it.

    The file is written only once the picture is complete, and then replaces an existing one.

    Args:
        source: the recording's file.
        png: the picture to write.
        width: width of the picture, pixels.
        height: height of the picture, pixels.
        framing: what the picture shows; None for the whole layout unchanged.
        progress: called with what is being waited for, if that takes over two seconds.

    Raises:
        OneBotError: there is nothing to draw, nothing to draw with, or nothing in 3D.
    """
    framing = framing or Framing()
    around = (0, _TITLE_BAR) if framing.dashboard else _AROUND
    window = width + around[0], height + around[1]
    # The path is absolute, since a name that begins with a dash would be read as an option.
    with headless_viewer(str(source.absolute()), *window, progress) as client:
        # Show the end, even of a recording that plays from its beginning. If a recording has no
        # time, only static data, the viewer would wait for one forever and answer nothing else.
        if any(recording.timelines for recording in client.get_state().recordings):
            client.set_time(play_state="following")
        view = _frame(client, framing)
        shot = Image.open(io.BytesIO(still(client, progress, view)))
    # The title bar's height is in logical points; without a display, a point is one pixel.
    left, top = 0, _TITLE_BAR
    if view is not None:  # the center stays the center
        left, top = (shot.width - width) // 2, (shot.height - height) // 2
    data = io.BytesIO()
    shot.crop((left, top, left + width, top + height)).save(data, "PNG")
    try:
        write_whole(png, data.getvalue())
    except OSError as error:
        raise OneBotError(f"{png}: {error.strerror}") from error


def _frame(client: ViewerClient, framing: Framing) -> str | None:
    """Arrange the viewer; return the id of the view to draw, or None for all of them."""
    if framing == Framing():
        return None  # the layout is shown unchanged, so no view of the robot is needed
    state = client.get_state()
    view = robot_view_id({view.view_id: (view.view_class, view.name) for view in state.views})
    layout = client.get_blueprint().blueprint
    client.set_blueprint(framed(layout, view, framing), store_id=state.active_recording)
    return None if framing.dashboard else view


def still(client: ViewerClient, progress: Progress = print, view: str | None = None) -> bytes:
    """Return a PNG of the window, or of ``view``, once three in a row are equal and complete.

    Args:
        client: the viewer to draw.
        progress: called with what is being waited for, if that takes over two seconds.
        view: a view's id; None for the whole window.
    """
    shots: deque[bytes] = deque(maxlen=_ALIKE)

    def is_still() -> bool:
        shots.append(client.take_screenshot(view))
        alike = len(shots) == _ALIKE and len(set(shots)) == 1
        return alike and not client.get_state().loading

    _wait(is_still, progress, lambda: "it is still changing")
    return shots[-1]


def _wait(done: Callable[[], T], progress: Progress, what: Callable[[], str]) -> T:
    """Return ``done()`` once it is true, or after a minute; report ``what()`` it waits for."""
    start = reported = time.monotonic()
    while True:
        value, now = done(), time.monotonic()
        if value or now - start > PATIENCE:
            return value
        if now - reported > _REPORT_AFTER:
            reported = now
            progress(f"waiting for the picture: {what()} ({now - start:.0f} s)")
        time.sleep(_PAUSE)


# --- the layout of the picture --------------------------------------------------------------------

LayoutValues = Mapping[str, Any]

_PANELS = {
    "/blueprint_panel": "PanelBlueprint",
    "/selection_panel": "PanelBlueprint",
    "/time_panel": "TimePanelBlueprint",
    "/top_panel": "PanelBlueprint",
}


def robot_view_id(views: Mapping[str, tuple[str, str]]) -> str:
    """Return the id of the view that shows the robot in 3D.

    Args:
        views: the class and name of each view, by its id.

    Raises:
        OneBotError: no view is in 3D.
    """
    in_space = [identity for identity, (kind, _) in views.items() if kind == "3D"]
    named = [identity for identity in in_space if views[identity][1] == ROBOT_VIEW]
    if not in_space:
        raise OneBotError("the recording has no view in 3D; --dashboard draws those that it has")
    return (named or in_space)[0]


def framed(layout: LayoutValues, view: str, framing: Framing) -> dict[str, Any]:
    """Return the viewer's ``layout`` with the changes of ``framing``.

    Args:
        layout: the viewer's layout, by entity paths of the blueprint.
        view: the id of the robot's view.
        framing: what the picture shows.
    """
    changed = copy.deepcopy(dict(layout))
    if not framing.dashboard:
        for path, archetype in _PANELS.items():
            _entry(changed, path, archetype)["state"] = "Hidden"
        _entry(changed, "/viewport", "ViewportBlueprint")["maximized"] = view
    if framing.eye is not None or framing.target is not None:
        controls = _entry(changed, f"/view/{view}/EyeControls3D", "EyeControls3D")
        # Following an entity would move the eye away from the given position.
        controls.pop("tracking_entity", None)
        controls.setdefault("kind", "Orbital")
        if framing.eye is not None:
            controls["position"] = list(framing.eye)
        if framing.target is not None:
            controls["look_target"] = list(framing.target)
    return changed


def _entry(layout: dict[str, Any], path: str, archetype: str) -> dict[str, Any]:
    entry: dict[str, Any] = layout.setdefault(path, {}).setdefault(archetype, {})
    return entry


# --- the viewer without a window ------------------------------------------------------------------


@contextmanager
def headless_viewer(
    source: str, width: int = 1280, height: int = 720, progress: Progress = print
) -> Iterator[ViewerClient]:
    """Show ``source`` (a file or a server's address) in a viewer without a window.

    Args:
        source: the file or address.
        width: width of the window, pixels.
        height: height of the window, pixels.
        progress: called with what is being waited for, if that takes over two seconds.

    Yields:
        The viewer's client, once everything is loaded and shown, except for lasting errors.

    Raises:
        OneBotError: there is no graphics adapter, or nothing is shown within a minute.
    """
    if not hasattr(ViewerClient, "get_state"):
        raise OneBotError(TOO_OLD)
    port = free_port()
    size = f"{width}x{height}"
    child = Child(
        ["--headless", "--port", str(port), "--window-size", size, "--hide-welcome-screen", source],
        {
            "RUST_LOG": "error",  # a warning of the software renderer would pop up in the picture
            # Without Vulkan, the viewer would try OpenGL, which needs a display, and crash.
            "WGPU_BACKEND": os.environ.get("WGPU_BACKEND", "vulkan"),
        },
    )
    try:
        connect = partial(ViewerClient.connect, f"rerun+http://{LOOPBACK}:{port}/proxy")
        client = _ask(connect, child, progress, "is starting", (OSError, RuntimeError))
        patient = cast(ViewerClient, _PatientClient(client, child, progress))
        _load(patient, source, progress)
        yield patient
    finally:
        child.stop()


def renderer_problem() -> str:
    """Draw an empty picture; return why this computer cannot, or "" if it can."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "nothing.rrd")
        recording = open_recording(save=path)
        recording.stream.send_blueprint(rrb.Blueprint(rrb.TextDocumentView(origin="/text")))
        recording.stream.log("text", rr.TextDocument("nothing"), static=True)
        recording.close()
        try:
            with headless_viewer(str(path), 320, 240, progress=lambda _: None):
                return ""
        except OneBotError as error:
            return str(error)


def _ask(
    call: Callable[[], T],
    child: Child,
    progress: Progress,
    doing: str = "is busy",
    passing: tuple[type[Exception], ...] = (OSError,),
) -> T:
    """Call the viewer until it answers, and return its answer.

    Args:
        call: the call.
        child: the viewer's process.
        progress: called with ``doing``, if the answer takes over two seconds.
        doing: what the viewer does meanwhile.
        passing: errors after which to call again (a TimeoutError is an OSError).

    Raises:
        OneBotError: the viewer has ended, or has not answered within a minute.
    """
    answer = in_background(call)

    def is_answered() -> bool:
        nonlocal answer
        if not wait([answer], timeout=_PAUSE).done:
            return False
        if not isinstance(answer.exception(), passing):
            return True
        if not child.running:
            found_adapter = "adapter" not in child.output().lower()
            why = f"the viewer ended: {child.last_words()}" if found_adapter else NO_RENDERER
            raise OneBotError(why)
        answer = in_background(call)
        return False

    if not _wait(is_answered, progress, lambda: f"the viewer {doing}"):
        raise OneBotError(f"the viewer has not answered for {PATIENCE:.0f} s")
    return answer.result()


class _PatientClient:
    """A viewer's client that retries calls if a busy machine was too slow to answer."""

    def __init__(self, client: ViewerClient, child: Child, progress: Progress) -> None:
        self._client, self._child, self._progress = client, child, progress

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)
        return lambda *args, **kwargs: _ask(
            partial(method, *args, **kwargs), self._child, self._progress
        )


def _load(client: ViewerClient, source: str, progress: Progress) -> None:
    """Wait until the viewer's views are loaded and shown, without errors or with lasting ones."""
    start = since = time.monotonic()
    state, errors = client.get_state(), list[str]()

    def is_shown() -> bool:
        nonlocal state, errors, since
        state, now = client.get_state(), time.monotonic()
        if not (state.recordings or state.loading) and now - start > _LOST:
            _raise_logged(client, source)
        is_loaded = bool(state.views) and not state.loading
        if _reports(state) != errors or not is_loaded:
            errors, since = _reports(state), now
        return is_loaded and (not errors or now - since > _LASTING)

    if not _wait(is_shown, progress, lambda: _unfinished(state)) and not state.views:
        raise OneBotError(f"nothing was shown within {PATIENCE:.0f} s: {_unfinished(state)}")
    if _reports(state):  # a user of the viewer would see them, too
        progress(f"the picture shows an error: {_unfinished(state)}")


def _raise_logged(client: ViewerClient, source: str) -> None:
    for entry in client.get_logs():
        if entry.level == "ERROR":
            reason = entry.message.splitlines()[0].rpartition(": ")[2]
            raise OneBotError(f"{source} cannot be shown: {reason}")


def _reports(state: ViewerState) -> list[str]:
    return [f"{view.name}: {report.summary}" for view in state.views for report in view.reports]


def _unfinished(state: ViewerState) -> str:
    loading = [source.status or source.name for source in state.loading]
    return "; ".join([*loading, *_reports(state)][:3]) or "the viewer has no view yet"
