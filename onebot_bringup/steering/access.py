"""Access to the steering page's server: its address, and the checks of requests.

A request needs a Host of this server, an Origin of its own pages, and the token where one is set. A
program on this computer may omit the Origin, which browsers always send with a WebSocket: it could
drive the robot through ROS anyway. If a token is set, it needs that, too.
"""

import contextlib
import errno
import hashlib
import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from onebot_description.errors import OneBotError

_MAX_PORT = 65535
_HOST = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


def resolve(host: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    """Return the socket family and address of ``host``, a name or an IP address.

    Raises:
        OneBotError: it has none.
    """
    try:
        found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise not_here(host) from None
    # IPv4 first: "localhost" is expected to be 127.0.0.1.
    family, _, _, _, address = min(found, key=lambda one: one[0] != socket.AF_INET)
    return family, address


def is_loopback(host: str) -> bool:
    """Return whether ``host``, a name or an IP address, is a loopback address.

    Raises:
        OneBotError: it has no address.
    """
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        _, address = resolve(host, 0)
        return ipaddress.ip_address(str(address[0]).partition("%")[0]).is_loopback


def listen(host: str, port: int) -> socket.socket:
    """Listen on ``port`` of ``host``, or on any free one if it is in use (or 0).

    Raises:
        OneBotError: this computer does not have the address, or the port is not available.
    """
    if not 0 <= port <= _MAX_PORT:
        raise OneBotError(
            f"port:={port} is not a port: write a number from 1 to 65535, or 0 for any"
        )
    family, address = resolve(host, port)
    for chosen in (port, 0):
        try:
            listener = socket.socket(family, socket.SOCK_STREAM)
        except OSError:  # such as IPv6 where there is none
            raise not_here(host) from None
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address[0], chosen, *address[2:]))
            listener.listen(128)
        except OSError as error:
            listener.close()
            if isinstance(error, PermissionError):
                raise OneBotError(
                    f"port:={port} is not allowed to you: use one from 1024 on"
                ) from None
            if error.errno == errno.EADDRNOTAVAIL:
                raise not_here(host) from None
            continue
        listener.setblocking(False)
        return listener
    raise OneBotError(f"there is no free port on {host}")


def reachable_as(listener: socket.socket) -> str:
    """Return host:port for a URL; for a wildcard address, with an address of this computer."""
    host, port = listener.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = _own_address(listener.family, host)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _own_address(family: int, any_address: str) -> str:
    """The address that other computers see; connecting a datagram socket sends nothing."""
    # Addresses reserved for documentation (RFC 5737, RFC 3849) are routed by default.
    outside = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"
    with contextlib.closing(socket.socket(family, socket.SOCK_DGRAM)) as probe:
        try:
            probe.connect((outside, 9))
        except OSError:
            return "127.0.0.1" if family == socket.AF_INET else "::1"
        found = str(probe.getsockname()[0])
    return found if found != any_address else "127.0.0.1"


def not_here(host: str) -> OneBotError:
    """Return the error for a host that is not an address of this computer."""
    return OneBotError(
        f"host:={host} is not an address of this computer: write 127.0.0.1, or 0.0.0.0 for all"
    )


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(16)


@dataclass(frozen=True)
class Access:
    """Checks requests to the server."""

    token: str  # required in the address of the page; "" for none
    address: str  # the IP address that the server listens on, such as 127.0.0.1
    port: int

    @property
    def cookie_name(self) -> str:
        """The cookie's name; with the port, as all servers of a host receive its cookies."""
        return f"onebot_steering_{self.port}"

    @property
    def cookie(self) -> str:
        """The cookie's value: a hash of the token."""
        return hmac.new(
            _bytes(self.token), b"cookie of the steering page", hashlib.sha256
        ).hexdigest()

    def refusal(self, host: str, origin: str | None, token: str | None, cookie: str | None) -> str:
        """Return why a request is rejected, one sentence; "" if it is accepted.

        Args:
            host: the Host header.
            origin: the Origin header, if any.
            token: of the query, if any.
            cookie: the value of the cookie of this server, if any.
        """
        if not self.knows(host):
            names = ", ".join(sorted(self._names))
            return f'This server is not "{_shown(host)}": open it as {names}.'
        if origin is not None and origin.lower() != f"http://{host}".lower():
            return f"Pages of {_shown(origin)} may not steer this robot."
        if self.token and not self.is_token(token) and not _equal(cookie or "", self.cookie):
            return "The token is missing or wrong: open the whole address that was printed."
        return ""

    def is_token(self, token: str | None) -> bool:
        """Whether ``token`` is right; takes the same time for any wrong one."""
        return bool(self.token) and token is not None and _equal(token, self.token)

    def knows(self, host: str) -> bool:
        """Whether a Host header can be of this server; other names must not lead to loopback."""
        found = _HOST.fullmatch(host)
        if found is None:
            return False
        return not is_loopback(self.address) or found[1].lower() in self._names

    @property
    def _names(self) -> Iterable[str]:
        return _LOOPBACK_NAMES | {self.address}


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(_bytes(one), _bytes(other))


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogatepass")


def _shown(text: str) -> str:
    """A header as it may be repeated in a response."""
    return "".join(c for c in text[:100] if c.isascii() and c.isprintable() and c not in '<>"&')


class BindAddress(NamedTuple):
    """Where the page is served, checked before its node is started."""

    host: str  # as given
    port: int  # a free one
    token: str  # required in the page's address; "" for none
    warning: str = ""  # a sentence if the port is another one than given

    @property
    def parameters(self) -> dict[str, object]:
        """The parameters of the page's node."""
        return {"host": self.host, "port": self.port, "token": self.token}


def choose_bind_address(host: str, port: int, token: str) -> BindAddress:
    """Return a free address to serve the page on.

    Args:
        host: a name or an IP address of this computer.
        port: another one is chosen if it is in use; 0 for any.
        token: generated if it is empty and other computers can reach the page.

    Raises:
        OneBotError: the page cannot be served on this host or port.
    """
    with listen(host, port) as probe:
        address, free = probe.getsockname()[:2]
    if not token and not is_loopback(address):
        token = new_token()
    warning = f"port {port} is in use; using {free} instead" if port not in (0, free) else ""
    return BindAddress(host, free, token, warning)
