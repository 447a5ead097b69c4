"""Decides which requests a server accepts: under its own names, from its own pages.

A page of another site can make a browser send requests here, and can let its name resolve to
127.0.0.1 (DNS rebinding). Browsers report where a request comes from (Origin) and goes to (Host).
Requests without an Origin, such as for pictures, say instead whether they come from another site
(Sec-Fetch-Site; only to servers on this computer).
"""

import re
from collections.abc import Iterable

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from onebot_bringup.serving.ports import is_loopback

_HOST = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


def refusal(address: str, host: str, origin: str | None, allowed: Iterable[str]) -> str:
    """Return the reason why a request is rejected, a sentence; "" if it is accepted.

    Args:
        address: the IP address that the server listens on.
        host: the Host header.
        origin: the Origin header, if there is one.
        allowed: origins whose pages may send requests, such as http://127.0.0.1:8080.
    """
    if not is_own_name(address, host):
        names = ", ".join(sorted(_LOOPBACK_NAMES | {address}))
        return f'This server is not "{_shown(host)}": open it as {names}.'
    if origin is not None and origin.lower() not in {site.lower() for site in allowed}:
        return f"Pages of {_shown(origin)} have no access to this robot."
    return ""


def foreign_refusal(request: web.Request) -> str:
    """Return why a request from another site is rejected; "" if it is accepted.

    Links to the page itself may be anywhere. Requests with an Origin are judged by that instead.
    """
    site, mode, target = (request.headers.get(f"Sec-Fetch-{n}") for n in ("Site", "Mode", "Dest"))
    link = request.path == "/" and (mode, target) == ("navigate", "document")
    if site not in ("cross-site", "same-site") or "Origin" in request.headers or link:
        return ""
    return "Pages of other sites have no access to this robot."


def is_own_name(address: str, host: str) -> bool:
    """Return whether a Host header can belong to the server that listens on ``address``.

    Any port is accepted, since a tunnel may use another one.
    """
    name = _HOST.fullmatch(host)
    if name is None:
        return False
    return not is_loopback(address) or name[1].lower() in _LOOPBACK_NAMES | {address}


def guard(address: str) -> Middleware:
    """Return middleware that only accepts requests of an application's own pages on ``address``."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        host = request.headers.get("Host", "")
        own_origins = [f"http://{host}"]
        problem = refusal(address, host, request.headers.get("Origin"), own_origins)
        if problem := problem or foreign_refusal(request):
            return web.Response(status=403, text=f"{problem}\n")
        return await handler(request)

    return check


def _shown(text: str) -> str:
    """Return a header in a form that is safe to repeat in a response."""
    return "".join(c for c in text[:100] if c.isascii() and c.isprintable() and c not in '<>"&')
