"""Where the page is served: a socket of its own, and a thread that answers on it."""

import asyncio
import contextlib
import errno
import socket
import threading
from collections.abc import Callable

from aiohttp import web

from onebot_bringup.steering.addresses import not_here, resolve
from onebot_description.errors import OneBotError

_PATIENCE = 0.5  # s for what is being answered when the server stops
_MAX_PORT = 65535


def listen(host: str, port: int) -> socket.socket:
    """Listen on ``port`` of ``host``, or on any free one if it is in use (or 0).

    Raises:
        OneBotError: this host has no such address, or the port is not to be had.
    """
    if not 0 <= port <= _MAX_PORT:
        raise OneBotError(f"port:={port} is no port: write a number from 1 to 65535, or 0 for any")
    family, address = resolve(host, port)
    for chosen in (port, 0):
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address[0], chosen, *address[2:]))
            listener.listen(128)
        except OSError as error:
            listener.close()
            if isinstance(error, PermissionError):
                raise OneBotError(
                    f"port:={port} is not allowed to you: use one from 1024 on"
                ) from None
            if error.errno == errno.EADDRNOTAVAIL:
                raise not_here(host) from None
            continue
        listener.setblocking(False)
        return listener
    raise OneBotError(f"there is no free port on {host}")


def reachable_as(listener: socket.socket) -> str:
    """Return host and port as an address has them; one of this computer's, if it is any."""
    host, port = listener.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = _own_address(listener.family, host)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _own_address(family: int, any_address: str) -> str:
    """The address that others see; connecting a datagram socket sends nothing."""
    # Addresses kept for documentation (RFC 5737, RFC 3849): the way there is the way out.
    outside = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"
    with contextlib.closing(socket.socket(family, socket.SOCK_DGRAM)) as probe:
        try:
            probe.connect((outside, 9))
        except OSError:
            return "127.0.0.1" if family == socket.AF_INET else "::1"
        found = str(probe.getsockname()[0])
    return found if found != any_address else "127.0.0.1"


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
