"""Fixtures shared by all tests."""

import itertools
import os

import pytest

# Each process of a parallel run and each test draws from its own block, so that no two tests ever
# hear each other. Fast DDS allows domains up to 232; staying under 100 avoids ephemeral ports.
_domains = itertools.cycle(range(1, 100))


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """A ROS_DOMAIN_ID of the test's own, with discovery kept on this host."""
    domain = next(_domains)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    return domain
