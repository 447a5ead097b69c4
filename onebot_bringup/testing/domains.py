"""ROS domains that nothing else on this machine has."""

import os
import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from onebot_description.errors import OneBotError
from onebot_description.ros.shared_memory import remove_broken_ports

# Beyond 101 the ports of a domain (RTPS 2.2, section 9.6.1.1) meet those that Linux hands out.
_DOMAINS = range(1, 101)
_FIRST_PORT, _PORTS = 7400, 250  # of multicast discovery, in domain 0; and for each domain
# From its first port: multicast discovery, which a node on loopback may lack, and ten participants.
_OFFSETS = (0, *range(10, 30, 2))


@contextmanager
def claimed_domain() -> Iterator[int]:
    """A domain that no other test or benchmark has, though several run at once, nor a robot.

    Raises:
        OneBotError: all are in use.
    """
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
            try:
                # A name in the abstract namespace goes when its process does, however it ends.
                claim.bind(f"\0onebot-test-domain-{domain}")
                for offset in _OFFSETS:
                    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                        probe.bind(("", _FIRST_PORT + _PORTS * domain + offset))
            except OSError:
                continue
            yield domain
            return
    raise OneBotError(f"all {len(_DOMAINS)} ROS domains are in use on this computer")


@contextmanager
def used_domain() -> Iterator[int]:
    """Set ROS_DOMAIN_ID to a domain that nobody else has, with discovery kept on this computer.

    The environment is as before afterwards.
    """
    remove_broken_ports()
    with claimed_domain() as domain, patch.dict(os.environ):
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        # What a node in this process has set would hold for the next one, too.
        for name in ("ROS_LOCALHOST_ONLY", "FASTRTPS_DEFAULT_PROFILES_FILE"):
            os.environ.pop(name, None)
        yield domain
