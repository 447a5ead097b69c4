"""Finds addresses and ports for servers on this computer, and its display and browser."""

import contextlib
import errno
import ipaddress
import os
import secrets
import socket
import threading
import webbrowser
from typing import Any

from onebot_description.errors import OneBotError

LOOPBACK = "127.0.0.1"
# Errors of an address that this computer does not have, or of its family.
_NOT_HERE = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)


def _resolve(host: str, port: int) -> tuple[socket.AddressFamily, tuple[Any, ...]]:
    try:
        addresses = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise _not_here(host) from None
    # IPv4 first: "localhost" is expected to be 127.0.0.1.
    family, _, _, _, address = min(addresses, key=lambda address: address[0] != socket.AF_INET)
    return family, address


def is_loopback(host: str) -> bool:
    """Return whether ``host``, a name or an IP address of a computer, is a loopback address."""
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        _, address = _resolve(host, 0)
        return ipaddress.ip_address(str(address[0]).partition("%")[0]).is_loopback


def listen(host: str, port: int) -> socket.socket:
    """Listen on ``port`` of ``host``, or on a free port if it is in use or 0.

    Args:
        host: a name or an IP address of this computer.
        port: the preferred port.

    Raises:
        OneBotError: this computer does not have the address, or no port is available.
    """
    family, address = _resolve(host, port)
    dualstack = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
    for chosen in (port, 0):
        try:
            listener = socket.create_server(
                (address[0], chosen, *address[2:]), family=family, dualstack_ipv6=dualstack
            )
        except OSError as error:
            if error.errno in _NOT_HERE:
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
    host, port = listener.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = _own_address(listener.family)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _own_address(family: int) -> str:
    """Return the address that other computers see; connecting a datagram socket sends nothing."""
    # Addresses reserved for documentation (RFC 5737, RFC 3849) use the default route.
    outside = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.connect((outside, 9))
        return str(probe.getsockname()[0])
    return "127.0.0.1" if family == socket.AF_INET else "::1"


def _not_here(host: str) -> OneBotError:
    return OneBotError(
        f"host:={host} is not an address of this computer: write 127.0.0.1, or 0.0.0.0 for all"
    )
