"""The browser of the steering page's tests."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.steering_browser_support import Page


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
