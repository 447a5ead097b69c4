"""Guards the port of a recording: lets native viewers through to Rerun's server, but not browsers.

Rerun's server checks neither Host nor Origin of a request, and lets it write into the recording.
Therefore it listens on a loopback address that cannot be guessed, and this gate on the known port.

Native viewers speak HTTP/2 from the first byte; browsers do so only with TLS. A foreign page
therefore cannot reach the recording, even by DNS rebinding.
"""

import asyncio
import socket
from contextlib import suppress

from onebot_bringup.serving.event_loop import LoopThread

_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"  # RFC 9113, 3.4
_PREFACE_TIMEOUT = 5.0  # s
_CHUNK = 1 << 16  # bytes
_REFUSAL = "This port is for native viewers: open the page's address in a browser, not this one.\n"
_RESPONSE = (
    "HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n"
    f"Content-Length: {len(_REFUSAL)}\r\n\r\n{_REFUSAL}"
).encode()


class GrpcGate(LoopThread):
    """Forwards connections of native viewers, in a thread, until it is stopped."""

    def __init__(self, listener: socket.socket, backend: tuple[str, int]) -> None:
        """Start forwarding.

        Args:
            listener: the socket that viewers connect to.
            backend: the address and port of Rerun's server.
        """
        self._listener, self._backend = listener, backend
        self._clients: set[asyncio.StreamWriter] = set()
        super().__init__("grpc gate")

    async def serve(self, end: asyncio.Event) -> None:
        server = await asyncio.start_server(self._serve_client, sock=self._listener)
        await end.wait()
        server.close()
        for client in self._clients:
            client.transport.abort()

    async def _serve_client(
        self, reader: asyncio.StreamReader, client: asyncio.StreamWriter
    ) -> None:
        self._clients.add(client)
        try:
            preface = await asyncio.wait_for(reader.readexactly(len(_PREFACE)), _PREFACE_TIMEOUT)
            if preface == _PREFACE:
                await self._pass_through(reader, client)
            else:
                client.write(_RESPONSE)
        except (OSError, EOFError, asyncio.TimeoutError, asyncio.CancelledError):
            pass  # one end has closed, or the gate stops, and a cancelled task would be logged
        finally:
            self._clients.discard(client)
            client.close()

    async def _pass_through(
        self, reader: asyncio.StreamReader, client: asyncio.StreamWriter
    ) -> None:
        source, server = await asyncio.open_connection(*self._backend)
        server.write(_PREFACE)
        outbound = asyncio.ensure_future(_pump(reader, server))
        back = asyncio.ensure_future(_pump(source, client))
        try:
            await asyncio.wait((outbound, back), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for pump in (outbound, back):
                pump.cancel()
            server.close()


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    with suppress(ConnectionError):
        while data := await source.read(_CHUNK):
            sink.write(data)
            await sink.drain()
