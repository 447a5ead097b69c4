"""Where a steering page is to be served, settled before its node is started.

A node that is started again after a crash is then found again by the pages that are open.
"""

from typing import NamedTuple

from onebot_bringup.steering.access import new_token
from onebot_bringup.steering.addresses import is_loopback, listen


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
