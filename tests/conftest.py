"""Fixtures shared by all tests."""

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

# Beyond 101 the ports of a domain (RTPS 2.2, section 9.6.1.1) meet those that Linux hands out.
_DOMAINS = range(1, 101)


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS_DOMAIN_ID of the test's own, with discovery kept on this host."""
    with _claimed_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)
        yield domain


@contextmanager
def _claimed_domain() -> Iterator[int]:
    """A domain that no other test on this machine has, though several runs go side by side."""
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
