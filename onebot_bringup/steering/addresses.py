"""Where a server can listen on this computer, and how others reach it."""

import contextlib
import errno
import ipaddress
import socket
from typing import Any

from onebot_description.errors import OneBotError

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
