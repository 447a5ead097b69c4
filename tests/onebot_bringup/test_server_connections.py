"""Bounds on the connections of a server: who makes room, and who stays. A server, and sockets."""

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from aiohttp import web

from onebot_bringup.serving.connections import KEEP
from onebot_bringup.serving.http_server import ServerThread
from onebot_bringup.serving.ports import listen
from tests.support import PATIENCE, wait_for

HEAD = "HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
WEBSOCKET = (
    "HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
)
LARGE = 60_000  # bytes; less than what asyncio keeps before a handler has to wait


class Server:
    """A server whose responses come when the test wants them to."""

    def __init__(self) -> None:
        self.release = threading.Event()
        self.begun = 0
        self.ended = threading.Event()
        app = web.Application()
        app.router.add_get("/slow", self._slow)
        app.router.add_get("/page", self._page)
        app.router.add_get("/large", self._large)
        app.router.add_get("/socket", self._socket)
        listener = listen("127.0.0.1", 0)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        self._port = listener.getsockname()[1]
        self._opened = contextlib.ExitStack()
        self.thread = ServerThread(app, listener, "test")

    async def _slow(self, request: web.Request) -> web.Response:
        self.begun += 1
        loop = request.task.get_loop()
        await loop.run_in_executor(None, self.release.wait)
        return web.Response(text="done")

    async def _page(self, request: web.Request) -> web.Response:
        request[KEEP] = True
        return await self._slow(request)

    async def _large(self, _: web.Request) -> web.Response:
        self.begun += 1
        return web.Response(body=b"x" * LARGE)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        await self._slow(request)
        found = web.WebSocketResponse()
        try:
            await found.prepare(request)
        finally:
            self.ended.set()
        return found

    def connect(self, path: str = "", source: str = "127.0.0.1") -> socket.socket:
        """A connection, with a request of ``path``, if any, that has reached its handler."""
        found = socket.socket()
        self._opened.enter_context(found)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        found.settimeout(PATIENCE)
        found.bind((source, 0))
        found.connect(("127.0.0.1", self._port))
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
    """At most six connections, four of them of one computer."""
    monkeypatch.setattr("onebot_bringup.serving.connections._MOST", 6)
    monkeypatch.setattr("onebot_bringup.serving.connections._MOST_OF_A_PEER", 4)
    server = Server()
    yield server
    server.close()


def _rest(connection: socket.socket) -> bytes:
    """What is yet to come; b"" of a connection that was cut."""
    found = b""
    with contextlib.suppress(ConnectionError):
        while data := connection.recv(1 << 16):
            found += data
            if found.endswith(b"done"):
                return b"done"
    return found


def test_of_too_many_the_idlest_and_oldest_makes_room(server):
    """Without a request before those with one; a page does not, however old."""
    page, slow = server.connect("/page"), server.connect("/slow")
    idle = [server.connect() for _ in range(2)]
    new = server.connect("/slow")
    assert _rest(idle[0]) == b""
    newer = server.connect("/slow")
    assert _rest(idle[1]) == b""
    newest = server.connect("/slow")
    assert _rest(slow) == b""
    server.release.set()
    assert [_rest(one) for one in (page, new, newer, newest)] == [b"done"] * 4


def test_each_computer_has_its_share(server):
    """One with many connections loses its own, not those of others; also when all are too many."""
    other = [server.connect(source="127.0.0.2") for _ in range(2)]
    mine = [server.connect("/slow") for _ in range(4)]
    mine.append(server.connect("/slow"))
    assert _rest(mine[0]) == b""
    third = server.connect("/slow", "127.0.0.3")
    assert _rest(mine[1]) == b""
    for one in other:
        one.sendall(f"GET /slow {HEAD}".encode())
    wait_for(lambda: server.begun == 8, "the requests of the other")
    server.release.set()
    assert [_rest(one) for one in (*other, *mine[2:], third)] == [b"done"] * 6


def test_one_that_does_not_read_its_response_makes_room_first(server, monkeypatch):
    """Its server has closed it, but the response waits to be read, maybe for ever."""
    monkeypatch.setattr("onebot_bringup.serving.http_server.IDLE_TIMEOUT", 0.1)
    server.close()
    server = Server()
    try:
        stuck = server.connect("/large")
        page = server.connect("/page")
        idle = server.connect()
        assert _rest(idle) == b""  # the time of the idle is over, for both
        others = [server.connect("/slow") for _ in range(3)]
        server.release.set()
        assert [_rest(one) for one in (page, *others)] == [b"done"] * 4
        assert len(_rest(stuck)) < LARGE
    finally:
        server.close()


def test_a_client_that_speaks_no_http_is_refused_without_a_word_in_the_log(server, caplog):
    client = server.connect()
    client.sendall(b"GET / HTTP/1.1\r\n\r\n")  # no Host
    assert client.recv(1000).startswith(b"HTTP/1.0 400 ")
    assert client.recv(1000) == b""
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
