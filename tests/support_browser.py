"""A real browser for pages: Debian's Chromium, driven by Selenium, with software WebGL."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.chrome.service import Service

from tests.support import require_program, wait_for

# Without the background flags Chromium itself talks to other hosts, which is not the page's doing.
_FLAGS = (
    "--headless=new --no-sandbox --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-angle=swiftshader "
    "--enable-unsafe-swiftshader --disable-dev-shm-usage --window-size=1280,800"
)


@contextmanager
def browser(profile: Path) -> Iterator[webdriver.Chrome]:
    """Start Chromium with an empty profile; skip where it is missing, but fail in CI."""
    options = webdriver.ChromeOptions()
    options.binary_location = require_program("chromium")
    for flag in [*_FLAGS.split(), f"--user-data-dir={profile}"]:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    driver = webdriver.Chrome(
        options=options, service=Service(require_program("chromedriver", "chromium-driver"))
    )
    try:
        yield driver
    finally:
        driver.quit()


def screenshot(driver: webdriver.Chrome) -> bytes:
    """The page as PNG; on a busy machine Chromium gives up after 10 s, and is asked again."""

    def taken() -> bytes:
        try:
            return driver.get_screenshot_as_png()
        except TimeoutException:
            return b""

    return wait_for(taken, "a picture of the page", timeout=240.0)


def hosts_reached(driver: webdriver.Chrome) -> set[str]:
    """Hosts the page sent requests to, without those that its policy kept from leaving."""
    asked: dict[str, str] = {}
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        parameters = message["params"]
        if message["method"] == "Network.requestWillBeSent":
            asked[parameters["requestId"]] = parameters["request"]["url"]
        elif message["method"] == "Network.loadingFailed" and parameters.get("blockedReason"):
            asked.pop(parameters["requestId"], None)
    return {urlsplit(url).hostname or "" for url in asked.values() if url.startswith("http")}
