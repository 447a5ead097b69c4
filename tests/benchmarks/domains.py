"""ROS domains that nothing else on this machine has."""

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager

# Beyond 101 the ports of a domain (RTPS 2.2, section 9.6.1.1) meet those that Linux hands out.
_DOMAINS = range(1, 101)


@contextmanager
def claimed_domain() -> Iterator[int]:
    """A domain that no other test or benchmark on this machine has, though several run at once."""
    for domain in random.sample(_DOMAINS, len(_DOMAINS)):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
            try:
                # A name in the abstract namespace goes when its process does, however it ends.
                claim.bind(f"\0onebot-test-domain-{domain}")
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError(f"all {len(_DOMAINS)} ROS domains are in use by tests")
