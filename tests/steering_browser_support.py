"""The steering page in a real browser, before a real node: what tests do on it and read off it."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, TypeVar

from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from tests.support import wait_for

T = TypeVar("T")
Check = Callable[[], object]


# What a browser gives of a gamepad, whose hardware no test has.
GAMEPAD = """
window.pad = { axes: [0, 0, 0, 0], mapping: "standard", there: true, stop: false };
navigator.getGamepads = () => pad.there ? [{
  index: 0, connected: true, mapping: pad.mapping, timestamp: performance.now(), axes: pad.axes,
  buttons: [{ pressed: false }, { pressed: pad.stop }],
}] : [null];
"""


class Page:
    """The page in a tab of ``driver``."""

    def __init__(self, driver: Chrome) -> None:
        self.driver = driver
        self._frames: list[tuple[str, dict[str, Any]]] = []
        self._mouse = (0.0, 0.0)
        self._fingers: set[str] = set()

    def open(self, address: str) -> "Page":
        """Go there, and wait until the page is connected and knows the robot's state."""
        self.driver.get(address)
        self.frames()
        self._frames.clear()
        wait_for(lambda: self.connected, "the page to connect")
        self.wait_for_states(1)
        return self

    @property
    def connected(self) -> bool:
        """It says that it is."""
        return self.body("connection") == "up"

    def body(self, name: str) -> str:
        """A ``data-`` attribute of the body: connection, driver or hand."""
        return str(self.driver.execute_script(f"return document.body.dataset.{name}"))

    def text(self, selector: str) -> str:
        """What an element says, whether it is in sight or not."""
        return str(self.find(selector).get_property("textContent")).strip()

    def number(self, shown: str) -> float:
        """A number of the read-out; NaN where it shows none."""
        words = self.text(f'[data-show="{shown}"]').replace("\N{MINUS SIGN}", "-")
        return float("nan") if words == "\N{EN DASH}" else float(words)

    def limit(self, axis: str) -> str:
        """What the field of a limit shows."""
        return str(self.find(f"#{axis}-limit").get_property("value"))

    @property
    def stop_is_held(self) -> bool:
        """Stop is pressed, by whatever it is."""
        return "held" in str(self.find("#stop").get_property("className"))

    def in_sight(self, selector: str) -> bool:
        """Whether an element says something, and the middle of it is not covered or cut off."""
        return bool(
            self.driver.execute_script(
                "const element = document.querySelector(arguments[0]);"
                "const { left, right, top, bottom } = element.getBoundingClientRect();"
                "const seen = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);"
                "return bottom > top && element.contains(seen)",
                selector,
            )
        )

    def module(self, name: str, function: str, calls: list[list[Any]]) -> list[Any]:
        """What a function of the page's module returns, or the name of what it throws."""
        script = """const [name, run, calls, done] = arguments;
        import(new URL(`static/${name}`, document.baseURI)).then((found) => done(
          calls.map((call) => { try { return found[run](...call) } catch (e) { return e.name } })
        ), (error) => done([String(error)]))"""
        return list(self.driver.execute_async_script(script, name, function, calls))

    def find(self, selector: str) -> WebElement:
        """The element."""
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def act(self) -> ActionChains:
        """Real key events, as the browser's own input would be."""
        return ActionChains(self.driver, duration=50)

    def hold(self, selector: str, right: float, down: float) -> None:
        """Press the mouse on an element's middle and drag by pixels; it stays held."""
        box = self.find(selector).rect
        self._mouse = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self._move_mouse("mouseMoved", buttons=0)
        self._move_mouse("mousePressed")
        self.drag(right, down)

    def hold_pad(self, right: float, up: float) -> None:
        """Press the pad's middle and drag, by shares of the thumb's way; it stays held."""
        radius = self.find("#pad .back").size["width"] / 2
        self.hold("#pad", right * radius, -up * radius)

    def drive_until(
        self,
        press: Callable[[], None],
        release: Callable[[], None],
        reached: Callable[[], T],
        what: str,
    ) -> T:
        """Press a control and wait for what it does; it stays pressed.

        Where the page gets no processor time for a second, or the control does not move the robot
        for as long as a still hand counts, it has to be pressed anew, which is done here.
        """
        press()
        pressed = time.monotonic()

        def driven() -> T | None:
            nonlocal pressed
            found = reached()
            if found and self.body("driver") == "you":
                return found
            if self.body("hand") == "" and time.monotonic() > pressed + 1.0:
                release()
                press()
                pressed = time.monotonic()
            return None

        found = wait_for(driven, what)
        assert found is not None
        return found

    def drive_by_pad(self, right: float, up: float, reached: Callable[[], T]) -> T:
        """Drive with the joystick, held as `hold_pad` holds it, until ``reached``."""
        return self.drive_until(
            lambda: self.hold_pad(right, up), self.let_go, reached, "the joystick to drive"
        )

    def drive_by_mouse(self, selector: str, right: float, down: float, reached: Check) -> None:
        """Drive with a control that the mouse holds, as `hold` does, until ``reached``."""
        self.drive_until(
            lambda: self.hold(selector, right, down), self.let_go, reached, f"{selector} to drive"
        )

    def drive_by_finger(self, finger: int, reached: Check) -> None:
        """Drive with the joystick at its upper end, and no other finger, until ``reached``."""

        def press() -> None:
            self.touch({finger: ("#pad", 0)})
            self.touch({finger: ("#pad", 300)})

        self.drive_until(press, self.end_touch, reached, "the finger to drive")

    def drive_by_keys(self, keys: Sequence[str], reached: Callable[[], T]) -> T:
        """Drive with keys of the keyboard, until ``reached``."""

        def press() -> None:
            for key in keys:
                self.act().key_down(key).perform()

        return self.drive_until(press, lambda: self.release_keys(keys), reached, f"{keys} to drive")

    def release_keys(self, keys: Sequence[str]) -> None:
        """Lift keys, the last one first."""
        for key in reversed(keys):
            self.act().key_up(key).perform()

    def drag(self, right: float, down: float) -> None:
        """Move the held mouse by pixels."""
        self._mouse = (self._mouse[0] + right, self._mouse[1] + down)
        self._move_mouse("mouseMoved")

    def let_go(self) -> None:
        """Release the mouse's button."""
        self._move_mouse("mouseReleased", buttons=0)

    def _move_mouse(self, kind: str, buttons: int = 1) -> None:
        # ActionChains' next perform() takes away the capture of a pointer that the last one holds.
        x, y = self._mouse
        button = "left" if buttons or kind == "mouseReleased" else "none"
        self.devtools(
            "Input.dispatchMouseEvent",
            type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=1,
        )  # fmt: skip

    def key(self, kind: str, code: str) -> None:
        """Press ("keyDown") or lift ("keyUp") a key, by its code; returns before it has acted."""
        key = " " if code == "Space" else code.removeprefix("Key").lower()
        self.devtools("Input.dispatchKeyEvent", type=kind, code=code, key=key)

    def stick(self, *axes: float, **changes: object) -> None:
        """Move the sticks of ``GAMEPAD``, the others to their middle; change what else it has."""
        change = {"axes": [*axes, *[0] * (4 - len(axes))], **changes}
        self.driver.execute_script("Object.assign(window.pad, arguments[0])", change)
        self.wait_for_states(3)  # it is read every 50 ms

    def drive_by_stick(self, axes: Sequence[float], reached: Check) -> None:
        """Drive with a gamepad's sticks, until ``reached``."""
        self.drive_until(lambda: self.stick(*axes), self.stick, reached, f"{axes} to drive")

    def touch(self, fingers: dict[int, tuple[str, float]]) -> None:
        """Have these fingers on the screen and no others.

        Args:
            fingers: by number, an element and how many pixels above its middle; at least one.
        """
        points = []
        for finger, (selector, up) in fingers.items():
            box = self.find(selector).rect
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 - up
            points.append({"id": finger, "x": x, "y": y})
        kind = "touchStart" if fingers.keys() - self._fingers else "touchMove"
        self._fingers = set(fingers)
        self.devtools("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def end_touch(self, kind: str = "touchEnd") -> None:
        """Lift all fingers; as touchCancel, the system takes them away."""
        self._fingers = set()
        self.devtools("Input.dispatchTouchEvent", type=kind, touchPoints=[])

    def enter(self, selector: str, words: str) -> None:
        """Replace what a field holds, by nothing too, and press Enter."""
        field = self.find(selector)
        self.driver.execute_script("arguments[0].focus(); arguments[0].select()", field)
        field.send_keys(words or Keys.DELETE, "\n")

    @contextmanager
    def view(self) -> Iterator[Chrome]:
        """The driver in the frame of the robot's view."""
        self.driver.switch_to.frame(self.find("#view iframe"))
        try:
            yield self.driver
        finally:
            self.driver.switch_to.default_content()

    @property
    def view_is_shown(self) -> bool:
        """No placeholder covers it."""
        return self.find("#view").get_attribute("class") == ""

    def devtools(self, command: str, **parameters: Any) -> Any:
        """A command of Chromium's DevTools."""
        return self.driver.execute_cdp_cmd(command, parameters)

    def emulate(self, width: int, height: int, mobile: bool = False, **media: str) -> None:
        """Show the page on a screen of this size, with media features such as ``forced_colors``."""
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=mobile,
        )  # fmt: skip
        features = [{"name": name.replace("_", "-"), "value": media[name]} for name in media]
        self.devtools("Emulation.setEmulatedMedia", features=features)

    def emulate_nothing(self) -> None:
        """Back to the window's own size and the system's own preferences."""
        self.devtools("Emulation.clearDeviceMetricsOverride")
        self.devtools("Emulation.setEmulatedMedia", features=[])

    # --- what went over the WebSocket -----------------------------------------------------------

    def frames(self) -> list[tuple[str, dict[str, Any]]]:
        """All messages since the page was opened: ("sent" or "received", message)."""
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            kind = {
                "Network.webSocketFrameSent": "sent",
                "Network.webSocketFrameReceived": "received",
            }.get(message["method"])
            payload = message["params"].get("response", {}).get("payloadData", "")
            if kind and payload.startswith("{"):
                self._frames.append((kind, json.loads(payload)))
        return self._frames

    def sent(self) -> list[dict[str, Any]]:
        """What the page said since it was opened."""
        return [message for kind, message in self.frames() if kind == "sent"]

    def said(self) -> list[str]:
        """The types of the messages that it sent."""
        return [message["type"] for message in self.sent()]

    def wait_for_states(self, count: int) -> None:
        """Wait until the server has told its state ``count`` times more."""

        def told() -> int:
            return sum(message["type"] == "state" for _, message in self.frames())

        enough = told() + count
        wait_for(lambda: told() >= enough, f"{count} more states")


class _QuietHandler(SimpleHTTPRequestHandler):
    """Serves files."""

    def log_message(self, *_: object) -> None:
        """Log nothing."""


@contextmanager
def viewer_page(folder: Path, script: str = "") -> Iterator[str]:
    """A viewer's page that has something to show at once, where Rerun would draw for long.

    Args:
        folder: where to write it.
        script: runs in the page.

    Yields:
        Its address, as the viewer publishes it.
    """
    (folder / "index.html").write_text(
        f"<html><head><script>{script}</script></head>"
        '<body><p id="center_text" class="visible">View</p></body></html>'
    )
    handler = partial(_QuietHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        host = f"127.0.0.1:{server.server_port}"
        yield f"http://{host}/?url=rerun%2Bhttp://{host}/proxy"
        server.shutdown()
