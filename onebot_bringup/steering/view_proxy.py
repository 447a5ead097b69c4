"""A proxy of the robot's view: Rerun's page and its data on the steering page's address.

Rerun's page gets its data by gRPC-web from the host and port of its ``url=`` parameter, at
``/rerun.sdk_comms.v1alpha1.MessageProxyService/...``. Here that is the steering page's server,
so that one port (such as of an SSH tunnel) and one token are enough. Requests that write into the
recording are rejected.
"""

import re
from dataclasses import dataclass
from urllib.parse import quote, unquote

from aiohttp import web

from onebot_bringup.serving.rerun_proxy import RerunProxy, content_policy

_POLICY = f"{content_policy()}; frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
_SERVICE = "/rerun.sdk_comms.v1alpha1.MessageProxyService"
_METHODS = frozenset({"ReadMessages", "ReadTables"})
_PAGE = re.compile(r"http://127\.0\.0\.1:(\d{1,5})/\?(\S+)")
_DATA = re.compile(r"rerun\+http://127\.0\.0\.1:(\d{1,5})/proxy")


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
    """The routes of the robot's view."""

    def __init__(self) -> None:
        """Start without a viewer."""
        self.view: View | None = None  # the viewer, if there is one

    def add_to(self, app: web.Application) -> None:
        """Add the routes."""
        self._proxy = RerunProxy(app, _POLICY, "The robot's view does not answer at the moment.")
        app.router.add_get("/view/{path:.*}", self._page)
        app.router.add_post(_SERVICE + "/{method}", self._data)

    async def _page(self, request: web.Request) -> web.StreamResponse:
        view = self._known()
        if not request.query_string and not request.match_info["path"]:
            raise web.HTTPFound(view.path(request.host))
        path = request.rel_url.raw_path_qs.removeprefix("/view")
        return await self._proxy.forward_page(request, view.page_port, path)

    async def _data(self, request: web.Request) -> web.StreamResponse:
        view, method = self._known(), request.match_info["method"]
        if method not in _METHODS:
            raise web.HTTPForbidden(text="The view is for looking: nothing is written into it.\n")
        return await self._proxy.forward_data(request, view.page_port, f"{_SERVICE}/{method}")

    def _known(self) -> View:
        if self.view is None:
            raise web.HTTPServiceUnavailable(text="There is no view of the robot yet.\n")
        return self.view
