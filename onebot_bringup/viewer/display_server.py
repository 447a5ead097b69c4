"""Opens the recording, and the page or window that shows it."""

import os
import re
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import IO, Protocol
from urllib.parse import quote

import rerun as rr
import rerun_cli  # type: ignore[import-untyped]

from onebot_bringup.launcher.orphans import die_with_this_thread, temporary_folder
from onebot_bringup.serving.grpc_gate import GrpcGate
from onebot_bringup.serving.ports import (
    LOOPBACK,
    answers,
    free_port,
    has_display,
    hidden_address,
    listen,
    open_in_browser,
)
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.atomic_write import refuse_unwritable
from onebot_description.errors import OneBotError

# Rerun's own program, run as a child process that never outlives us, however we end. (The ``rerun``
# script is a Python shim: killing it would leave the program running.)
_PROGRAM = Path(rerun_cli.__file__).parent / "rerun"

_PATIENCE = 1.5  # seconds until a program that does not end is killed
# Rerun's crash message with a few lines before it; a trace and a request for a bug report follow.
_CRASH = re.compile(r"(?:(?!.*XDG_RUNTIME_DIR).*\n+){0,8}.*(?:panicked at|caught a signal).*")


class Child:
    """A running Rerun program.

    Attributes:
        process: its process.
    """

    def __init__(self, arguments: Sequence[str], environment: dict[str, str] | None = None) -> None:
        """Start the program; it listens on 127.0.0.1 only, and dies with this process.

        Call this from the main thread: the program ends with the thread that has started it.
        """
        self._output: IO[bytes] = tempfile.TemporaryFile()
        variables = {**os.environ, "RUST_LOG": "warn", "NO_COLOR": "1"}
        variables["CI"] = "true"  # keeps Rerun from sending usage statistics
        self._scratch = temporary_folder("rerun")  # the program leaves files there
        variables["TMPDIR"] = self._scratch.name
        variables.update(environment or {})
        self.process = subprocess.Popen(
            [str(_PROGRAM), "--bind", LOOPBACK, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            env=variables,
            start_new_session=True,  # Ctrl-C is for us; we end the child ourselves
            preexec_fn=die_with_this_thread(),
        )

    @property
    def running(self) -> bool:
        """Whether the program still runs."""
        return self.process.poll() is None

    def last_words(self) -> str:
        """Return the last line of its output or its crash message, or else its exit code."""
        output = self.output().strip()
        crash = _CRASH.search(output)
        if crash is not None:
            return " ".join(crash.group().split())
        return output.rpartition("\n")[2].strip() or f"exit code {self.process.poll()}"

    def output(self) -> str:
        """Return everything the program has written."""
        self._output.seek(0)
        return self._output.read().decode(errors="replace")

    def stop(self) -> None:
        """Ask the program to end, and kill it if it does not."""
        if self.running:
            self.process.terminate()
            try:
                self.process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self._output.close()
        self._scratch.cleanup()


# The page in a browser, or the native window.


class WebPage(Child):
    """Rerun's page on loopback: Rerun's server, and a proxy that keeps it private.

    Attributes:
        port: its port on 127.0.0.1.
        url: the address to open in a browser.
        address: the page with its options and the recording's address for native viewers.
    """

    def __init__(self, port: int, recording_uri: str, data: tuple[str, int]) -> None:
        """Start hosting.

        Args:
            port: the preferred port, replaced by a free one if it is in use; 0 for any.
            recording_uri: where native viewers connect.
            data: address and port of the recording's server.
        """
        from onebot_bringup.serving.http_server import ServerThread  # imports aiohttp
        from onebot_bringup.serving.rerun_proxy import page_app

        listener = listen(LOOPBACK, port)
        self._backend = free_port()
        super().__init__(["--serve-web", "--web-viewer-port", str(self._backend), recording_uri])
        # persist=0: show this robot's view, not one that the browser remembers of another robot.
        options = "hide_welcome_screen&theme=dark&persist=0&notebook=1"
        self.port = int(listener.getsockname()[1])
        self.url = f"http://{LOOPBACK}:{self.port}"
        self.address = f"{self.url}/?url={quote(recording_uri, safe=':/')}&{options}"
        self._server = ServerThread(page_app(self._backend, options, data), listener, "page")

    @property
    def ready(self) -> bool:
        """Whether the page can be opened."""
        return self.running and answers(self._backend)

    def stop(self) -> None:
        """Stop hosting."""
        self._server.stop()
        super().stop()


def native_window(recording_uri: str) -> Child:
    """Open Rerun's native window."""
    port = str(free_port())
    return Child(["--port", port, "--hide-welcome-screen", "--connect", recording_uri])


# The recording, which is served on loopback, written to a file, or both.

_PIPE_SIZE = 1 << 20  # bytes; the largest that any user may have


class RecordingFile:
    """A ``.rrd`` file that Rerun writes through a pipe, so that a full disk never stops Rerun.

    When Rerun itself cannot write a file, it gives no reason, and a flush never returns, which
    stops the server too. Here the pipe is read to its end, whatever happens to the file.
    """

    def __init__(self, path: Path) -> None:
        """Open a file beside ``path``; ``replace`` gives it that name, else it is deleted."""
        self._path = path
        # On Windows a pipe has no path, and an open file cannot be renamed: Rerun writes the file.
        self._piped = os.name != "nt"
        new = f".{path.name}-{os.getpid()}" if self._piped else path.name
        self._new = path.resolve().with_name(new)
        self._file = _opened(path, self._new)
        self._discard = weakref.finalize(self, self._new.unlink, missing_ok=True)
        self._error: OSError | None = None
        source, self._target = os.pipe()
        if sys.platform == "linux":
            import fcntl

            with suppress(OSError):  # a user with many pipes gets small ones
                fcntl.fcntl(source, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        self._thread = threading.Thread(target=self._copy, args=(source,), daemon=True)
        self._thread.start()

    def sink(self) -> rr.FileSink:
        """Return the sink that Rerun writes to; after opening it, call ``opened``."""
        # A footer would keep a record of every chunk in memory, too much for a run of days.
        path = f"/dev/fd/{self._target}" if self._piped else self._new
        return rr.FileSink(path, write_footer=False)

    def opened(self) -> None:
        """Close our end of the pipe, so that it ends with the recording, which has opened it."""
        os.close(self._target)

    def replace(self) -> None:
        """Rename the file to its path; an existing one is unchanged until then."""
        self._new.replace(self._path.resolve())
        self._discard.detach()

    def _copy(self, source: int) -> None:
        buffer = memoryview(bytearray(_PIPE_SIZE))
        with open(source, "rb", buffering=0) as pipe:
            while size := pipe.readinto(buffer):
                if self._error is None:
                    self._write(buffer[:size])

    def _write(self, data: memoryview) -> None:
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            self._error = error

    def check(self) -> None:
        """Raise an OneBotError if the file could not be written; the beginning is kept."""
        if self._error is not None:
            raise OneBotError(f"save:={self._path}: {self._error.strerror}")

    def close(self) -> None:
        """Write the rest of a recording that has ended; raises as ``check`` does."""
        self._thread.join()
        try:
            self._file.close()
        except OSError as error:  # a network file system may report errors only on close
            self._error = self._error or error
        self.check()


def _opened(path: Path, new: Path) -> FileIO:
    if path.suffix != ".rrd":
        raise OneBotError(f"save:={path}: a recording's name must end in .rrd")
    try:
        refuse_unwritable(path)
        return new.open("wb", buffering=0)
    except OSError as error:
        raise OneBotError(f"save:={path}: {error.strerror}") from error


@dataclass(frozen=True)
class Recording:
    """An open recording; the server lives as long as ``stream`` is referenced."""

    stream: rr.RecordingStream
    file: RecordingFile | None
    port: int | None = None  # on 127.0.0.1, for native viewers; None if nothing is served
    server: tuple[str, int] = ("", 0)  # address and port of Rerun's server, behind the gate
    gate: GrpcGate | None = None  # listens on ``port``

    @property
    def uri(self) -> str:
        """The address that native viewers connect to."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    def close(self) -> None:
        """Write out everything and end the server; raises as ``RecordingFile.check`` does."""
        if self.gate is not None:
            self.gate.stop()
        self.stream.disconnect()
        if self.file is not None:
            self.file.close()


def open_recording(
    port: int | None = None,
    save: Path | None = None,
    memory_limit: str = "256MB",
    *,
    replace: bool = True,
) -> Recording:
    """Open a recording that is served on 127.0.0.1:``port``, written to ``save``, or both.

    Args:
        port: the preferred port, replaced by a free one if it is in use; 0 for any, None to serve
            nothing.
        save: a ``.rrd`` file.
        memory_limit: how much the server keeps for viewers that join later, such as "256MB";
            beyond it the oldest data is dropped, except static data.
        replace: make the file, or replace an existing one, now; False: ``file.replace`` does so.
    """
    listener = None if port is None else listen(LOOPBACK, port)
    server = hidden_address()
    file = None if save is None else RecordingFile(save)
    stream = rr.RecordingStream("onebot")
    sinks: list[rr.GrpcServerSink | rr.FileSink] = []
    if listener is not None:
        sinks.append(rr.GrpcServerSink(*server, server_memory_limit=memory_limit))
    if file is not None:
        sinks.append(file.sink())
    stream.set_sinks(*sinks)
    if file is not None:
        file.opened()
        if replace:
            file.replace()
    if listener is None:
        return Recording(stream, file)
    own_port = int(listener.getsockname()[1])
    return Recording(stream, file, own_port, server, GrpcGate(listener, server))


class Log(Protocol):
    """A logger of messages to the user, such as an rclpy logger."""

    def info(self, message: str, /) -> object: ...
    def warning(self, message: str, /) -> object: ...


class DisplayServer:
    """An open recording and its page or window, until ``close``.

    Attributes:
        stream: the stream to log to.
        page_address: the page's full address once it can be opened; "" before that, or without one.
    """

    def __init__(self, parameters: ViewerParameters, log: Log) -> None:
        """Open the recording, then its page or window; call this from the main thread.

        Raises:
            OneBotError: there is no display, or the file cannot be written; an existing file is
                unchanged.
        """
        viewer, save = parameters.viewer, parameters.recording
        if viewer == "native" and not has_display():
            raise OneBotError(
                "viewer:=native needs a display (neither DISPLAY nor WAYLAND_DISPLAY is set); "
                "use viewer:=web and open its address, or viewer:=none save:=FILE.rrd"
            )
        self._parameters, self._log = parameters, log
        self._viewer: Child | None = None  # None without one, and after its end
        self.page_address = ""
        served = None if viewer == "none" else parameters.grpc_port
        self._recording = open_recording(served, save, parameters.memory_limit, replace=False)
        self.stream: rr.RecordingStream = self._recording.stream
        self._file = self._recording.file  # None without one, and after a failure
        self._report_port("grpc_port", served, self._recording.port)
        if viewer == "web":
            port = parameters.web_port
            self._viewer = WebPage(port, self._recording.uri, self._recording.server)
            self._report_port("web_port", port, self._viewer.port)
        elif viewer == "native":
            self._viewer = native_window(self._recording.uri)
            log.info("opening the viewer's window")

    def replace_file(self) -> None:
        """Replace the file to save, if there is one; mistakes before that leave an existing one."""
        if self._file is not None:
            self._file.replace()
            self._log.info(f"recording to {self._parameters.recording}")

    def _report_port(self, name: str, wanted: int | None, port: int | None) -> None:
        if wanted and port != wanted:
            self._log.warning(f"{name} {wanted} is in use; using {port} instead")

    def watch(self) -> None:
        """Announce the page once it is up; report that it died, or that the window was closed.

        Call this a few times a second, from the main thread.

        Raises:
            OneBotError: the file cannot be written, and there is nothing else to show.
        """
        self._watch_file()
        viewer = self._viewer
        if viewer is None:
            return
        if not viewer.running:
            reason = viewer.last_words()
            viewer.stop()
            self._viewer, self.page_address = None, ""
            is_page = isinstance(viewer, WebPage)
            end = "the page's server died" if is_page else "the viewer's window was closed"
            self._log.warning(f"{end} ({reason})")
        elif isinstance(viewer, WebPage) and not self.page_address and viewer.ready:
            self.page_address = viewer.address
            if not self._parameters.embedded:
                self._log.info(f"open {viewer.url}")
                if self._parameters.open_browser:
                    open_in_browser(viewer.url)

    def _watch_file(self) -> None:
        try:
            if self._file is not None:
                self._file.check()
        except OneBotError as error:
            if self._viewer is None:
                raise
            self._file = None
            self._log.warning(f"no longer recording: {error}")

    def close(self) -> None:
        """Close the page or window, write out the recording; raises as ``RecordingFile.check``."""
        if self._viewer is not None:
            self._viewer.stop()
        self._recording.close()
