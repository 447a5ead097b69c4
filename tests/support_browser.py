"""A real browser for pages: Debian's Chromium, driven by Selenium, with software WebGL."""

import base64
import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from tests.support import require_program, wait_for
from tests.support_rendering import colored, pixels

# Seconds that a failing test waits for a page that draws: software WebGL takes some 20 s to the
# first picture on two cores, and ten times as long on a busy machine.
DRAWING_PATIENCE = 600.0
# Without the background flags Chromium itself talks to other hosts, which is not the page's doing.
_FLAGS = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-dev-shm-usage"
)
# It would compile Rerun's page a second time, for speed, which takes longer than a test draws.
_WEBGL = "--use-angle=swiftshader --enable-unsafe-swiftshader --js-flags=--no-wasm-tier-up"
_NO_WEBGL = "--disable-gpu"  # a quarter less of the processor's time
_SCREEN = "-screen 0 1400x1000x24 -nolisten tcp"
# Of a window, in pixels: what a page draws in software takes as long as it has pixels.
SMALL = (800, 640)


@contextmanager
def browser(
    profile: Path,
    size: tuple[int, int] = (1280, 800),
    headless: bool = True,
    *,
    webgl: bool = False,
) -> Iterator[webdriver.Chrome]:
    """Start Chromium with an empty profile; skip where it is missing, but fail in CI.

    Args:
        profile: a folder of its own.
        size: of the window, in pixels.
        headless: without a window on a display, such as that of `display`.
        webgl: pages draw with it, as Rerun's does.
    """
    options = webdriver.ChromeOptions()
    options.binary_location = require_program("chromium")
    width, height = size
    flags = f"{_FLAGS} {_WEBGL if webgl else _NO_WEBGL}".split()
    for flag in (*flags, f"--user-data-dir={profile}", f"--window-size={width},{height}"):
        options.add_argument(flag)
    if headless:
        options.add_argument("--headless=new")
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    driver = webdriver.Chrome(
        options=options, service=Service(require_program("chromedriver", "chromium-driver"))
    )
    try:
        # A script waits for the page's frame, and a picture for some of them.
        driver.set_script_timeout(DRAWING_PATIENCE)
        driver.command_executor.client_config.timeout = DRAWING_PATIENCE
        yield driver
    finally:
        driver.quit()


@contextmanager
def display() -> Iterator[None]:
    """Have a screen without hardware, with a window manager, for what is started in the block.

    Skips where their programs are missing, but fails in CI.
    """
    server, manager = require_program("Xvfb", "xvfb"), require_program("openbox")
    reading, writing = os.pipe()
    screen = [server, "-displayfd", str(writing), *_SCREEN.split()]
    with subprocess.Popen(screen, pass_fds=[writing], stderr=subprocess.DEVNULL) as running:
        os.close(writing)
        with open(reading) as number, pytest.MonkeyPatch.context() as patch:
            patch.setenv("DISPLAY", f":{number.readline().strip()}")
            with subprocess.Popen([manager, "--sm-disable"], stderr=subprocess.DEVNULL) as managing:
                try:
                    yield
                finally:
                    managing.terminate()
                    running.terminate()


def screenshot(driver: webdriver.Chrome) -> bytes:
    """The page as PNG."""
    # WebDriver's own command gives up when the page's frames take 10 s together.
    return base64.b64decode(driver.execute_cdp_cmd("Page.captureScreenshot", {})["data"])


def wait_for_color(driver: webdriver.Chrome, rgb: tuple[int, int, int], most: int) -> None:
    """Wait until more than ``most`` pixels of the page have a color."""
    wait_for(
        lambda: colored(pixels(screenshot(driver)), rgb).sum() > most,
        f"the color {rgb} in the picture",
        timeout=DRAWING_PATIENCE,
    )


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
