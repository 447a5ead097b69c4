"""A picture of a recording, drawn without any display: what the viewer would show, as a PNG."""

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

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient, ViewerState

from onebot_bringup.serving.ports import LOOPBACK, free_port
from onebot_bringup.viewer.blueprint import ROBOT_VIEW
from onebot_bringup.viewer.display_server import Child
from onebot_description.description.description import Triple
from onebot_description.errors import OneBotError
from onebot_description.file_watch import in_background
from onebot_description.whole_file import write_whole

T = TypeVar("T")

NO_RENDERER = (
    "no graphics adapter was found to draw with: install Mesa's software renderer "
    "(Debian and Ubuntu: apt install mesa-vulkan-drivers)"
)
TOO_OLD = (
    "pictures need rerun-sdk 0.41 or newer, and that needs Python 3.11 or newer; everything else "
    "works without"
)
PATIENCE = 60.0  # seconds
_REPORT_AFTER = 2.0  # seconds
_PAUSE = 0.05  # seconds
Progress = Callable[[str], None]
# A view may report an error for a moment, while its data come in; a lasting error belongs to the
# picture. It has to outlast both, so that neither a slow nor a quick machine ends it early.
_LASTING = 5.0  # seconds
_POLLS = 20
# A file that cannot be loaded leaves no trace but in the log; time for it to get there.
_LOST = 1.0  # seconds
# The window's frame, above the viewer itself, is empty when the top panel is hidden (pixels).
_TITLE_BAR = 37
# What surrounds a view that fills the window: less than this, and cut off evenly (pixels).
_AROUND = (12, 76)
_ALIKE = 3  # pictures in a row that make a still one


@dataclass(frozen=True)
class Framing:
    """How to frame a picture."""

    dashboard: bool = True  # the whole layout with its plots; False: the robot alone
    eye: Triple | None = None  # eye, m in the fixed frame; None: as in the layout
    target: Triple | None = None  # point in the middle of the picture

    @property
    def as_it_is(self) -> bool:
        """The layout is shown as it is."""
        return self == Framing()

    @property
    def of_robot(self) -> bool:
        """It takes a view of the robot."""
        return not self.dashboard or self.eye is not None or self.target is not None


def render(
    source: Path,
    png: Path,
    width: int = 1280,
    height: int = 720,
    *,
    framing: Framing | None = None,
    progress: Progress = print,
) -> None:
    """Draw a recording at its end into ``png``, with the layout saved in it.

    The picture is there as a whole or not at all: one of that name is replaced at the end.

    Args:
        source: the recording's file.
        png: the picture to write.
        width: pixels.
        height: pixels.
        framing: what is in the picture; None for the whole layout as it is.
        progress: called with what it waits for, when that takes over two seconds.

    Raises:
        OneBotError: there is no such recording, nothing to draw with, or nothing in 3D.
    """
    if not source.is_file():
        raise OneBotError(f"there is no recording {source}")
    framing = framing or Framing()
    around = (0, _TITLE_BAR) if framing.dashboard else _AROUND
    window = width + around[0], height + around[1]
    # Absolute: a name that begins with a dash would be an option.
    with headless_viewer(str(source.absolute()), *window, progress) as client:
        freeze(client)
        view = _frame(client, framing)
        shot = Image.open(io.BytesIO(still(client, progress, view)))
    # The title bar's height is in logical points, one pixel each without a display.
    left, top = (0, _TITLE_BAR) if view is None else _margins(shot, width, height)
    data = io.BytesIO()
    shot.crop((left, top, left + width, top + height)).save(data, "PNG")
    try:
        write_whole(png, data.getvalue())
    except OSError as error:
        raise OneBotError(f"{png}: {error.strerror}") from error


def _frame(client: ViewerClient, framing: Framing) -> str | None:
    """Arrange the viewer; return the view that is the picture, None for all of them."""
    if framing.as_it_is:
        return None
    state = client.get_state()
    view = ""
    if framing.of_robot:
        view = robot_view_id({view.view_id: (view.view_class, view.name) for view in state.views})
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


def still(client: ViewerClient, progress: Progress = print, view: str | None = None) -> bytes:
    """Return a PNG of the window, or of one view, once three in a row are equal and complete."""
    shots: deque[bytes] = deque(maxlen=_ALIKE)

    def is_still() -> bool:
        shots.append(client.take_screenshot(view))
        alike = len(shots) == _ALIKE and len(set(shots)) == 1
        return alike and not client.get_state().loading

    _wait(is_still, progress, lambda: "it still changes")
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
    """Return the view that shows the robot in space, of the class and name of each view, by its id.

    Raises:
        OneBotError: none of them shows anything in space.
    """
    in_space = [identity for identity, (kind, _) in views.items() if kind == "3D"]
    named = [identity for identity in in_space if views[identity][1] == ROBOT_VIEW]
    if not in_space:
        raise OneBotError(
            "the recording has no view in 3D; --dashboard gives a picture of those it has"
        )
    return (named or in_space)[0]


def framed(layout: LayoutValues, view: str, framing: Framing) -> dict[str, Any]:
    """Return the viewer's ``layout`` as ``framing`` wants it; ``view`` is the robot's, by id."""
    changed = copy.deepcopy(dict(layout))
    for path, archetype in _PANELS.items():
        if not framing.dashboard:
            _entry(changed, path, archetype)["state"] = "Hidden"
    if not framing.dashboard:
        _entry(changed, "/viewport", "ViewportBlueprint")["maximized"] = view
    if framing.eye is not None or framing.target is not None:
        controls = _entry(changed, f"/view/{view}/EyeControls3D", "EyeControls3D")
        # To follow something would move the eye away from the place that was given.
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
        connect = partial(ViewerClient.connect, f"rerun+http://{LOOPBACK}:{port}/proxy")
        client = _ask(connect, child, progress, "starts", (OSError, RuntimeError))
        patient = cast(ViewerClient, _PatientClient(client, child, progress))
        _load(patient, source, progress)
        yield patient
    finally:
        child.stop()


def renderer_problem() -> str:
    """Return why this computer cannot draw pictures; "" if it can. It draws an empty one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "nothing.rrd")
        stream = rr.RecordingStream("onebot_renderer")
        stream.set_sinks(rr.FileSink(path))
        stream.send_blueprint(rrb.Blueprint(rrb.TextDocumentView(origin="/text")))
        stream.log("text", rr.TextDocument("nothing"), static=True)
        stream.disconnect()
        try:
            with headless_viewer(str(path), 320, 240):
                return ""
        except OneBotError as error:
            return str(error)


def is_complete(state: ViewerState) -> bool:
    """Return whether everything is loaded and no view reports an error."""
    return _is_loaded(state) and not _reports(state)


def freeze(client: ViewerClient) -> None:
    """Stop at the end of what is there now, whatever comes in or plays on."""
    timeline = _timeline(client)
    if timeline is not None:
        name, end, kind = timeline
        client.set_time(name, play_state="paused", **_moment(kind, end))


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


def _ask(
    call: Callable[[], T],
    child: Child,
    progress: Progress,
    doing: str = "is busy",
    passing: tuple[type[Exception], ...] = (OSError,),
) -> T:
    """Return what a call to the viewer returns; call again where the viewer was too slow.

    It raises one of ``passing`` then (a TimeoutError is an OSError), while the viewer is ``doing``
    something. A viewer that has ended, or does not answer within a minute, is an OneBotError.
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
    """A viewer's client that asks again where a busy machine was too slow to answer in time."""

    def __init__(self, client: ViewerClient, child: Child, progress: Progress) -> None:
        self._client, self._child, self._progress = client, child, progress

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)
        return lambda *args, **kwargs: _ask(
            partial(method, *args, **kwargs), self._child, self._progress
        )


def _load(client: ViewerClient, source: str, progress: Progress) -> None:
    """Wait until the viewer shows its views, loaded and without errors, or with lasting ones."""
    start = since = time.monotonic()
    state, errors, polls = client.get_state(), list[str](), 0

    def is_shown() -> bool:
        nonlocal state, errors, since, polls
        state, now = client.get_state(), time.monotonic()
        if not (state.recordings or state.loading) and now - start > _LOST:
            _raise_logged(client, source)
        if _reports(state) != errors or not _is_loaded(state):
            errors, since, polls = _reports(state), now, 0
        polls += 1
        return is_complete(state) or (polls > _POLLS and now - since > _LASTING)

    if not _wait(is_shown, progress, lambda: _unfinished(state)) and not state.views:
        raise OneBotError(f"nothing was shown within {PATIENCE:.0f} s: {_unfinished(state)}")
    if _reports(state):  # a user would see them, too
        progress(f"the picture shows an error: {_unfinished(state)}")


def _raise_logged(client: ViewerClient, source: str) -> None:
    for entry in client.get_logs():
        if entry.level == "ERROR":
            reason = entry.message.splitlines()[0].rpartition(": ")[2]
            raise OneBotError(f"{source} cannot be shown: {reason}")


def _is_loaded(state: ViewerState) -> bool:
    return bool(state.views) and not state.loading


def _reports(state: ViewerState) -> list[str]:
    return [f"{view.name}: {report.summary}" for view in state.views for report in view.reports]


def _unfinished(state: ViewerState) -> str:
    loading = [source.status or source.name for source in state.loading]
    return "; ".join([*loading, *_reports(state)][:3]) or "the viewer has no view yet"
