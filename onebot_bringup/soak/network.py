"""A network of one's own: its only link is loopback, which can be cut."""

import ctypes
import fcntl
import socket
import struct

_NEW_NETWORK = 0x40000000  # CLONE_NEWNET (linux/sched.h)
_SET_FLAGS = 0x8914  # SIOCSIFFLAGS (linux/sockios.h)
_UP = 0x1 | 0x40 | 0x1000  # IFF_UP, IFF_RUNNING, IFF_MULTICAST


def enter_own_network() -> bool:
    """Move this process, and what it starts from now on, there; False where that is not allowed."""
    try:
        if ctypes.CDLL(None).unshare(_NEW_NETWORK):
            return False
        set_link(True)
    except (OSError, AttributeError):
        return False
    return True


def set_link(up: bool) -> None:
    """Connect loopback, or cut it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sh22x", b"lo", _UP if up else 0))
