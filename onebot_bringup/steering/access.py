"""Who may talk to the page's server: a name of its own, its own pages, and a token where needed.

A program on this computer may leave out the Origin, which browsers always send with a WebSocket; it
could drive the robot through ROS just as well. With a token, it needs that, too.
"""

import hashlib
import hmac
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from onebot_bringup.ports import is_loopback, listen

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
