"""Who may talk to the page's server: a name of its own, its own pages, and a token where needed.

A program on this computer may leave out the Origin, which browsers always send with a WebSocket; it
could drive the robot through ROS just as well. With a token, it needs that, too.
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

# Where a server can listen on this computer, and how others reach it.

_MAX_PORT = 65535


def resolve(host: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    """Return the address that ``host``, a name or numbers, stands for, as sockets want it.

    Raises:
        OneBotError: it stands for none.
    """
    try:
        found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise not_here(host) from None
    # IPv4 first: "localhost" is 127.0.0.1 to everybody.
    family, _, _, _, address = min(found, key=lambda one: one[0] != socket.AF_INET)
    return family, address


def is_loopback(host: str) -> bool:
    """Return whether a host, a name or numbers, is reached from this computer only.

    Raises:
        OneBotError: it stands for no address.
    """
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        _, address = resolve(host, 0)
        return ipaddress.ip_address(str(address[0]).partition("%")[0]).is_loopback


def listen(host: str, port: int) -> socket.socket:
    """Listen on ``port`` of ``host``, or on any free one if it is in use (or 0).

    Raises:
        OneBotError: this host has no such address, or the port is not to be had.
    """
    if not 0 <= port <= _MAX_PORT:
        raise OneBotError(f"port:={port} is no port: write a number from 1 to 65535, or 0 for any")
    family, address = resolve(host, port)
    for chosen in (port, 0):
        try:
            listener = socket.socket(family, socket.SOCK_STREAM)
        except OSError:  # there is no IPv6 here, say
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
    """Return host and port as an address has them; one of this computer's, if it is any."""
    host, port = listener.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = _own_address(listener.family, host)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _own_address(family: int, any_address: str) -> str:
    """The address that others see; connecting a datagram socket sends nothing."""
    # Addresses kept for documentation (RFC 5737, RFC 3849): the way there is the way out.
    outside = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"
    with contextlib.closing(socket.socket(family, socket.SOCK_DGRAM)) as probe:
        try:
            probe.connect((outside, 9))
        except OSError:
            return "127.0.0.1" if family == socket.AF_INET else "::1"
        found = str(probe.getsockname()[0])
    return found if found != any_address else "127.0.0.1"


def not_here(host: str) -> OneBotError:
    """Return the complaint about a host that is none of this computer's."""
    return OneBotError(
        f"host:={host} is no address of this computer: write 127.0.0.1, or 0.0.0.0 for all"
    )


_HOST = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


def new_token() -> str:
    """Return one that cannot be guessed."""
    return secrets.token_urlsafe(16)


@dataclass(frozen=True)
class Access:
    """The rules.

    Attributes:
        token: what the address of the page must hold; "" for none.
        address: where the server listens, in numbers, such as 127.0.0.1.
        port: and on which port.
    """

    token: str
    address: str
    port: int

    @property
    def cookie_name(self) -> str:
        """The cookie's; with the port, because a host's cookies go to all of its servers."""
        return f"onebot_steering_{self.port}"

    @property
    def cookie(self) -> str:
        """What stands for the token in the cookie, without telling it."""
        return hmac.new(
            _bytes(self.token), b"cookie of the steering page", hashlib.sha256
        ).hexdigest()

    def refusal(self, host: str, origin: str | None, token: str | None, cookie: str | None) -> str:
        """Return why a request is refused, one sentence; "" if it is not.

        Args:
            host: its Host header.
            origin: its Origin header, None if it has none.
            token: of its query, None if there is none.
            cookie: of our name, None if there is none.
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
        """Say if it is the token, in a time that does not tell how much of it is right."""
        return bool(self.token) and token is not None and _equal(token, self.token)

    def knows(self, host: str) -> bool:
        """Say if a Host header can be ours; no name of somebody else's leads to loopback."""
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
    """A header as it may be repeated in an answer."""
    return "".join(c for c in text[:100] if c.isascii() and c.isprintable() and c not in '<>"&')


# Where a steering page is to be served, settled before its node is started.


class Place(NamedTuple):
    """Parameters of the page's node.

    Attributes:
        host: as it was asked for.
        port: one that is free.
        token: asked for in the page's address; "" for none.
        warning: what of it is not as it was asked for, a sentence; "" for nothing.
    """

    host: str
    port: int
    token: str
    warning: str = ""

    @property
    def parameters(self) -> dict[str, object]:
        """The node's parameters."""
        return {"host": self.host, "port": self.port, "token": self.token}


def choose_place(host: str, port: int, token: str) -> Place:
    """Return where the page can be served.

    Args:
        host: a name or numbers of this computer.
        port: another one is taken if it is in use; 0 for any.
        token: made anew if it is empty, and other computers can reach the page.

    Raises:
        OneBotError: the page cannot be served there.
    """
    with listen(host, port) as probe:
        address, free = probe.getsockname()[:2]
    if not token and not is_loopback(address):
        token = new_token()
    warning = f"port {port} is in use; using {free} instead" if port not in (0, free) else ""
    return Place(host, free, token, warning)
