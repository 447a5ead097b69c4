"""The steering page in a real window: what is held ends where the page cannot see its release."""

import ctypes
import functools
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist

from tests.onebot_bringup.steering_support import Steering, steering
from tests.ros_support import Peer
from tests.steering_browser_support import Page
from tests.support import require_program, wait_for
from tests.support_browser import browser, display

pytestmark = pytest.mark.slow

TOPIC = "/velocity_controller/cmd_vel"
MOST = 200  # commands after the release, at 20 Hz: more than the page grants a hand that is still
Words = tuple[object, ...]  # commands of xdotool


def do(*words: object) -> None:
    """Have a real mouse and keyboard do this, and the browser some time for it."""
    command = [require_program("xdotool"), *map(str, words), "sleep", "0.2"]
    subprocess.run(command, check=True)


@contextmanager
def grabbed_keyboard() -> Iterator[None]:
    """Another program takes all keys, as a screen locker or a launcher does."""
    library = ctypes.CDLL("libX11.so.6")
    library.XOpenDisplay.restype = ctypes.c_void_p
    library.XDefaultRootWindow.restype = ctypes.c_ulong
    opened = ctypes.c_void_p(library.XOpenDisplay(None))
    root = ctypes.c_ulong(library.XDefaultRootWindow(opened))
    assert library.XGrabKeyboard(opened, root, 0, 1, 1, ctypes.c_ulong(0)) == 0
    library.XSync(opened, 0)
    yield
    library.XCloseDisplay(opened)


class Window:
    """The page in a window on a screen, and where things are on it."""

    def __init__(self, page: Page) -> None:
        script = "return [screenX, screenY, outerWidth, outerHeight, innerWidth, innerHeight]"
        sizes = page.driver.execute_script(script)
        self.page = page
        self.x, self.y, self.width, self.height, self._inner_width, self._inner_height = sizes

    def place(self, selector: str) -> Words:
        """The middle of an element on the screen."""
        box = self.page.find(selector).rect
        left = self.x + (self.width - self._inner_width) / 2
        top = self.y + self.height - self._inner_height
        across, down = left + box["x"] + box["width"] / 2, top + box["y"] + box["height"] / 2
        return "mousemove", round(across), round(down)

    @property
    def app_menu(self) -> Words:
        """Opens the browser's own menu, behind the dots beside the address."""
        return "mousemove", self.x + self.width - 22, self.y + 63, "click", 1


@contextmanager
def opened(node: Steering, profile: Path) -> Iterator[Window]:
    """The node's page in a window, without anything that has the focus."""
    with display(), browser(profile, (1200, 850), headless=False) as driver:
        window = Window(Page(driver).open(node.address))
        do(*window.place("#view"), "click", 1)
        yield window


def test_a_release_that_the_page_never_sees_stops(peer: Peer, tmp_path: Path) -> None:
    """In a menu, on the title bar, while another program has the keys; so does a still hand.

    Which other keys are no sign of a hand, test_steering_hands tests.
    """
    with steering(max_linear=0.5) as node, opened(node, tmp_path) as window:
        page, place = window.page, window.place
        heard = peer.hear(Twist, TOPIC, 1000)

        def mouse(selector: str) -> tuple[Words, Words]:
            drag = "mousedown", 1, "mousemove_relative", "--", 0, -30
            return (*place(selector), *drag), ("mouseup", 1)

        key = ("keydown", "w"), ("keyup", "w")
        escape = "key", "Escape", "key", "Escape"
        menu = ("key", "alt+f", *place("#view")), escape
        dots = window.app_menu, escape
        title = (
            ("mousemove", window.x + window.width // 2, window.y + 15, "mousedown", 1),
            ("mouseup", 1),
        )
        nothing: tuple[Words, Words] = (), ()

        for hold, elsewhere, grab in (
            (key, nothing, grabbed_keyboard),
            (key, dots, nullcontext),
            (key, title, nullcontext),
            (mouse("#pad"), menu, nullcontext),
        ):
            do(*place("#view"), "click", 1)
            press, release = (functools.partial(do, *words) for words in hold)
            begin = len(heard)
            page.drive_until(
                press,
                release,
                lambda begin=begin: any(m.linear.x for m in heard[begin:]),
                f"{hold} to drive",
            )
            with grab():
                do(*elsewhere[0])
                release()
                _stops(page, heard, f"{hold} let go after {elsewhere}")
                do(*elsewhere[1])
        press, release = (functools.partial(do, *words) for words in mouse("#linear [name=plus]"))

        def is_still() -> bool:
            """Hold the button; whether that ends by the page, not where a busy one is late."""
            page.drive_until(press, release, lambda: heard[-1] != Twist(), "the button to drive")
            _stops(page, heard, "a hand that is still")
            reason = page.text("#message")
            release()
            return "no sign that the control is still held" in reason

        wait_for(is_still, "the reason")


def _stops(page: Page, heard: list[Twist], what: str) -> None:
    """Wait for the stop, without any input of the page."""

    def sent() -> int:
        return page.said().count("drive")

    most = sent() + MOST
    wait_for(lambda: page.body("driver") == "nobody" or sent() > most, "the stop")
    assert sent() <= most, f"it drives on: {what}"
    wait_for(lambda: heard[-1] == Twist(), "the command to stop")
    assert page.body("hand") == ""
