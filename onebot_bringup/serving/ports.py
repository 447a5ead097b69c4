"""Finds addresses and ports for servers on this computer, and its display and browser."""

import contextlib
import errno
import ipaddress
import os
import secrets
import socket
import threading
import webbrowser

from onebot_description.errors import OneBotError

LOOPBACK = "127.0.0.1"


def _resolve(host: str) -> str:
    """Return the IPv4 address of a computer."""
    try:
        return socket.gethostbyname(host or LOOPBACK)
    except (OSError, UnicodeError):
        raise _not_here(host) from None


def is_loopback(host: str) -> bool:
    """Return whether ``host``, a name or an IP address of a computer, is a loopback address."""
    return ipaddress.ip_address(_resolve(host)).is_loopback


def listen(host: str, port: int) -> socket.socket:
    """Listen on ``port`` of ``host``, or on a free port if it is in use or 0.

    Args:
        host: a name or an IPv4 address of this computer.
        port: the preferred port.

    Raises:
        OneBotError: this computer does not have the address, or no port is available.
    """
    address = _resolve(host)
    for chosen in (port, 0):
        try:
            listener = socket.create_server((address, chosen))
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise _not_here(host) from None
            continue
        listener.setblocking(False)
        return listener
    raise OneBotError(f"there is no free port on {host}")


def free_port() -> int:
    """Return a port that is free on loopback."""
    with listen(LOOPBACK, 0) as probe:
        return int(probe.getsockname()[1])


def hidden_address() -> tuple[str, int]:
    """Return a loopback address that cannot be guessed, and a free port on it.

    All of 127.0.0.0/8 is loopback on Linux; elsewhere only the port is random.
    """
    address = str(ipaddress.ip_address("127.0.0.0") + secrets.randbelow((1 << 24) - 2) + 1)
    with contextlib.suppress(OneBotError), listen(address, 0) as probe:
        return address, int(probe.getsockname()[1])
    return LOOPBACK, free_port()


def answers(port: int) -> bool:
    """Return whether something accepts connections on 127.0.0.1:``port``."""
    try:
        with socket.create_connection((LOOPBACK, port), timeout=0.2):
            return True
    except OSError:
        return False


def has_display() -> bool:
    """Return whether a window could be opened here."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_in_browser(url: str) -> None:
    """Open a page if there is a display, in the background, since some browsers block."""
    if has_display():
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def reachable_as(listener: socket.socket) -> str:
    """Return host:port for a URL; a wildcard address becomes an address of this computer."""
    host, port = listener.getsockname()
    return f"{_own_address() if host == '0.0.0.0' else host}:{port}"


def _own_address() -> str:
    """Return the address that other computers see; connecting a datagram socket sends nothing."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            # An address reserved for documentation (RFC 5737) uses the default route.
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return LOOPBACK
        return str(probe.getsockname()[0])


def _not_here(host: str) -> OneBotError:
    return OneBotError(
        f"host:={host} is not an address of this computer: write 127.0.0.1, or 0.0.0.0 for all"
    )
