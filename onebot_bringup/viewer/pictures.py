"""A picture of a recording, drawn without any display: what the viewer would show, as a PNG."""

import contextlib
import copy
import io
import os
import tempfile
import time
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
# A view may report an error for a moment, while its data come in; one that lasts belongs to the
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
    eye: Triple | None = None  # where to look from, m in the fixed frame; None: as in the layout
    target: Triple | None = None  # where to look at
    time_panel: bool = True  # the dashboard's, in which a growing recording is never still

    @property
    def as_it_is(self) -> bool:
        """The layout is shown as it is."""
        return self == Framing()

    @property
    def of_robot(self) -> bool:
        """It takes a view of the robot."""
        return not self.dashboard or self.eye is not None or self.target is not None


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
        progress: called with what it waits for, when that takes over two seconds.

    Raises:
        OneBotError: there is no such recording, nothing to draw with, or nothing in 3D.
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
    """Return a PNG once three in a row are equal and complete, or the last one after a minute.

    Args:
        client: the viewer's.
        progress: called with what it waits for, when that takes over two seconds.
        view: of this view only; None for the whole window.
    """
    start = reported = time.monotonic()
    shots: list[bytes] = []
    while True:
        shots = [*shots[1 - _ALIKE :], client.take_screenshot(view)]
        if len(shots) == _ALIKE and len(set(shots)) == 1 and not client.get_state().loading:
            return shots[-1]
        now = time.monotonic()
        if now - start > PATIENCE:
            return shots[-1]
        if now - reported > _REPORT_AFTER:
            reported = now
            progress(f"waiting for the picture: it still changes ({now - start:.0f} s)")


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


# --- what of the layout is in the picture ---------------------------------------------------------

LayoutValues = Mapping[str, Any]

_TIME = "/time_panel"
_PANELS = {
    "/blueprint_panel": "PanelBlueprint",
    "/selection_panel": "PanelBlueprint",
    _TIME: "TimePanelBlueprint",
    "/top_panel": "PanelBlueprint",
}


def robot_view_id(views: Mapping[str, tuple[str, str]]) -> str:
    """Return the view that shows the robot in space.

    Args:
        views: class and name of each view, by its id.

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
    """Return ``layout`` as ``framing`` wants it.

    Args:
        layout: what the viewer shows now.
        view: the id of the robot's view in it; "" if ``framing`` takes none.
        framing: what is to be in the picture.
    """
    changed = copy.deepcopy(dict(layout))
    for path, archetype in _PANELS.items():
        if not framing.dashboard or (path == _TIME and not framing.time_panel):
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
        client = _Loading(child, port, source, progress).client()
        yield cast(ViewerClient, _PatientClient(client, child, progress))
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


def freeze(client: ViewerClient, not_before_ns: int = 0, progress: Progress = print) -> None:
    """Stop at the end of what is there now, whatever comes in or plays on.

    Args:
        client: the viewer's.
        not_before_ns: wait until there is something of that time, nanoseconds on the timeline.
        progress: called with what it waits for, when that takes over two seconds.
    """
    start = reported = time.monotonic()
    while (found := _timeline(client)) is not None:
        line, end, kind = found
        client.set_time(line, play_state="paused", **_moment(kind, end))
        now = time.monotonic()
        if end >= not_before_ns or now - start > PATIENCE:
            return
        if now - reported > _REPORT_AFTER:
            reported = now
            progress(f"waiting for the picture: the history comes in ({now - start:.0f} s)")
        time.sleep(_PAUSE)


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


def _answer(call: Callable[[], T], progress: Progress) -> T:
    """Return what a call to the viewer returns; report while it takes, and end after a minute."""
    start = time.monotonic()
    answer = in_background(call)
    while not wait([answer], timeout=_REPORT_AFTER).done:
        seconds = time.monotonic() - start
        if seconds > PATIENCE:
            raise OneBotError(f"the viewer has not answered for {PATIENCE:.0f} s")
        progress(f"waiting for the picture: the viewer is busy ({seconds:.0f} s)")
    return answer.result()


class _PatientClient:
    """A viewer's client that asks again where a busy machine was too slow to answer in time."""

    def __init__(self, client: ViewerClient, child: Child, progress: Progress) -> None:
        self._client, self._child, self._progress = client, child, progress

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._client, name)

        def ask(*args: Any, **kwargs: Any) -> Any:
            start = time.monotonic()
            while True:
                try:
                    return _answer(partial(method, *args, **kwargs), self._progress)
                except OSError as error:  # a TimeoutError is one, too
                    if not self._child.running:
                        raise OneBotError(_why(self._child)) from None
                    if time.monotonic() - start > PATIENCE:
                        text = f"the viewer has not answered for {PATIENCE:.0f} s: {error}"
                        raise OneBotError(text) from None
                    time.sleep(_PAUSE)

        return ask


class _Loading:
    """Waits until the viewer shows its views, loaded and free of errors."""

    def __init__(self, child: Child, port: int, source: str, progress: Progress) -> None:
        self._child = child
        self._address = f"rerun+http://{LOOPBACK}:{port}/proxy"
        self._source = source
        self._progress = progress
        self._client: ViewerClient | None = None
        self._start = self._reported = time.monotonic()
        # Errors that views report, since when, and how often they were the same.
        self._errors: tuple[list[str], float, int] = ([], self._start, 0)

    def client(self) -> ViewerClient:
        state = None
        while time.monotonic() - self._start < PATIENCE:
            if not self._child.running:
                raise OneBotError(_why(self._child))
            try:
                connect = partial(ViewerClient.connect, self._address)
                self._client = self._client or _answer(connect, self._progress)
                state = _answer(self._client.get_state, self._progress)
                if is_complete(state) or self._has_lasting_errors(state):
                    return self._client
                self._check_loading(state)
            except (RuntimeError, OSError):
                self._client = None  # it does not listen yet
            self._report(state)
            time.sleep(_PAUSE)
        if self._client is not None and state is not None and state.views:
            return self._client  # with errors in the picture, which is what a user would see, too
        raise OneBotError(f"nothing was shown within {PATIENCE:.0f} s: {_unfinished(state)}")

    def _has_lasting_errors(self, state: ViewerState) -> bool:
        """Whether views have reported the same errors for long, with everything loaded."""
        reports, now = _reports(state), time.monotonic()
        known, since, polls = self._errors
        if reports != known or not _is_loaded(state):
            self._errors = (reports, now, 0)
            return False
        self._errors = (known, since, polls + 1)
        if now - since < _LASTING or polls < _POLLS:
            return False
        self._progress(f"the picture shows an error: {_unfinished(state)}")
        return True

    def _check_loading(self, state: ViewerState) -> None:
        if state.recordings or state.loading or time.monotonic() - self._start < _LOST:
            return
        assert self._client is not None
        for entry in _answer(self._client.get_logs, self._progress):
            if entry.level == "ERROR":
                reason = entry.message.splitlines()[0].rpartition(": ")[2]
                raise OneBotError(
                    f"{self._source} cannot be shown: {reason}; of a .rrd file that was cut short, "
                    f"rerun rrd merge --continue-on-error -o whole.rrd {self._source} copies what "
                    "is whole"
                )

    def _report(self, state: ViewerState | None) -> None:
        now = time.monotonic()
        if now - self._reported > _REPORT_AFTER:
            self._reported = now
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
