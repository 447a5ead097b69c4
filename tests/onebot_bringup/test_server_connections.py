"""The timeouts of a server's connections. A server, and sockets."""

import contextlib
import socket
from collections.abc import Callable, Iterator

import pytest
from aiohttp import web

from onebot_bringup.serving.http_server import ServerThread, body_of
from onebot_bringup.serving.ports import listen
from tests.support import PATIENCE

HEAD = "HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
Connect = Callable[[], socket.socket]


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Iterator[Connect]:
    """Connects to a server whose connections idle for at most 0.3 s."""
    for name in ("_IDLE_TIMEOUT", "_BODY_TIMEOUT"):
        monkeypatch.setattr(f"onebot_bringup.serving.http_server.{name}", 0.3)

    async def echo(request: web.Request) -> web.Response:
        return web.Response(body=await body_of(request))

    app = web.Application()
    app.router.add_post("/body", echo)
    listener = listen("127.0.0.1", 0)
    address = listener.getsockname()
    thread = ServerThread(app, listener, "test")
    with contextlib.ExitStack() as opened:
        yield lambda: opened.enter_context(socket.create_connection(address, PATIENCE))
    thread.stop()


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
        "GET /body HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ",
        "POST /body HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n{",
        "POST /nowhere HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000\r\n\r\n{",
        f"GET /nowhere {HEAD}",
    ],
    ids=["silent", "half a head", "half a body", "half a body that nobody reads", "kept open"],
)
def test_a_connection_that_does_nothing_is_closed(connect: Connect, beginning: str) -> None:
    """In a bounded time, with what was asked of it, if anything was."""
    connection = connect()
    connection.sendall(beginning.encode())
    assert b"200 OK" not in _rest(connection)


def test_a_client_that_speaks_no_http_is_refused_without_a_word_in_the_log(
    connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    client = connect()
    client.sendall(b"GET / HTTP/1.1\r\n\r\n")  # no Host
    assert _rest(client).startswith(b"HTTP/1.0 400 ")
    assert caplog.records == []
