"""Controls access to the steering page's server: its address, and checks of requests.

A request needs a Host of this server, an Origin of its own pages, and the token if one is set.
Browsers always send the Origin with a WebSocket. A program on this computer may omit it, since it
could drive the robot through ROS anyway, but it needs the token if one is set.

The robot's view is a frame without cookies and with an opaque origin, "null". Its requests have a
key in their path instead.
"""

import hashlib
import hmac
import secrets
from dataclasses import dataclass

from onebot_bringup.serving.origin import refusal
from onebot_bringup.serving.ports import is_loopback

_OTHER_NAMES = {"127.0.0.1": "localhost", "localhost": "127.0.0.1"}


def other_site(host: str) -> str:
    """Return ``host`` (a Host header) with the other name of loopback; "" if it has none.

    To a browser that is another site, which runs in another process.
    """
    name, colon, port = host.lower().partition(":")
    return f"{_OTHER_NAMES[name]}{colon}{port}" if name in _OTHER_NAMES else ""


@dataclass(frozen=True)
class Access:
    """Checks requests to the server."""

    token: str  # required in the address of the page; "" for none
    address: str  # the IP address that the server listens on, such as 127.0.0.1
    port: int

    @property
    def cookie_name(self) -> str:
        """The cookie's name, with the port, since all servers on a host receive its cookies."""
        return f"onebot_steering_{self.port}"

    @property
    def cookie(self) -> str:
        """The cookie's value: a hash of the token."""
        return hmac.new(
            _bytes(self.token), b"cookie of the steering page", hashlib.sha256
        ).hexdigest()

    def refusal(self, host: str, origin: str | None, token: str | None, cookie: str | None) -> str:
        """Return the reason why a request is rejected, a sentence; "" if it is accepted.

        Args:
            host: the Host header.
            origin: the Origin header, if there is one.
            token: the token in the request's address, if there is one.
            cookie: the value of our cookie, if there is one.
        """
        if problem := refusal(self.address, host, origin, [f"http://{host}"]):
            return problem
        if self.token and not self.is_token(token) and not _equal(cookie or "", self.cookie):
            return "The token is missing or wrong: open the whole address that was printed."
        return ""

    def view_refusal(self, host: str, origin: str | None) -> str:
        """Return why a request with the view's key is rejected; "" if it is accepted.

        Its Origin may be the view's, or that of the page around it.
        """
        pages = f"http://{host}", f"http://{other_site(host)}"
        return refusal(self.address, host, origin, ["null", *pages])

    def is_token(self, token: str | None) -> bool:
        """Whether ``token`` is correct, compared in constant time."""
        return bool(self.token) and token is not None and _equal(token, self.token)


def _equal(first: str, second: str) -> bool:
    return hmac.compare_digest(_bytes(first), _bytes(second))


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogatepass")


def token_for(address: str, token: str) -> str:
    """Return the required token: the given one, or a new one if other computers can reach the page.

    Args:
        address: the IP address that the server listens on.
        token: the given token; "" for none.
    """
    return token or ("" if is_loopback(address) else secrets.token_urlsafe(16))
