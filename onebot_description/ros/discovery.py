"""Sets which nodes this process discovers: on this computer, on a network, or through a server.

ROS and Fast DDS read this from environment variables when rclpy is initialized.
"""

import os
import re
import socket

from onebot_description.elements.packages import package_share
from onebot_description.errors import OneBotError
from onebot_description.ros.shared_memory import remove_broken_ports

RANGE, SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DISCOVERY_SERVER"
LOCALHOST, SUBNET = "localhost", "subnet"
# The argument ``discovery`` is a range, or the address of a server.
ARGUMENT = re.compile(rf"{LOCALHOST}|{SUBNET}|(?P<host>[\w.-]+):(?P<port>[0-9]{{1,5}})")
WANTED = f"{LOCALHOST}, {SUBNET}, or HOST:PORT of a discovery server (fastdds discovery -i 0)"

_SUPER_CLIENT = "ROS_SUPER_CLIENT"
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
MAX_DOMAIN = 232  # beyond it the ports of DDS (RTPS 2.2, section 9.6.1.1) exceed 65535


def discovery_variables(discovery: str, domain_id: int | None, *, forced: bool) -> dict[str, str]:
    """Return the environment variables for the arguments ``discovery`` and ``domain_id``.

    Args:
        discovery: a range, or the address of a server.
        domain_id: the domain; None to use the environment's.
        forced: whether ``discovery`` was given, and therefore overrides the environment.
    """
    variables = _variables(discovery) if forced or not _is_chosen() else {}
    return variables | ({} if domain_id is None else {"ROS_DOMAIN_ID": str(domain_id)})


def _variables(argument: str) -> dict[str, str]:
    match = ARGUMENT.fullmatch(argument)
    if match is None or match["host"] is None:
        return {RANGE: argument.upper(), SERVER: ""}
    host = match["host"]
    try:
        # Given a name, Fast DDS would use only an IPv6 address if there is one.
        address = socket.gethostbyname(host)
    except OSError as error:
        raise OneBotError(f"discovery:={argument}: no host {host}: {error.strerror}") from None
    return {RANGE: SUBNET.upper(), SERVER: f"{address}:{match['port']}"}


def _is_chosen() -> bool:
    """Return whether the environment has a range or a server."""
    return bool(os.environ.get(RANGE) or server())


def use_local_discovery() -> None:
    """Discover only this computer, unless the environment sets another range or a server."""
    if not _is_chosen():
        os.environ[RANGE] = LOCALHOST.upper()


def server() -> str:
    """Return the address of the discovery server; empty without one."""
    return os.environ.get(SERVER, "").strip(";")


def question() -> str:
    """Return the question for when no other node is discovered; empty without a server."""
    return f"is the discovery server at {server()} running (fastdds discovery -i 0)?"


def configure_discovery(*, whole_graph: bool = False) -> None:
    """Set up Fast DDS for the range of discovery; call it before rclpy is initialized.

    On one computer, nodes listen on loopback only: the range limits which nodes they look for, but
    another computer that looks for this one (ROS_STATIC_PEERS) would find them. They announce
    themselves five times a second. Fast DDS 2.14 announces a participant before it listens, so
    about every other first answer is lost, and by default the next announcement is 3 s away.

    On a network, a node must not block when it sends to a computer that cannot be reached: while
    Linux resolves its address, for 3 s each time, packets fill the socket's buffer, and the control
    loop would stop. Dropped packets of reliable topics are sent again.

    Profiles or transports that the user has set are kept. Broken ports, which would block the
    start, are removed.

    Args:
        whole_graph: with a discovery server, also discover nodes that have no topic in common with
            this process, for introspection; in a large fleet, these are many.
    """
    remove_broken_ports()
    if whole_graph and server():
        os.environ.setdefault(_SUPER_CLIENT, "TRUE")
    if any(os.environ.get(name) for name in (*_PROFILES, _TRANSPORTS)):
        return
    local = os.environ.get(RANGE) == LOCALHOST.upper() and not server()
    name = "one_computer" if local else "network"
    profile = package_share("onebot_description") / f"config/{name}.xml"
    os.environ[_PROFILES[0]] = str(profile)
