"""The robot's view on the steering page's own address: passed on, and guarded."""

import asyncio
import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest
from selenium.webdriver import Chrome
from std_msgs.msg import String

from onebot_bringup.steering.view_proxy import View
from tests.onebot_bringup.steering_support import PageClient, address_of, steering
from tests.onebot_bringup.viewer_support import ARM, BLUE, VIEW
from tests.ros_support import LATCHED, NodeProcess, Peer, ros_args
from tests.support import wait_for
from tests.support_browser import browser, hosts_reached, screenshot
from tests.support_rendering import colored, pixels

PAGE = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy&theme=dark&persist=0"
SERVICE = "/rerun.sdk_comms.v1alpha1.MessageProxyService"


def test_the_viewers_address_is_understood():
    """Both of its ports, and what else it tells the page."""
    view = View.parse(PAGE, 3)
    assert view == View(9090, 9876, ("theme=dark", "persist=0"), 3)


@pytest.mark.parametrize(
    "host, shown",
    [
        ("localhost:9000", "localhost:9000"),
        ("[::1]:8080", "[::1]:8080"),
        ("robot.local", "robot.local:80"),
    ],
)
def test_the_view_leads_back_to_where_the_browser_is(host, shown):
    """Whatever this server is called there: a tunnel's port, another name, the default port."""
    view = View.parse(PAGE)
    assert view is not None
    assert view.path(host).startswith(f"/view/?url=rerun%2Bhttp://{shown}/proxy&theme=dark")


@pytest.mark.parametrize(
    "address",
    [
        "",
        "http://127.0.0.1:9090",
        "http://192.0.2.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy",
        "http://127.0.0.1:9090/?url=rerun%2Bhttp://192.0.2.1:9876/proxy",
        "http://127.0.0.1:9090@evil.example/?url=rerun%2Bhttp://127.0.0.1:9876/proxy",
        "http://127.0.0.1:99999/?url=rerun%2Bhttp://127.0.0.1:9876/proxy",
        "http://127.0.0.1:0/?url=rerun%2Bhttp://127.0.0.1:9876/proxy",
        "file:///etc/passwd",
    ],
)
def test_only_servers_on_this_computer_are_asked(address):
    """Any other address is none."""
    assert View.parse(address) is None


@contextmanager
def _viewer(domain: int, *args: str) -> Iterator[NodeProcess]:
    """The real viewer, with a robot."""
    ports = ros_args(grpc_port=0, web_port=0, open_browser="false")
    with (
        NodeProcess("onebot_bringup.viewer.rerun_viewer", *ports, *args, check=False) as node,
        Peer(domain, "robot") as peer,
    ):
        peer.publisher(String, "/robot_description", LATCHED).publish(String(data=ARM))
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        yield node


def _shown(page: PageClient) -> str:
    return str(wait_for(lambda: page.state["view"], "the view's address"))


class _Traffic:
    """What the browser got of the recording; reading its log empties that, so it is kept here."""

    def __init__(self, page: Chrome, base: str) -> None:
        self._page, self._source = page, f"{base}{SERVICE}/ReadMessages"
        self._requests: set[str] = set()
        self._bytes = 0

    def received(self) -> int:
        """Bytes so far."""
        for entry in self._page.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            parameters = message["params"]
            if message["method"] == "Network.responseReceived":
                if parameters["response"]["url"] == self._source:
                    assert parameters["response"]["status"] == 200
                    self._requests.add(parameters["requestId"])
            elif message["method"] == "Network.dataReceived":
                if parameters["requestId"] in self._requests:
                    self._bytes += parameters["dataLength"]
        return self._bytes


@pytest.mark.slow
def test_the_view_is_drawn_with_a_token_and_from_this_server_alone(ros_domain, tmp_path):
    """The robot is seen in its colour, all of it coming through the one guarded port."""
    (tmp_path / "view.yaml").write_text(VIEW)
    with (
        _viewer(ros_domain, "-p", f"view:={tmp_path / 'view.yaml'}"),
        steering(token="a secret of ours") as node,
        browser(tmp_path / "profile") as page,
    ):
        address = address_of(node)
        port = urlsplit(address).port
        page.get(address)
        page.get(f"http://127.0.0.1:{port}/view/")
        wait_for(lambda: page.execute_script("return !!window._handle"), "Rerun's page", 240.0)
        wait_for(
            lambda: colored(pixels(screenshot(page)), BLUE).sum() > 2000,
            "the base in the picture",
            timeout=240.0,
        )
        log = page.get_log("browser")
        assert hosts_reached(page) == {"127.0.0.1"}
        assert not [line for line in log if "WebAssembly" in line["message"]], log


@pytest.mark.slow
def test_the_view_comes_through_one_forwarded_port(ros_domain, tmp_path):
    """As by ssh -L: the browser knows another port, and gets page and data there."""
    with _viewer(ros_domain), steering() as node, browser(tmp_path / "profile") as page:
        port = urlsplit(address_of(node)).port
        assert port is not None
        with PageClient(address_of(node)) as client, _Relay(port) as relay:
            _shown(client)
            base = f"http://localhost:{relay.port}"
            page.get(f"{base}/view/")
            wait_for(lambda: page.execute_script("return !!window._handle"), "the page", 240.0)
            traffic = _Traffic(page, base)
            wait_for(lambda: traffic.received() > 1000, "the recording", 240.0)


class _Relay:
    """Passes on what comes to a port of its own, as an SSH tunnel does."""

    def __init__(self, target: int) -> None:
        self._target = target
        self._loop = asyncio.new_event_loop()
        server = self._loop.run_until_complete(asyncio.start_server(self._serve, "127.0.0.1", 0))
        self.port = server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
        await asyncio.gather(_pump(reader, far_writer), _pump(far_reader, writer))

    def __enter__(self) -> "_Relay":
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10.0)


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()
    except ConnectionError:
        pass
    writer.close()


def _status(base: str, path: str, data: bytes | None = None, **headers: str) -> int:
    try:
        with urlopen(Request(base + path, data, headers), timeout=60.0) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code


def test_the_view_is_guarded_and_for_looking_only(ros_domain):
    """Without token, or from a foreign page, there is neither page nor data; nobody writes."""
    with _viewer(ros_domain) as viewer, steering(token="a secret of ours") as node:
        base = address_of(node).partition("/?")[0]
        with urlopen(address_of(node), timeout=60.0) as answer:
            cookie = answer.headers["Set-Cookie"].partition(";")[0]
        with PageClient(base, Cookie=cookie) as client:
            view = _shown(client)
        read, write = f"{SERVICE}/ReadMessages", f"{SERVICE}/WriteMessages"
        kind = {"Content-Type": "application/grpc-web+proto"}
        for path, data in ((view, None), ("/view/re_viewer.js", None), (read, b"\0" * 5)):
            assert _status(base, path, data, **kind) == 403
            foreign = {"Cookie": cookie, "Origin": "http://evil.example", **kind}
            assert _status(base, path, data, **foreign) == 403
            assert _status(base, path, data, Cookie=cookie, **kind) == 200
        assert _status(base, write, b"\0" * 5, Cookie=cookie, **kind) == 403
        request = Request(base + view, headers={"Cookie": cookie})
        with urlopen(request, timeout=60.0) as answer:
            policy = answer.headers["Content-Security-Policy"]
            assert b"<html" in answer.read()
        assert "connect-src 'self' data: blob:" in policy and "frame-ancestors 'self'" in policy
        viewer.process.send_signal(signal.SIGKILL)
        viewer.wait()
        wait_for(
            lambda: _status(base, view, Cookie=cookie) in (502, 503),
            "the proxy to see that it died",
        )
