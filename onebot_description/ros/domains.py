"""Provides ROS domains that nothing else on this computer uses."""

import os
import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from onebot_description.errors import OneBotError
from onebot_description.ros.shared_memory import remove_broken_ports

# The ports of domains above 101 (RTPS 2.2, section 9.6.1.1) overlap with Linux's ephemeral ports.
_DOMAINS = range(1, 101)
_FIRST_PORT, _PORTS = 7400, 250  # domain 0's first port, and the number of ports per domain
# Offsets from a domain's first port: multicast discovery, unless on loopback, and ten participants.
_OFFSETS = (0, *range(10, 30, 2))


@contextmanager
def claimed_domain() -> Iterator[int]:
    """Yield a domain that no running robot, test, study or benchmark uses.

    Raises:
        OneBotError: all are in use.
    """
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
            try:
                # A name in the abstract namespace disappears with its process, however it ends.
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
    """Set ROS_DOMAIN_ID to an unused domain, with discovery restricted to this computer.

    The environment is restored afterwards.
    """
    remove_broken_ports()
    with claimed_domain() as domain, patch.dict(os.environ):
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        # Otherwise, settings made by a node in this process would also apply to the next node.
        for name in ("ROS_LOCALHOST_ONLY", "FASTRTPS_DEFAULT_PROFILES_FILE"):
            os.environ.pop(name, None)
        yield domain
