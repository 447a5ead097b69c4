"""How the page is served: a thread that answers on a socket."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable

from aiohttp import web

_PATIENCE = 0.5  # s for what is being answered when the server stops


class ServerThread:
    """Serves an application until it is stopped."""

    def __init__(self, app: web.Application, listener: socket.socket) -> None:
        """Start."""
        self._app, self._listener = app, listener
        self._end = asyncio.Event()
        self._running = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve()), name="steering", daemon=True
        )
        self._thread.start()
        self._running.wait()

    def call(self, action: Callable[[], None]) -> None:
        """Have something done in the server's thread, soon; not once it is stopped."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(action)

    def stop(self) -> None:
        """Close all connections and the socket."""
        self.call(self._end.set)
        self._thread.join(4 * _PATIENCE)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._running.set()
        runner = web.AppRunner(
            self._app, access_log=None, handle_signals=False, shutdown_timeout=_PATIENCE
        )
        await runner.setup()
        await web.SockSite(runner, self._listener).start()
        await self._end.wait()
        await runner.cleanup()
