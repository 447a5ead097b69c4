"""A proxy of the robot's view: Rerun's page and its data on the steering page's address.

Rerun's page gets its data by gRPC-web from the host and port of its ``url=`` parameter, at
``/rerun.sdk_comms.v1alpha1.MessageProxyService/...``. Here that is the steering page's server,
so that one port (such as of an SSH tunnel) and one token are enough. Requests that write into the
recording are rejected.
"""

import re
from dataclasses import dataclass
from urllib.parse import quote, unquote

import aiohttp
from aiohttp import web
from yarl import URL

from onebot_bringup.ports import LOOPBACK

VIEW_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' data: blob:; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)
_SERVICE = "/rerun.sdk_comms.v1alpha1.MessageProxyService"
_METHODS = frozenset({"ReadMessages", "ReadTables"})
_PAGE = re.compile(r"http://127\.0\.0\.1:(\d{1,5})/\?(\S+)")
_DATA = re.compile(r"rerun\+http://127\.0\.0\.1:(\d{1,5})/proxy")
_ANSWER_HEADERS = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")
_AWAY = "The robot's view does not answer at the moment."


@dataclass(frozen=True)
class View:
    """The address of a viewer's page on this computer."""

    page_port: int  # of the page's server, on 127.0.0.1
    data_port: int  # of the recording's server, on 127.0.0.1
    options: tuple[str, ...] = ()  # the other parameters of the page's address
    serial: int = 0  # the number of the viewer: a page reloads the view when it changes

    @classmethod
    def parse(cls, address: str, serial: int = 0) -> "View | None":
        """Parse the message of rerun_viewer's ~/page; None if it is no page on this computer."""
        page = _PAGE.fullmatch(address)
        if page is None:
            return None
        words = page[2].split("&")
        data = [_DATA.fullmatch(unquote(word[4:])) for word in words if word.startswith("url=")]
        if len(data) != 1 or data[0] is None:
            return None
        ports = int(page[1]), int(data[0][1])
        if not all(0 < port < 65536 for port in ports):
            return None
        return cls(*ports, tuple(word for word in words if not word.startswith("url=")), serial)

    def path(self, host: str) -> str:
        """Return where the view is on this server, whose name for the browser is ``host``."""
        # Without a port, Rerun's page would take that of its own servers.
        full = host if re.search(r":\d+$", host) else f"{host}:80"
        words = [f"url={quote(f'rerun+http://{full}/proxy', safe=':/[]')}", *self.options]
        return f"/view/?{'&'.join(words)}&view={self.serial}"


class ViewProxy:
    """Forwards requests to the viewer's servers."""

    def __init__(self) -> None:
        """Start without a viewer."""
        self.view: View | None = None  # the viewer, if there is one
        self._session: aiohttp.ClientSession | None = None
        self._passing: set[aiohttp.ClientResponse] = set()

    def add_to(self, app: web.Application) -> None:
        """Add the routes."""
        app.router.add_get("/view/{path:.*}", self._page)
        app.router.add_post(_SERVICE + "/{method}", self._data)
        app.on_startup.append(self._open)
        app.on_shutdown.append(self._close)

    async def _open(self, _: web.Application) -> None:
        self._session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0),
            timeout=aiohttp.ClientTimeout(total=None, sock_connect=5.0),
            cookie_jar=aiohttp.DummyCookieJar(),
            auto_decompress=False,
        )

    async def _close(self, _: web.Application) -> None:
        """End what is being passed on: a recording has no end of its own."""
        for found in self._passing:
            found.close()
        if self._session is not None:
            await self._session.close()

    async def _page(self, request: web.Request) -> web.StreamResponse:
        view = self._known()
        if not request.query_string and not request.match_info["path"]:
            raise web.HTTPFound(view.path(request.host))
        path = request.rel_url.raw_path_qs.removeprefix("/view")
        url = URL(f"http://{LOOPBACK}:{view.page_port}{path}", encoded=True)
        return await self._pass_on(request, "GET", url, {})

    async def _data(self, request: web.Request) -> web.StreamResponse:
        view, method = self._known(), request.match_info["method"]
        if method not in _METHODS:
            raise web.HTTPForbidden(text="The view is for looking: nothing is written into it.\n")
        url = URL(f"http://{LOOPBACK}:{view.data_port}{_SERVICE}/{method}", encoded=True)
        headers = {
            name: value
            for name, value in request.headers.items()
            if name.lower() in ("content-type", "accept") or "grpc" in name.lower()
        }
        return await self._pass_on(request, "POST", url, headers, await request.read())

    def _known(self) -> View:
        if self.view is None:
            raise web.HTTPServiceUnavailable(text="There is no view of the robot yet.\n")
        return self.view

    async def _pass_on(
        self,
        request: web.Request,
        method: str,
        url: URL,
        headers: dict[str, str],
        body: bytes | None = None,
    ) -> web.StreamResponse:
        """Send the request to a server of the viewer, and stream its response."""
        assert self._session is not None
        try:
            asked = self._session.request(
                method, url, headers=headers, data=body, allow_redirects=False
            )
            async with asked as found:
                self._passing.add(found)
                try:
                    return await _copy(found, request)
                finally:
                    self._passing.discard(found)
        except aiohttp.ClientConnectorError:
            raise web.HTTPBadGateway(text=f"{_AWAY}\n") from None
        except (aiohttp.ClientError, ConnectionError):
            # One of both ends has left in the middle: so ends this connection, too.
            if request.transport is not None:
                request.transport.close()
            raise web.HTTPBadGateway(text=f"{_AWAY}\n") from None


async def _copy(found: aiohttp.ClientResponse, request: web.Request) -> web.StreamResponse:
    """Answer as a server of the viewer's does, piece by piece as it comes."""
    answer = web.StreamResponse(status=found.status)
    for name, value in found.headers.items():
        if name.lower().startswith("grpc-") or name in _ANSWER_HEADERS:
            answer.headers[name] = value
    answer.headers["Content-Security-Policy"] = VIEW_POLICY
    await answer.prepare(request)
    async for chunk in found.content.iter_any():
        await answer.write(chunk)
    await answer.write_eof()
    return answer
