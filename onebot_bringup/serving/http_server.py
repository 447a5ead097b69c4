"""An aiohttp application served in a thread of its own, beside a node's executor."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable

from aiohttp import web

_SHUTDOWN_TIMEOUT = 0.5  # s for pending responses when the server stops


class ServerThread:
    """Serves an application on a socket, in a thread, until it is stopped."""

    def __init__(self, app: web.Application, listener: socket.socket, name: str) -> None:
        """Start the thread, called ``name``, and wait until its event loop runs."""
        self._app, self._listener = app, listener
        self._end = asyncio.Event()
        self._running = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve()), name=name, daemon=True
        )
        self._thread.start()
        self._running.wait()

    def call(self, action: Callable[[], None]) -> None:
        """Call ``action`` in the server's thread; ignored after `stop`."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(action)

    def stop(self) -> None:
        """Close all connections and the socket."""
        self.call(self._end.set)
        self._thread.join(4 * _SHUTDOWN_TIMEOUT)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._running.set()
        runner = web.AppRunner(
            self._app, access_log=None, handle_signals=False, shutdown_timeout=_SHUTDOWN_TIMEOUT
        )
        await runner.setup()
        await web.SockSite(runner, self._listener).start()
        await self._end.wait()
        await runner.cleanup()
