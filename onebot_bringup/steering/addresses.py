"""Where a server can listen on this computer."""

import contextlib
import errno
import ipaddress
import socket
from typing import Any

from onebot_description.errors import OneBotError


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


def check_host(host: str) -> None:
    """Complain, before anything is started, about a host that cannot be listened on here.

    Raises:
        OneBotError: it is no address of this computer.
    """
    family, address = resolve(host, 0)
    try:
        with contextlib.closing(socket.socket(family, socket.SOCK_STREAM)) as probe:
            probe.bind(address)
    except OSError as error:
        if error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT):
            raise not_here(host) from None
        raise OneBotError(f"host:={host}: cannot listen there: {error.strerror}") from None


def not_here(host: str) -> OneBotError:
    """Return the complaint about a host that is none of this computer's."""
    return OneBotError(
        f"host:={host} is no address of this computer: write 127.0.0.1, or 0.0.0.0 for all"
    )
