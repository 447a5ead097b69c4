"""An aiohttp application served in a thread of its own."""

import asyncio
import logging
import socket
from functools import partial

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from onebot_bringup.serving.connections import IDLE_TIMEOUT, Connections
from onebot_bringup.serving.event_loop import STOP_TIMEOUT, LoopThread

_LINGERING = 1.0  # s for the rest of a request that has its response
_LOGGER = logging.getLogger(__name__)


def _is_of_the_server(record: logging.LogRecord) -> bool:
    """Whether an error is not of a client that does not speak HTTP, which gets a response 400."""
    return record.exc_info is None or not isinstance(record.exc_info[1], HttpProcessingError)


_LOGGER.addFilter(_is_of_the_server)


class ServerThread(LoopThread):
    """Serves an application on a socket, in a thread, until it is stopped."""

    def __init__(self, app: web.Application, listener: socket.socket, name: str) -> None:
        self._app, self._listener = app, listener
        super().__init__(name)

    async def serve(self, end: asyncio.Event) -> None:
        """Serve until ``end`` is set, then close all connections and the socket."""
        connections = Connections(self._app)
        runner = web.AppRunner(
            self._app,
            access_log=None,
            logger=_LOGGER,
            handle_signals=False,
            shutdown_timeout=STOP_TIMEOUT / 4,  # for pending responses
            keepalive_timeout=IDLE_TIMEOUT,
            lingering_time=_LINGERING,
        )
        await runner.setup()
        assert runner.server is not None
        accept = partial(connections.accept, runner.server)
        server = await asyncio.get_running_loop().create_server(accept, sock=self._listener)
        await end.wait()
        server.close()
        await runner.cleanup()
