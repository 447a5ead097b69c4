"""The browser of the steering page's tests, and what the tests of a file share."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from onebot_description.ros.domains import used_domain

if TYPE_CHECKING:
    from tests.onebot_bringup.steering_support import Steering
    from tests.steering_browser_support import Page


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """One ROS domain for all tests of a file."""
    with used_domain() as domain:
        yield domain


@pytest.fixture(scope="module")
def shared(domain: int) -> "Iterator[tuple[int, Steering]]":
    """The domain of a steering page that all tests of a file share, and its node."""
    from tests.onebot_bringup.steering_support import steering  # imports aiohttp and rclpy

    with steering() as node:
        yield domain, node


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[Page]":
    """One browser for all tests of a file; each opens its own node's page."""
    from tests.steering_browser_support import Page  # most tests here have no browser
    from tests.support_browser import browser

    with browser(tmp_path_factory.mktemp("profile")) as driver:
        yield Page(driver)


@pytest.fixture
def tab(chromium: "Page") -> "Iterator[Page]":
    """The browser without a page, and afterwards without what a test has left in it."""
    yield chromium
    chromium.let_go()
    chromium.emulate_nothing()
    chromium.devtools("Emulation.setTouchEmulationEnabled", enabled=False)
