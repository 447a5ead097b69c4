"""Forwards Rerun's page and its data to browsers, for the viewer and the steering page.

Every response gets a Content-Security-Policy, which keeps the page from connecting to other
computers (Rerun's page sends usage statistics).
"""

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path
from urllib.parse import quote

import aiohttp
from aiohttp import web
from yarl import URL

from onebot_bringup.serving.backlog import Backlog, messages
from onebot_bringup.serving.http_server import body_of
from onebot_bringup.serving.origin import guard
from onebot_bringup.serving.ports import LOOPBACK
from onebot_bringup.serving.rerun_messages import GRPC_WEB, SERVICE

_HEADERS = frozenset({"content-type", "content-length", "content-encoding", "rerun-final-length"})
_FOREIGN_LINK = re.compile(rb"<link[^>]*https?://[^>]*>")
_PAGE_TIMEOUT = 10.0  # s without data for a part of the page
_PAGE_SCRIPT = Path(__file__).with_name("rerun_page.js")
_READS = frozenset({f"/{SERVICE}/ReadMessages", f"/{SERVICE}/ReadTables"})


def content_policy() -> str:
    """Return the page's Content-Security-Policy: everything has to come from its own server."""
    return (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:;"
        " connect-src 'self' data: blob:"
    )


class RerunProxy:
    """Forwards requests to Rerun's servers on this computer, and streams their responses."""

    def __init__(
        self, app: web.Application, policy: str, unavailable: str, script: str = ""
    ) -> None:
        """Forward requests of an application.

        Args:
            app: the application.
            policy: the Content-Security-Policy of the responses.
            unavailable: the text of a response 502, if a server does not respond.
            script: a script that runs in the page before its own scripts.
        """
        self._policy, self._unavailable = policy, unavailable
        self._head = f"<head><script>{script}</script>".encode() if script else b"<head>"
        app.cleanup_ctx.append(self._open)

    async def forward_page(self, request: web.Request, port: int, path: str) -> web.StreamResponse:
        """Respond with the part of the page at ``path`` of 127.0.0.1:``port``."""
        return await self._forward(request, "GET", port, path, sock_read=_PAGE_TIMEOUT)

    async def forward_data(
        self, request: web.Request, port: int, path: str, host: str = LOOPBACK
    ) -> web.StreamResponse:
        """Respond to a gRPC-web call that only reads; the response may be endless."""
        if path not in _READS:
            raise web.HTTPForbidden(text="The view is read-only.\n")
        if request.content_type != GRPC_WEB:
            raise web.HTTPUnsupportedMediaType(text=f"Requests have to be {GRPC_WEB}.\n")
        body = await body_of(request)
        headers = {
            name: value
            for name, value in request.headers.items()
            if name.lower() in ("content-type", "accept") or "grpc" in name.lower()
        }
        return await self._forward(request, "POST", port, path, headers, body, host=host)

    async def _forward(
        self,
        request: web.Request,
        method: str,
        port: int,
        path: str,
        headers: dict[str, str] | None = None,
        body: bytes | None = None,
        sock_read: float | None = None,  # s
        host: str = LOOPBACK,
    ) -> web.StreamResponse:
        answer = web.StreamResponse()
        try:
            async with self._session.request(
                method,
                URL(f"http://{host}:{port}{path}", encoded=True),
                headers=headers,
                data=body,
                allow_redirects=False,
                timeout=aiohttp.ClientTimeout(total=None, sock_connect=5.0, sock_read=sock_read),
            ) as response:
                await self._copy(response, request, answer)
        except (aiohttp.ClientError, ConnectionError):
            if not answer.prepared:
                raise web.HTTPBadGateway(text=f"{self._unavailable}\n") from None
            # One end has closed the connection in mid-response, so close the other, too.
            if request.transport is not None:
                request.transport.close()
        return answer

    async def _copy(
        self, response: aiohttp.ClientResponse, request: web.Request, answer: web.StreamResponse
    ) -> None:
        """Stream the response of one of Rerun's servers."""
        answer.set_status(response.status, response.reason)
        for name, value in response.headers.items():
            if name.lower().startswith("grpc-") or name.lower() in _HEADERS:
                answer.headers[name] = value
        answer.headers["Content-Security-Policy"] = self._policy
        html = b""
        if response.content_type == "text/html":
            # The policy does not keep a browser from preconnecting to foreign hosts.
            html = _FOREIGN_LINK.sub(b"", await response.read()).replace(b"<head>", self._head, 1)
            answer.headers["Content-Length"] = answer.headers["rerun-final-length"] = str(len(html))
        await answer.prepare(request)
        if request.method != "HEAD":
            if html:
                await answer.write(html)
            if response.content_type == GRPC_WEB:
                await _relay(response.content, answer)
            async for chunk in response.content.iter_any():
                await answer.write(chunk)
        await answer.write_eof()

    async def _open(self, _: web.Application) -> AsyncIterator[None]:
        self._session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0),
            cookie_jar=aiohttp.DummyCookieJar(),
            headers={"Accept-Encoding": "identity"},  # this proxy reads the HTML
            auto_decompress=False,
        )
        async with self._session:
            yield


async def _relay(source: aiohttp.StreamReader, answer: web.StreamResponse) -> None:
    """Read messages as they arrive, and pass them on as the viewer takes them."""
    backlog = Backlog()
    reading = asyncio.ensure_future(_read(source, backlog))
    try:
        while message := await backlog.get():
            await answer.write(message)
        await reading  # raises the error that ended it
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)  # otherwise its error would be logged


async def _read(source: aiohttp.StreamReader, backlog: Backlog) -> None:
    try:
        async for message in messages(source):
            await backlog.put(message)
    finally:
        backlog.end()


def data_url(host: str) -> str:
    """Return the ``url=`` parameter of a page that gets its data from ``host``, a Host header."""
    # Without a port, Rerun's page would use its own server's.
    full = host if re.search(r":\d+$", host) else f"{host}:80"
    return f"url={quote(f'rerun+http://{full}/proxy', safe=':/[]')}"


def page_app(page: int, options: str, data: tuple[str, int]) -> web.Application:
    """Return an application that serves Rerun's page and its data.

    Args:
        page: the port of Rerun's page on 127.0.0.1.
        options: the options in the page's address.
        data: the address and port of Rerun's data server.
    """
    app = web.Application(middlewares=[guard(LOOPBACK)])
    policy = f"{content_policy()}; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    unavailable = "Rerun's server does not answer; it is being restarted"
    proxy = RerunProxy(app, policy, unavailable, _PAGE_SCRIPT.read_text())

    async def respond(request: web.Request) -> web.StreamResponse:
        path = request.rel_url.raw_path_qs
        if path == "/":
            raise web.HTTPFound(URL(f"/?{data_url(request.host)}&{options}", encoded=True))
        return await proxy.forward_page(request, page, path)

    async def respond_with_data(request: web.Request) -> web.StreamResponse:
        return await proxy.forward_data(request, data[1], request.path, data[0])

    app.router.add_get("/{path:.*}", respond)
    app.router.add_post(f"/{SERVICE}/{{method}}", respond_with_data)
    return app
