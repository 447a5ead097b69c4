"""The robot's view on the steering page's own address: passed on, and guarded."""

import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest
from geometry_msgs.msg import Twist
from selenium.webdriver.common.by import By
from std_msgs.msg import String

from onebot_bringup.steering.view_proxy import View
from tests.onebot_bringup.steering_support import (
    PageClient,
    Way,
    cookie_of,
    requested,
    steering,
)
from tests.onebot_bringup.viewer_support import ARM, BLUE
from tests.ros_support import LATCHED, NodeProcess, Peer, ros_args
from tests.steering_browser_support import Page, viewer_page
from tests.support import PATIENCE, wait_for
from tests.support_browser import (
    DRAWING_PATIENCE,
    SMALL,
    browser,
    hosts_reached,
    wait_for_color,
)

PAGE = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy&theme=dark&persist=0"
SERVICE = "rerun.sdk_comms.v1alpha1.MessageProxyService"


def test_the_viewers_address_is_understood():
    """Its port and parameters; each has its own key; only servers on this computer are asked."""
    view, next_view = View.parse(PAGE), View.parse(PAGE)
    assert view is not None and next_view is not None
    assert view == View(9090, ("theme=dark", "persist=0"), view.key)
    assert len(view.key) >= 22 and view.key != next_view.key
    for host in ("192.0.2.1:9090", "127.0.0.1:9090@evil.example", "127.0.0.1:99999"):
        assert View.parse(PAGE.replace("127.0.0.1:9090", host)) is None


@pytest.mark.parametrize(
    "host, sites",
    [
        ("127.0.0.1:9000", ["localhost:9000", "127.0.0.1:9000"]),
        ("localhost:9000", ["127.0.0.1:9000", "localhost:9000"]),
        ("[::1]:8080", ["[::1]:8080"]),
        ("robot.local", ["robot.local:80"]),
    ],
)
def test_the_view_is_another_site_where_loopback_has_two_names(host, sites):
    """At any port of a tunnel; else it is where the page is."""
    view = View.parse(PAGE)
    assert view is not None
    assert view.addresses(host) == [
        f"http://{site.removesuffix(':80')}/view/{view.key}/?url=rerun%2Bhttp://{site}/proxy&theme=dark&persist=0&page=http://{host}"
        for site in sites
    ]


@contextmanager
def _viewer(domain: int) -> Iterator[NodeProcess]:
    """The real viewer, with a robot."""
    ports = ros_args(grpc_port=0, web_port=0, open_browser="false")
    with (
        NodeProcess("onebot_bringup.viewer.rerun_viewer", *ports, check=False) as node,
        Peer(domain, "robot") as peer,
    ):
        peer.publisher(String, "/robot_description", LATCHED).publish(String(data=ARM))
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        yield node


_WATCH = """
window.told = [];
window.addEventListener("message", ({ data }) => window.told.push(data));
"""
# A message leaves the frame with its next task.
_BLOCK = """
window.parent.postMessage("busy", "*");
setTimeout(() => {
  for (const end = performance.now() + 300e3; performance.now() < end; );
  window.parent.postMessage("free", "*");
}, 100);
"""


@contextmanager
def _beside_a_view(domain: int, folder: Path, **parameters: object) -> Iterator[tuple[Any, ...]]:
    """A node with a view that lags, which takes no time to load, and its robot."""
    with (
        viewer_page(folder, "window.drawnInSoftware = true") as address,
        Peer(domain, "robot") as robot,
        steering(**parameters) as node,
    ):
        robot.publisher(String, "/rerun_viewer/page", LATCHED).publish(String(data=address))
        yield node, robot


@pytest.mark.slow
def test_a_view_that_is_busy_does_not_stall_the_wheel(ros_domain, tmp_path, tab):
    """On loopback, here through a tunnel, and by an address of the network.

    The view's thread does nothing else for five minutes; keys, joystick and Stop act meanwhile.
    """
    with (
        _beside_a_view(ros_domain, tmp_path, host="0.0.0.0") as (node, robot),
        Way(node.address) as tunnel,
    ):
        commands = robot.hear(Twist, "/velocity_controller/cmd_vel", 1000)
        own = urlsplit(node.address)
        for host in (own.netloc, f"127.0.0.1:{tunnel.port}"):
            tab.open(f"http://{host}/?{own.query}")
            wait_for(lambda: tab.view_is_shown, f"the view at {host}")
            _drive_beside_a_busy_view(tab, commands)
        tab.driver.get("about:blank")


def _drive_beside_a_busy_view(page: Page, commands: list[Twist]) -> None:
    def moves() -> bool:
        return bool(commands) and commands[-1] != Twist()

    def rests() -> bool:
        return commands[-1] == Twist()

    page.driver.execute_script(_WATCH)
    with page.view() as inside:
        inside.execute_script(_BLOCK)
    wait_for(lambda: "busy" in page.driver.execute_script("return told"), "the view to be busy")
    page.drive_by_pad(0.0, 1.0, moves)
    page.key("keyDown", "Space")
    wait_for(rests, "the space bar to stop it")
    page.key("keyUp", "Space")
    page.let_go()
    page.drive_until(
        lambda: page.key("keyDown", "KeyW"),
        lambda: page.key("keyUp", "KeyW"),
        moves,
        "the key to drive",
    )
    page.hold("#stop", 0.0, 0.0)
    page.let_go()
    wait_for(rests, "Stop to stop it")
    page.key("keyUp", "KeyW")
    page.wait_for_states(3)
    assert page.connected
    assert "free" not in page.driver.execute_script("return told")


@pytest.mark.slow
def test_keys_in_the_view_and_a_lost_connection(ros_domain, tmp_path, tab):
    """The stop key works there, too; the others drive only when the mouse is back.

    The view is kept when the page connects anew: until it notices, the server says nothing.
    """
    with _beside_a_view(ros_domain, tmp_path) as (node, _):
        tab.open(node.address)
        wait_for(lambda: tab.view_is_shown, "the view")
        _press_keys_in_the_view(tab)
        with tab.view() as inside:
            inside.execute_script("window.mark = true")
        node.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: not tab.connected, "the page to notice")
        node.process.send_signal(signal.SIGCONT)
        wait_for(lambda: tab.connected, "a new connection")
        tab.wait_for_states(3)
        with tab.view() as inside:
            assert inside.execute_script("return window.mark")


@pytest.mark.slow
def test_only_what_ends_the_data_loads_the_view_again(ros_domain, tmp_path):
    """Rerun's, which is covered until there is a layout; and not kept over a lost tunnel.

    The robot is seen in its color, and no other host is asked.
    """
    viewer = ros_args(grpc_port=0, web_port=0, open_browser="false")
    with (
        NodeProcess("onebot_bringup.viewer.rerun_viewer", *viewer),
        Peer(ros_domain, "robot") as robot,
        steering() as node,
        browser(tmp_path / "profile", SMALL, webgl=True) as driver,
        Way(node.address) as tunnel,
    ):
        page = Page(driver).open(f"{tunnel.address}/")

        def in_view(script: str) -> Any:
            """What the script returns in the frame; None if there is no frame."""
            if not driver.find_elements(By.CSS_SELECTOR, "#view iframe"):
                return None
            with page.view() as inside:
                return inside.execute_script(script)

        wait_for(lambda: in_view("return !!window._handle"), "Rerun's page", DRAWING_PATIENCE)
        assert page.find("#waiting").is_displayed(), "Rerun shows bare panels without a robot"
        robot.publisher(String, "/robot_description", LATCHED).publish(String(data=ARM))
        wait_for(lambda: page.view_is_shown, "the view", DRAWING_PATIENCE)
        assert not page.find("#waiting").is_displayed()
        wait_for_color(driver, BLUE, 500)
        assert hosts_reached(driver) <= {"127.0.0.1", "localhost"}
        resources = in_view(
            "window.mark = true;"
            "return performance.getEntriesByType('resource').map((entry) => entry.name)"
        )
        assert {urlsplit(name).netloc for name in resources} == {f"localhost:{tunnel.port}"}
        logged = [entry["message"] for entry in driver.get_log("browser")]
        assert [message for message in logged if "status of 404" in message] == []
        tunnel.cut()
        wait_for(lambda: page.find("#waiting").is_displayed(), "the view to be loaded again")
        wait_for(lambda: in_view("return !window.mark"), "another frame")


def _press_keys_in_the_view(page: Page) -> None:
    page.find("#view iframe").click()
    wait_for(lambda: "keys-away" in page.find("body").get_attribute("class"), "the keys to be away")
    page.key("keyDown", "KeyW")
    page.key("keyUp", "KeyW")
    page.key("keyDown", "Space")
    wait_for(lambda: {"type": "stop"} in page.sent(), "the stop of a key in the view")
    assert page.stop_is_held
    page.key("keyUp", "Space")
    wait_for(lambda: not page.stop_is_held, "its release")
    assert not [message for message in page.sent() if message["type"] == "drive"]
    page.act().move_to_element(page.find("aside")).perform()
    page.key("keyDown", "KeyW")
    wait_for(lambda: page.sent()[-1]["type"] == "drive", "the key to drive")
    page.key("keyUp", "KeyW")


def _status(url: str, data: bytes | None = None, **headers: str) -> int:
    with requested(Request(url, data, headers)) as answer:
        return int(answer.status)


def test_the_view_is_guarded_and_for_looking_only(ros_domain):
    """Without its key, or from a foreign page, there is neither page nor data; nobody writes.

    A token of one's own is kept and asked for, with characters that an address writes otherwise.
    """
    with _viewer(ros_domain) as viewer, steering(token="a b&c/+") as node:
        page, _, own = node.address.partition("/?")
        assert own == "token=a%20b%26c%2F%2B" and _status(page) == 403
        cookie = cookie_of(node.address).partition(";")[0]
        with PageClient(page, Cookie=cookie) as client:
            view = wait_for(lambda: client.state["view"], "the view's address")[-1]
        root = view.partition("?")[0]
        read, write = f"{root}{SERVICE}/ReadMessages", f"{root}{SERVICE}/WriteMessages"
        kind = {"Content-Type": "application/grpc-web+proto"}
        other = f"http://localhost:{urlsplit(view).port}"
        for url, data in ((f"{root}re_viewer.js", None), (read, b"\0" * 5)):
            for origin in ("null", other, page):
                assert _status(url, data, Origin=origin, **kind) == 200
            for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
                assert _status(url, data, **headers, **kind) == 403
            wrong = re.sub("/view/.*?/", "/view/wrong/", url)
            assert _status(wrong, data, Origin="null", **kind) == 403
            assert _status(f"{wrong}?{own}", data, **kind) == 404
        assert _status(write, b"\0" * 5, **kind) == 403
        with urlopen(Request(view, headers={"Origin": "null"}), timeout=PATIENCE) as answer:
            policy = answer.headers.get_all("Content-Security-Policy")
            assert answer.headers["Access-Control-Allow-Origin"] == "null"
            assert answer.headers["Set-Cookie"] is None
            assert b"<head><script>" in answer.read()
        assert policy[1:] == [f"frame-ancestors 'self' {other}"]
        assert "connect-src 'self' data: blob:" in policy[0] and "sandbox allow-s" in policy[0]
        assert "allow-same-origin" not in policy[0] and "allow-top" not in policy[0]
        viewer.process.send_signal(signal.SIGKILL)
        viewer.wait()
        wait_for(lambda: _status(view) in (403, 404, 502), "the proxy to see that it died")
