"""Bounds on the connections of a server, so that no client keeps the others out.

A connection without a whole request within a few seconds is closed; aiohttp does so if its timeout
of idle connections is as short. Of too many, the idlest one makes room for each new one.
"""

import asyncio
import socket
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from aiohttp import web
from aiohttp.typedefs import Handler

IDLE_TIMEOUT = 5.0  # s for the head of a request, and between two requests
_BODY_TIMEOUT = 5.0  # s for the body of a request
_MOST = 256  # connections of a server; Linux lets a process have 1024 files
_MOST_OF_A_PEER = 128  # a browser has about ten for a page and its view
# Set in a request that its server bounds otherwise: its connection makes room for no other.
KEEP = web.RequestKey("keep", bool)


async def body_of(request: web.Request) -> bytes:
    """Return the body of a request.

    Raises:
        HTTPRequestTimeout: it was not received in whole within seconds.
        HTTPBadRequest: its connection was closed before.
    """
    try:
        return await asyncio.wait_for(request.read(), _BODY_TIMEOUT)
    except asyncio.TimeoutError:
        raise web.HTTPRequestTimeout from None
    except ConnectionError:  # nobody reads the response; but aiohttp would log a traceback
        raise web.HTTPBadRequest from None


class Connections:
    """The connections of one server."""

    def __init__(self, app: web.Application) -> None:
        # By connection: the request in progress, and the transport, which aiohttp forgets when it
        # closes it; but it stays while the other end does not read.
        self._requests: dict[Any, web.Request] = {}
        self._transports: dict[Any, asyncio.Transport] = {}
        app.middlewares.insert(0, self._follow)

    def accept(self, server: web.Server) -> web.RequestHandler:
        """Return the protocol of a new connection; close the idlest of too many others."""
        peers: dict[str, list[Any]] = {}
        known, self._transports = self._transports, {}
        for one in server.connections:  # the oldest first
            transport = one.transport or known.get(one)
            if transport is not None:
                self._transports[one] = transport
                peers.setdefault(_computer(transport), []).append(one)
        crowd = max(peers.values(), key=len, default=[])
        self._close(crowd, max(len(crowd) - _MOST_OF_A_PEER, len(self._transports) - _MOST) + 1)
        return server()

    def _close(self, crowd: Sequence[Any], number: int) -> None:
        """Close some of these connections, those without a request first."""
        free = [one for one in crowd if KEEP not in self._requests.get(one, {})]
        free.sort(key=lambda one: (not self._transports[one].is_closing(), one in self._requests))
        for one in free[: max(0, number)]:
            # Not abort(): asyncio would log that as an error of its own while it sends a file.
            with suppress(OSError):
                self._transports[one].get_extra_info("socket").shutdown(socket.SHUT_RDWR)

    @web.middleware
    async def _follow(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        connection = request.protocol
        self._requests[connection] = request
        if request.transport is not None:
            self._transports[connection] = request.transport
        try:
            return await handler(request)
        except ConnectionResetError:  # as in body_of
            raise web.HTTPBadRequest from None
        finally:
            del self._requests[connection]


def _computer(transport: asyncio.Transport) -> str:
    """The address of the other end."""
    peer = transport.get_extra_info("peername")
    return str(peer[0]) if peer else ""
