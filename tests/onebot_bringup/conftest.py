"""The browser of the steering page's tests, and what the tests of a file share."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from onebot_description.ros.domains import used_domain

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

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


@pytest.fixture(scope="session")
def window(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[Chrome]":
    """One browser for all files of a process: it takes seconds to start."""
    from tests.support_browser import browser  # most tests here have no browser

    with browser(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture(scope="module")
def chromium(window: "Chrome") -> "Iterator[Page]":
    """The browser as the tests of a file share it; each opens its own node's page."""
    from tests.steering_browser_support import Page

    page = Page(window)
    yield page
    page.emulate_nothing()
    window.get("about:blank")


@pytest.fixture
def tab(chromium: "Page") -> "Iterator[Page]":
    """The browser without a page, and afterwards without what a test has left in it."""
    yield chromium
    chromium.let_go()
    chromium.emulate_nothing()
    chromium.devtools("Emulation.setTouchEmulationEnabled", enabled=False)


@pytest.fixture
def gamepad(tab: "Page", request: pytest.FixtureRequest) -> Iterator[None]:
    """Pages that are opened after it have one, or what the test's parameter makes of it."""
    from tests.steering_browser_support import GAMEPAD

    source = getattr(request, "param", GAMEPAD)
    hook = tab.devtools("Page.addScriptToEvaluateOnNewDocument", source=source)
    yield
    tab.devtools("Page.removeScriptToEvaluateOnNewDocument", **hook)
