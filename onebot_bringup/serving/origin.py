"""Which requests a server takes: under its own names, from pages of its own.

A page of another site can make a browser send requests here, and its name can be made to lead to
127.0.0.1 (DNS rebinding). Browsers say where a request is from (Origin) and goes to (Host); where
they say no Origin, as for a picture, they say to servers on this computer whether it is from
another site (Sec-Fetch-Site).
"""

import re
from collections.abc import Iterable

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from onebot_bringup.serving.ports import is_loopback

_HOST = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


def refusal(address: str, host: str, origin: str | None, allowed: Iterable[str]) -> str:
    """Return why a request is rejected, one sentence; "" if it is accepted.

    ``address`` is the IP address that the server listens on, ``host`` and ``origin`` are headers of
    the request; pages of the origins ``allowed``, such as http://127.0.0.1:8080, may send it.
    """
    if not is_own_name(address, host):
        names = ", ".join(sorted(_LOOPBACK_NAMES | {address}))
        return f'This server is not "{_shown(host)}": open it as {names}.'
    if origin is not None and origin.lower() not in {site.lower() for site in allowed}:
        return f"Pages of {_shown(origin)} have no access to this robot."
    return ""


def foreign_refusal(request: web.Request) -> str:
    """Return why a request of another site is rejected; "" if it is accepted.

    A link to the page itself may be anywhere. What has an Origin is judged by that.
    """
    site, mode, target = (request.headers.get(f"Sec-Fetch-{n}") for n in ("Site", "Mode", "Dest"))
    link = request.path == "/" and (mode, target) == ("navigate", "document")
    if site not in ("cross-site", "same-site") or "Origin" in request.headers or link:
        return ""
    return "Pages of other sites have no access to this robot."


def is_own_name(address: str, host: str) -> bool:
    """Return whether a Host header can be of the server that listens on ``address``.

    Any port will do: a tunnel may lead to it from another one.
    """
    name = _HOST.fullmatch(host)
    if name is None:
        return False
    return not is_loopback(address) or name[1].lower() in _LOOPBACK_NAMES | {address}


def guard(address: str) -> Middleware:
    """Return what keeps an application on ``address`` to requests of its own pages."""

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
    """A header as it may be repeated in a response."""
    return "".join(c for c in text[:100] if c.isascii() and c.isprintable() and c not in '<>"&')
