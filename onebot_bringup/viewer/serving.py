"""What the user looks at: the page in a browser, or the native window."""

import os
import threading
import webbrowser
from urllib.parse import quote

from onebot_bringup.viewer.page_server import PageServer
from onebot_bringup.viewer.processes import LOOPBACK, Child, answers, free_port
from onebot_description.errors import OneBotError


def has_display() -> bool:
    """Return whether a window could be opened here."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class WebPage:
    """Rerun's page, hosted on loopback: Rerun's server, and a proxy that keeps it private.

    Attributes:
        port: where it listens, on 127.0.0.1.
        url: what to open in a browser.
        address: where that leads to: the page, told which recording to show.
    """

    def __init__(self, port: int, recording_uri: str) -> None:
        """Start hosting on ``port``, or another one if it is in use (0: any)."""
        self._uri = recording_uri
        self._backend = free_port(0)
        self._child = self._start()
        # persist=0: it shows this robot's view, not one remembered from another robot.
        start = (
            f"/?url={quote(recording_uri, safe=':/')}"
            "&hide_welcome_screen&theme=dark&persist=0&notebook=1"
        )
        self.port = free_port(port)
        self.url = f"http://{LOOPBACK}:{self.port}"
        self.address = self.url + start
        self._server = PageServer(self.port, self._backend, start)

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
