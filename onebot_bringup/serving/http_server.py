"""Serves an aiohttp application in a separate thread.

A connection without a complete request within a few seconds is closed: aiohttp does so if its
timeout of idle connections is that short.
"""

import asyncio
import logging
import socket

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from onebot_bringup.serving.event_loop import LoopThread

_IDLE_TIMEOUT = 5.0  # s for the head of a request, and between two requests
_BODY_TIMEOUT = 5.0  # s for the body of a request
_LINGERING = 1.0  # s for the rest of a request that has already been answered
_LOGGER = logging.getLogger(__name__)


def _is_of_the_server(record: logging.LogRecord) -> bool:
    """Whether an error is the server's own, not that of a client that left or spoke no HTTP."""
    of_clients = (HttpProcessingError, ConnectionError)
    return record.exc_info is None or not isinstance(record.exc_info[1], of_clients)


_LOGGER.addFilter(_is_of_the_server)


async def body_of(request: web.Request) -> bytes:
    """Return the body of a request, which has to arrive completely within a few seconds."""
    try:
        return await asyncio.wait_for(request.read(), _BODY_TIMEOUT)
    except asyncio.TimeoutError:
        raise web.HTTPRequestTimeout from None


class ServerThread(LoopThread):
    """Serves an application on a socket, in a thread, until it is stopped."""

    def __init__(self, app: web.Application, listener: socket.socket, name: str) -> None:
        self._app, self._listener = app, listener
        super().__init__(name)

    async def serve(self, end: asyncio.Event) -> None:
        """Serve until ``end`` is set, then close all connections and the socket."""
        runner = web.AppRunner(
            self._app,
            access_log=None,
            logger=_LOGGER,
            handle_signals=False,
            shutdown_timeout=0.1,  # s; some responses are endless
            keepalive_timeout=_IDLE_TIMEOUT,
            lingering_time=_LINGERING,
        )
        await runner.setup()
        await web.SockSite(runner, self._listener).start()
        await end.wait()
        await runner.cleanup()
