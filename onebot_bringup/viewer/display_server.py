"""Where the robot can be seen: the recording, and the page or the window that shows it."""

import ctypes
import os
import signal
import subprocess
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Protocol
from urllib.parse import quote

import rerun as rr
import rerun_cli  # type: ignore[import-untyped]

from onebot_bringup.serving.grpc_gate import GrpcGate
from onebot_bringup.serving.ports import LOOPBACK, answers, free_port, hidden_address, listen
from onebot_description.errors import OneBotError

# Rerun's own program as a child process that can never outlive us, whatever ends us.

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LIBC = ctypes.CDLL(None)  # looked up before any fork, because the child may not allocate much


def program() -> Path:
    """Return the Rerun program itself.

    Not the ``rerun`` script: that is a Python shim, and killing it would leave the program behind.
    """
    path = Path(rerun_cli.__file__).parent / "rerun"
    if not path.is_file():
        raise OneBotError(f"there is no Rerun viewer at {path}; reinstall the rerun-sdk package")
    return path


class Child:
    """A running Rerun program."""

    def __init__(self, arguments: Sequence[str], environment: dict[str, str] | None = None) -> None:
        """Start it; all its sockets belong to 127.0.0.1, and it dies with this process.

        Call it from the main thread: Linux delivers the death signal when the *thread* that
        started the child ends.
        """
        self._output: IO[bytes] = tempfile.TemporaryFile()
        variables = {**os.environ, "RUST_LOG": "warn", "NO_COLOR": "1"}
        variables["CI"] = "true"  # keeps Rerun from sending usage statistics
        variables.update(environment or {})
        self._process = subprocess.Popen(
            [str(program()), "--bind", LOOPBACK, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            env=variables,
            start_new_session=True,  # Ctrl-C is for us; we end the child ourselves
            preexec_fn=_die_with(os.getpid()),
        )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """False once it has ended."""
        return self._process.poll() is None

    def last_words(self) -> str:
        """Return the last line it wrote, or its exit code."""
        self._output.seek(0, os.SEEK_END)
        self._output.seek(max(0, self._output.tell() - 4000))
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else f"exit code {self._process.poll()}"

    def output(self) -> str:
        """Return all it wrote."""
        self._output.seek(0)
        return self._output.read().decode(errors="replace")

    def stop(self, patience: float = 1.5) -> None:
        """Ask it to end, and make it after ``patience`` seconds."""
        if self.running:
            self._process.terminate()
            try:
                self._process.wait(patience)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._output.close()


def _die_with(parent: int) -> Callable[[], None]:
    def arrange() -> None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os._exit(1)

    return arrange


# What the user looks at: the page in a browser, or the native window.


def has_display() -> bool:
    """Return whether a window could be opened here."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class WebPage:
    """Rerun's page, hosted on loopback: Rerun's server, and a proxy that keeps it private.

    Attributes:
        port: where it listens, on 127.0.0.1.
        url: what to open in a browser.
        address: the page and its options, with the address of the recording for native viewers.
    """

    def __init__(self, port: int, recording_uri: str, data: tuple[str, int]) -> None:
        """Start hosting.

        Args:
            port: wanted port, another one is taken if it is in use (0: any).
            recording_uri: where native viewers connect.
            data: address and port of the recording's server.
        """
        from onebot_bringup.serving.http_server import ServerThread  # imports aiohttp
        from onebot_bringup.serving.rerun_proxy import page_app

        self._uri = recording_uri
        listener = listen(LOOPBACK, port, "web_port")
        self._backend = free_port(0)
        self._child = self._start()
        # persist=0: it shows this robot's view, not one remembered from another robot.
        options = "hide_welcome_screen&theme=dark&persist=0&notebook=1"
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}"
        self.address = f"{self.url}/?url={quote(recording_uri, safe=':/')}&{options}"
        self._server = ServerThread(page_app(self._backend, options, data), listener, "page")

    def _start(self) -> Child:
        return Child(["--serve-web", "--web-viewer-port", str(self._backend), self._uri])

    @property
    def ready(self) -> bool:
        """True once the page can be opened."""
        return self._child.running and answers(self._backend)

    @property
    def running(self) -> bool:
        """False if its process has ended."""
        return self._child.running

    def restart(self) -> str:
        """Host the page again after it died, at the same address; returns why it died."""
        reason = self._child.last_words()
        self._child.stop()
        self._child = self._start()
        return reason

    def open_in_browser(self) -> None:
        """Open it in the user's browser, in the background; some browsers block until they end."""
        threading.Thread(target=webbrowser.open, args=(self.url,), daemon=True).start()

    def stop(self) -> None:
        """Stop hosting."""
        self._server.stop()
        self._child.stop()


class NativeWindow:
    """Rerun's native window."""

    def __init__(self, recording_uri: str) -> None:
        """Open it.

        Raises:
            OneBotError: there is no display.
        """
        if not has_display():
            raise OneBotError(
                "viewer:=native needs a display (neither DISPLAY nor WAYLAND_DISPLAY is set); "
                "use viewer:=web and open its address, or viewer:=none save:=FILE.rrd"
            )
        port = str(free_port(0))
        self._child = Child(["--port", port, "--hide-welcome-screen", "--connect", recording_uri])

    @property
    def running(self) -> bool:
        """False once it was closed."""
        return self._child.running

    def last_words(self) -> str:
        """Return the last line it wrote."""
        return self._child.last_words()

    def stop(self) -> None:
        """Close it."""
        self._child.stop()


# The recording: served on loopback, written to a file, or both.

_CHECKING = 0.05  # seconds
_WRITING_OUT = 2.0  # seconds; Rerun goes on writing after that

# Saved blueprints (.rbl) belong to an application: never change it, or they are no longer found.
APPLICATION = "onebot"


@dataclass(frozen=True)
class Recording:
    """An open recording; the server lives as long as ``stream`` is referenced."""

    stream: rr.RecordingStream  # to log to
    file: Path | None  # the file written, or None
    port: int | None = None  # for native viewers, on 127.0.0.1; None if nothing is served
    server: tuple[str, int] = ("", 0)  # address and port of Rerun's server, which that leads to
    gate: GrpcGate | None = None  # which listens on the port

    @property
    def uri(self) -> str:
        """Where native viewers connect."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    def check_file(self, patience: float = _CHECKING) -> None:
        """Check that the file is being written, if there is one.

        Args:
            patience: seconds to wait for what is still to be written.

        Raises:
            OneBotError: it is not, and why; what was written before is kept.
        """
        if self.file is None:
            return
        try:
            self.stream.flush(timeout_sec=patience)
        except RuntimeError as error:
            if "timed out" not in str(error):
                raise OneBotError(f"save:={self.file}: {_writing_error(self.file)}") from None

    def close(self) -> None:
        """Write out everything and end the server.

        Raises:
            OneBotError: the file was not written to its end.
        """
        try:
            self.check_file(_WRITING_OUT)
        finally:
            if self.gate is not None:
                self.gate.stop()
            self.stream.disconnect()


def _writing_error(file: Path) -> str:
    """Why a file cannot be written: Rerun does not report it."""
    try:
        with file.open("ab", buffering=0) as output:
            end = output.tell()
            output.write(b"\0")
            output.truncate(end)
    except OSError as error:
        return error.strerror or str(error)
    return "could not be written to its end"


def open_recording(
    port: int | None = None, save: Path | None = None, memory_limit: str = "256MB"
) -> Recording:
    """Open a recording that is served on 127.0.0.1:``port``, written to ``save``, or both.

    Args:
        port: wanted port, another one is taken if it is in use (0: any); None serves nothing.
        save: a ``.rrd`` file, replaced if it exists.
        memory_limit: what the server keeps for viewers that join later, such as "256MB"; beyond
            it, the oldest moving data is dropped, but nothing static.

    Raises:
        OneBotError: the file cannot be written.
    """
    if save is not None:
        check_writable(save)
    listener = None if port is None else listen(LOOPBACK, port, "grpc_port")
    server = hidden_address()
    sinks: list[rr.GrpcServerSink | rr.FileSink] = []
    if listener is not None:
        sinks.append(rr.GrpcServerSink(*server, server_memory_limit=memory_limit))
    if save is not None:
        # A footer would keep a record of every chunk in memory: nothing for a run of days.
        sinks.append(rr.FileSink(save, write_footer=False))
    if not sinks:
        raise OneBotError("nothing to log to: serve the recording or save it")
    stream = rr.RecordingStream(APPLICATION)
    try:
        stream.set_sinks(*sinks)
    except RuntimeError as error:
        if save is None:
            raise OneBotError(f"the recording cannot be served: {error}") from None
        raise OneBotError(f"save:={save}: {_writing_error(save)}") from None
    if listener is None:
        return Recording(stream, save)
    known = int(listener.getsockname()[1])
    return Recording(stream, save, known, server, GrpcGate(listener, server))


def check_writable(path: Path) -> None:
    """Refuse a recording file that cannot be written.

    Raises:
        OneBotError: with what is wrong.
    """
    if path.suffix != ".rrd":
        raise OneBotError(f"save:={path}: a recording's name must end in .rrd")
    if not path.parent.is_dir():
        raise OneBotError(f"save:={path}: there is no folder {path.parent}")
    try:
        path.open("ab").close()
    except OSError as error:
        raise OneBotError(f"save:={path}: {error.strerror}") from error


_CHECK_EVERY = 2.0  # seconds between two checks of the file
_RESTART_AFTER = 5.0  # seconds between two starts of a page's server that keeps dying
_REMIND_AFTER = 5.0  # seconds


class Log(Protocol):
    """Where messages to the user go; an rclpy logger is one."""

    def info(self, message: str, /) -> object:
        """Say what is going on."""

    def warning(self, message: str, /) -> object:
        """Say what is not as it should be."""


class DisplayServer:
    """An open recording and what shows it, until ``close``.

    Attributes:
        stream: where to log.
    """

    def __init__(
        self,
        viewer: str,
        save: Path | None,
        *,
        grpc_port: int,
        web_port: int,
        memory_limit: str,
        open_browser: bool,
        log: Log,
    ) -> None:
        """Open the recording, then what shows it; call it from the main thread.

        Args:
            viewer: "web", "native" or "none".
            save: a file to write as well.
            grpc_port: wanted port of the recording's server, 0 for any.
            web_port: wanted port of the page, 0 for any.
            memory_limit: what the server keeps for late viewers, such as "256MB".
            open_browser: open the page, if there is a display.
            log: where to say what happens.

        Raises:
            OneBotError: a file, a port or a display that cannot be had.
        """
        self._log = log
        self._open_browser = open_browser
        self._page: WebPage | None = None
        self._window: NativeWindow | None = None
        self._announced = False
        self._next_reminder = time.monotonic() + 2.0
        self._next_restart = 0.0
        self._next_check: float | None = 0.0  # of the file; None once it failed
        if save is not None and save.is_file() and save.stat().st_size:
            log.info(f"replacing the recording {save}")
        served = None if viewer == "none" else grpc_port
        self._recording = open_recording(served, save, memory_limit)
        self.stream: rr.RecordingStream = self._recording.stream
        self._say_port("grpc_port", served, self._recording.port)
        if save is not None:
            log.info(f"recording to {save}")
        if viewer == "web":
            self._page = WebPage(web_port, self._recording.uri, self._recording.server)
            self._say_port("web_port", web_port, self._page.port)
        elif viewer == "native":
            self._window = NativeWindow(self._recording.uri)
            log.info("opening the viewer's window")

    def _say_port(self, name: str, wanted: int | None, got: int | None) -> None:
        if wanted and got != wanted:
            self._log.warning(f"{name} {wanted} is in use; using {got} instead")

    @property
    def page_address(self) -> str:
        """The page's whole address, once it can be opened; "" before, or if there is no page."""
        return self._page.address if self._page is not None and self._announced else ""

    def watch(self) -> None:
        """Announce the page once it is up, host it anew if it dies; say if a window was closed.

        Call it some times a second, from the main thread.

        Raises:
            OneBotError: the file cannot be written, and there is nothing else to show.
        """
        self._watch_file()
        if self._page is not None:
            self._watch_page(self._page)
        if self._window is not None and not self._window.running:
            reason = self._window.last_words()
            self._window.stop()
            self._window = None
            self._log.warning(f"the viewer's window was closed ({reason})")

    def _watch_file(self) -> None:
        now = time.monotonic()
        if self._next_check is None or now < self._next_check:
            return
        self._next_check = now + _CHECK_EVERY
        try:
            self._recording.check_file()
        except OneBotError as error:
            if self._page is None and self._window is None:
                raise
            self._next_check = None
            self._log.warning(f"no longer recording: {error}")

    def _watch_page(self, page: WebPage) -> None:
        now = time.monotonic()
        if not page.running:
            if now >= self._next_restart:
                self._next_restart = now + _RESTART_AFTER
                self._log.warning(f"the page's server died, restarting: {page.restart()}")
        elif not self._announced and page.ready:
            self._announced = True
            self._log.info(f"open {page.url}")
            if self._open_browser and has_display():
                page.open_in_browser()
        elif not self._announced and now >= self._next_reminder:
            self._next_reminder = now + _REMIND_AFTER
            self._log.info(f"waiting for the page's server on port {page.port}")

    def close(self) -> None:
        """End what shows the recording, then write it out.

        Raises:
            OneBotError: it was not written to its end.
        """
        for shown in (self._page, self._window):
            if shown is not None:
                shown.stop()
        self._recording.close()
