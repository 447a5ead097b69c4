"""The timeouts of a server's connections, and clients that leave early. A server, and sockets."""

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from aiohttp import web

from onebot_bringup.serving.http_server import ServerThread, body_of
from onebot_bringup.serving.ports import listen
from tests.support import PATIENCE, wait_for

HEAD = "HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
WEBSOCKET = (
    "HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
)


class Server:
    """A server whose responses come when the test wants them to."""

    def __init__(self) -> None:
        self.release = threading.Event()
        self.begun = 0
        self.ended = threading.Event()
        app = web.Application()
        app.router.add_get("/slow", self._slow)
        app.router.add_get("/socket", self._socket)
        app.router.add_post("/body", self._body)
        listener = listen("127.0.0.1", 0)
        self._port = listener.getsockname()[1]
        self._opened = contextlib.ExitStack()
        self.thread = ServerThread(app, listener, "test")

    async def _slow(self, request: web.Request) -> web.Response:
        self.begun += 1
        loop = request.task.get_loop()
        await loop.run_in_executor(None, self.release.wait)
        return web.Response(text="done")

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        await self._slow(request)
        found = web.WebSocketResponse()
        try:
            await found.prepare(request)
        finally:
            self.ended.set()
        return found

    async def _body(self, request: web.Request) -> web.Response:
        return web.Response(body=await body_of(request))

    def connect(self, path: str = "") -> socket.socket:
        """A connection, with a request of ``path``, if any, that has reached its handler."""
        found = self._opened.enter_context(
            socket.create_connection(("127.0.0.1", self._port), PATIENCE)
        )
        if path:
            before = self.begun
            found.sendall(f"GET {path} {HEAD}".encode())
            wait_for(lambda: self.begun > before, "the request")
        return found

    def close(self) -> None:
        """End it."""
        self.release.set()
        self.thread.stop()
        self._opened.close()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A server whose connections idle for at most 0.3 s."""
    for name in ("_IDLE_TIMEOUT", "_BODY_TIMEOUT"):
        monkeypatch.setattr(f"onebot_bringup.serving.http_server.{name}", 0.3)
    server = Server()
    yield server
    server.close()


def _rest(connection: socket.socket) -> bytes:
    """What is yet to come; b"" of a connection that was cut."""
    received = b""
    with contextlib.suppress(ConnectionError):
        while data := connection.recv(1 << 16):
            received += data
    return received


@pytest.mark.parametrize(
    "beginning",
    [
        "",
        "GET /slow HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ",
        "POST /body HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n{",
        "POST /nowhere HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n{",
        f"GET /nowhere {HEAD}",
    ],
    ids=["silent", "half a head", "half a body", "half a body that nobody reads", "kept open"],
)
def test_a_connection_that_does_nothing_is_closed(server: Server, beginning: str) -> None:
    """In a bounded time, with what was asked of it, if anything was."""
    connection = server.connect()
    connection.sendall(beginning.encode())
    assert b"done" not in _rest(connection)


def test_a_client_that_speaks_no_http_is_refused_without_a_word_in_the_log(
    server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    client = server.connect()
    client.sendall(b"GET / HTTP/1.1\r\n\r\n")  # no Host
    assert _rest(client).startswith(b"HTTP/1.0 400 ")
    assert caplog.records == []


def test_a_page_that_leaves_before_the_response_is_no_error(
    server: Server, caplog: pytest.LogCaptureFixture
) -> None:
    """As a browser that is closed while it connects."""
    leaving = server.connect(f"/socket {WEBSOCKET}\r\nX: ")
    leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    leaving.close()
    other = server.connect("/slow")  # the loop has seen the end by then
    server.release.set()
    assert other.recv(100) and server.ended.wait(PATIENCE)
    server.thread.stop()
    assert caplog.records == []
