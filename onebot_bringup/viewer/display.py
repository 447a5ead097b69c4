"""Where the robot can be seen: the recording, and the page or the window that shows it."""

import time
from pathlib import Path
from typing import Protocol

import rerun as rr

from onebot_bringup.viewer.recording import open_recording
from onebot_bringup.viewer.serving import NativeWindow, WebPage, has_display

_RESTART_AFTER = 5.0  # seconds between two starts of a page's server that keeps dying
_REMIND_AFTER = 5.0  # seconds


class Log(Protocol):
    """Tells the user (an rclpy logger is one)."""

    def info(self, message: str, /) -> object:
        """Say what is going on."""

    def warning(self, message: str, /) -> object:
        """Say what is not as it should be."""


class Display:
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
        if save is not None and save.is_file() and save.stat().st_size:
            log.info(f"replacing the recording {save}")
        served = None if viewer == "none" else grpc_port
        self._recording = open_recording(served, save, memory_limit)
        self.stream: rr.RecordingStream = self._recording.stream
        self._say_port("grpc_port", served, self._recording.port)
        if save is not None:
            log.info(f"recording to {save}")
        if viewer == "web":
            self._page = WebPage(web_port, self._recording.uri)
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
        """
        if self._page is not None:
            self._watch_page(self._page)
        if self._window is not None and not self._window.running:
            reason = self._window.last_words()
            self._window.stop()
            self._window = None
            self._log.warning(f"the viewer's window was closed ({reason})")

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
        """End what shows the recording, then write it out."""
        for shown in (self._page, self._window):
            if shown is not None:
                shown.stop()
        self._recording.close()
