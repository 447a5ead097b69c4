"""The processes and servers around the recording."""

import contextlib
import ipaddress
import os
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from types import SimpleNamespace

import psutil
import pytest
import rerun as rr

from onebot_bringup.serving.ports import answers
from onebot_bringup.serving.rerun_messages import SERVICE
from onebot_bringup.viewer.display_server import (
    Child,
    DisplayServer,
    Recording,
    WebPage,
    open_recording,
)
from onebot_bringup.viewer.rendering import headless_viewer, render
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.errors import OneBotError
from tests.onebot_bringup.steering_support import requested
from tests.support import PATIENCE, wait_for

STALLED = """
import socket, sys
import numpy as np, psutil, rerun as rr
from onebot_bringup.serving.rerun_messages import SERVICE
from onebot_bringup.viewer.display_server import WebPage, open_recording
from tests.support import wait_for

def read(page):
    viewer = socket.create_connection(("127.0.0.1", page.port), 180)
    viewer.sendall(
        f"POST /{SERVICE}/ReadMessages HTTP/1.1\\r\\nHost: 127.0.0.1\\r\\nContent-Length: 5\\r\\n"
        "Content-Type: application/grpc-web+proto\\r\\n\\r\\n\\0\\0\\0\\0\\0".encode()
    )
    assert viewer.recv(12) == b"HTTP/1.1 200"
    return viewer

def received(viewer, last):
    data = b""
    while last not in data:
        data = data[-100:] + viewer.recv(1 << 20)
        yield len(data)

def log(entity, *contents):
    picture = rr.EncodedImage(contents=b"".join(contents), media_type="image/jpeg")
    recording.stream.log(entity, picture)

recording = open_recording(0, memory_limit="1B")  # less than there is: Rerun warns of that
page = WebPage(0, recording.uri, recording.server)
wait_for(lambda: page.ready, "the page")
slow, memory = read(page), psutil.Process().memory_info
log("map", b"<QUIET-TOPIC>")
before, noise = memory().rss, np.random.default_rng(0)
for number in range(800):
    log("camera", noise.bytes(1_000_000))
    recording.stream.flush(timeout_sec=60.0)  # raises where Rerun waits for a viewer
print((memory().rss - before) / 1e6)
quick = read(page)
log("camera", noise.bytes(1000), b"<NEWEST>")
print(sum(received(quick, b"<NEWEST>")) / 1e6)
whole = sum(received(slow, b"<QUIET-TOPIC>"))
print((whole + sum(received(slow, b"<NEWEST>"))) / 1e6)
page.stop()
recording.close()
"""


@pytest.mark.slow
def test_a_browser_that_does_not_read_costs_little_memory():
    """It keeps neither the recording nor other viewers waiting, and then gets the newest of each.

    Rerun logs by itself, in colors, that it waits, or has too little memory: not in our log.
    """
    ended = subprocess.run(
        [sys.executable, "-c", STALLED],
        capture_output=True,
        text=True,
        timeout=3 * PATIENCE,
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    grown, quick, slow = map(float, ended.stdout.split())
    # The server may hold 128 MB, the backlog 64 MB, and the allocator some of what they had.
    assert grown < 500.0, "MB, of 800 that were logged"
    assert quick < 50.0 and slow < 200.0, "MB that each viewer got"


def test_a_port_in_use_is_said_and_replaced_and_a_page_that_died_is_reported():
    """Two viewers can run at once; what ends one is logged, and its address is withdrawn."""
    said: list[str] = []
    log = SimpleNamespace(info=said.append, warning=said.append)
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        parameters = ViewerParameters(grpc_port=0, web_port=port, open_browser=False)
        server = DisplayServer(parameters, log)
    [warning] = said
    assert warning.startswith(f"web_port {port} is in use; using ")
    wait_for(lambda: server.watch() or server.page_address, "the page")
    os.kill(server._viewer.process.pid, signal.SIGKILL)
    wait_for(lambda: server.watch() or not server.page_address, "its end")
    assert said[-1] == "the page's server died (exit code -9)"
    server.close()


@pytest.fixture
def served() -> Iterator[tuple[Recording, WebPage]]:
    """A recording, and its page."""
    recording = open_recording(0)
    with page_of(recording.uri, recording.server) as page:
        yield recording, page
        recording.close()
    assert not answers(recording.port)


@contextlib.contextmanager
def page_of(uri: str, server: tuple[str, int]) -> Iterator[WebPage]:
    """The page of a recording, once it is up."""
    page = WebPage(0, uri, server)
    try:
        wait_for(lambda: page.ready, "the page")
        yield page
    finally:
        page.stop()
    assert not answers(page.port)


NO_SERVER = "rerun+http://127.0.0.1:1/proxy", ("127.0.0.1", 1)


def _get(url: str) -> urllib.request.addinfourl:
    return urllib.request.urlopen(url, timeout=PATIENCE)


def test_the_page_is_served_with_an_order_to_stay_on_this_machine(served):
    """The short address leads to the viewer; nobody on the network can look or write."""
    recording, page = served
    listening = [
        connection.laddr
        for process in (psutil.Process(), psutil.Process(page.process.pid))
        for connection in process.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    ]
    assert {recording.port, page.port} <= {address.port for address in listening}
    assert all(ipaddress.ip_address(address.ip).is_loopback for address in listening)
    hidden = [address.ip for address in listening if address.ip != "127.0.0.1"]
    assert hidden == [recording.server[0]]
    with _get(page.url) as response:
        assert f"url=rerun%2Bhttp://127.0.0.1:{page.port}/proxy" in response.url
        assert f"url=rerun%2Bhttp://127.0.0.1:{recording.port}/proxy" in page.address
        policy = response.headers["Content-Security-Policy"]
        html = response.read().decode()
    assert "connect-src 'self' data: blob:;" in policy and "frame-ancestors 'none'" in policy
    assert "http" not in policy and "fonts.googleapis" not in html
    assert "<title>Rerun Viewer</title>" in html
    assert 0 < html.find("requestAnimationFrame") < html.find("re_viewer.js")
    with _get(f"{page.url}/re_viewer_bg.wasm") as response:
        assert response.headers["Content-Type"] == "application/wasm"
        assert len(response.read()) > 1_000_000
    with pytest.raises(urllib.error.HTTPError, match="404"):
        _get(f"{page.url}/nothing")


READ, WRITE = (f"/{SERVICE}/{method}Messages" for method in ("Read", "Write"))
GRPC = {"Content-Type": "application/grpc-web+proto"}


def _status(url: str, data: bytes | None = None, **headers: str) -> int:
    with requested(urllib.request.Request(url, data, headers)) as answer:
        return int(answer.status)


def test_foreign_pages_get_neither_the_page_nor_the_recording(served):
    """Of another site, or of a name that was made to lead here; and nobody writes."""
    recording, page = served
    own, data = page.url, b"\0" * 5
    for url in (own, own.replace("127.0.0.1", "localhost")):
        assert _status(url) == 200 and _status(url, Origin=url) == 200
        assert _status(url + READ, data, Origin=url, **GRPC) == 200
        assert _status(url + WRITE, data, Origin=url, **GRPC) == 403
    for name, value in {
        "Origin": "http://evil.example",
        "Sec-Fetch-Site": "cross-site",
        "Host": "evil.example",
    }.items():
        assert _status(own, **{name: value}) == 403
        assert _status(own + READ, data, **GRPC, **{name: value}) == 403
    known = f"http://127.0.0.1:{recording.port}"
    for path, body in (("/", None), (READ, data), (WRITE, data)):
        assert _status(known + path, body, **GRPC) == 403


PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
SETTINGS = bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))  # an empty frame of HTTP/2


def test_native_viewers_get_through_to_the_recording(caplog):
    """HTTP/2 from the first byte: Rerun's own server answers, while others do nothing.

    The end closes all connections and logs nothing.
    """
    recording = open_recording(0)
    address = ("127.0.0.1", recording.port)
    with contextlib.ExitStack() as opened:

        def connect() -> socket.socket:
            return opened.enter_context(socket.create_connection(address, PATIENCE))

        idle = [connect() for _ in range(20)]
        idle[-1].sendall(PREFACE[:-1])
        viewer = connect()
        viewer.sendall(PREFACE + SETTINGS)
        assert viewer.recv(9)[3] == SETTINGS[3]
        browser = connect()
        browser.sendall(b"PRI /proxy HTTP/1.1\r\nHost: evil.example\r\n\r\n")
        assert b"403 Forbidden" in browser.recv(1000)
        for one in idle:
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
        recording.close()
        with contextlib.suppress(ConnectionResetError):
            while viewer.recv(1000):
                pass
    assert caplog.records == []


def test_the_page_responds_by_the_rules_of_http():
    """HEAD has no body, nothing is written; a Rerun server that died is a 502."""
    with page_of(*NO_SERVER) as page:
        whole = urllib.request.Request(f"{page.url}/re_viewer_bg.wasm", method="HEAD")
        with urllib.request.urlopen(whole, timeout=PATIENCE) as response:
            assert int(response.headers["rerun-final-length"]) > 1_000_000
            assert response.read() == b""
        with pytest.raises(urllib.error.HTTPError, match="405"):
            urllib.request.urlopen(page.url, b"data", timeout=PATIENCE)
        os.kill(page.process.pid, signal.SIGKILL)
        wait_for(lambda: not page.running, "its end")
        with pytest.raises(urllib.error.HTTPError, match="502") as caught:
            _get(page.address)
        assert b"Rerun's server does not answer" in caught.value.read()


@pytest.mark.parametrize(
    ("module", "library"),
    [
        ("onebot_bringup.viewer.display_server", "aiohttp"),  # a window or a file needs no server
        ("onebot_bringup.viewer.robot_view", "trimesh"),  # robots without meshes need none
        ("onebot_bringup.steering.steering_page", "rerun"),
        ("onebot_control.nodes.world_interface", "embreex"),  # most robots have no sensors
        ("onebot_control.nodes.world_interface", "numpy.random"),
        # Its threads keep bringups from forking for xacro.
        ("onebot_control.control_files", "numpy"),
    ],
)
def test_a_large_library_is_imported_only_where_it_is_used(module, library):
    """It takes from 10 ms to a second of each start."""
    code = f"import sys, {module}; sys.exit('{library}' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=PATIENCE).returncode == 0


def test_a_window_needs_a_display(monkeypatch):
    """The error says what to use in its place."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    log = SimpleNamespace(info=print, warning=print)
    with pytest.raises(OneBotError, match="needs a display.*viewer:=web"):
        DisplayServer(ViewerParameters("native"), log)


@pytest.mark.parametrize(
    ("name", "said"), [("x.txt", "must end in .rrd"), ("none/x.rrd", "No such file")]
)
def test_a_file_that_cannot_be_written_is_refused(tmp_path, name, said):
    """The error names the file and what is wrong."""
    with pytest.raises(OneBotError, match=said):
        open_recording(save=tmp_path / name)


def test_without_a_renderer_the_package_to_install_is_named(tmp_path, monkeypatch):
    """Where no Vulkan driver is found, the message says which Debian package to install."""
    recording = open_recording(save=tmp_path / "x.rrd")
    recording.close()
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.setenv(variable, "/nonexistent")
    with pytest.raises(OneBotError, match="mesa-vulkan-drivers"):
        render(tmp_path / "x.rrd", tmp_path / "x.png")


@pytest.mark.slow
def test_a_crash_of_the_viewer_is_reported_by_its_cause(tmp_path):
    """Not by the last line, which names a page for reports; a picture without pixels is one."""
    recording = open_recording(save=tmp_path / "x.rrd")
    recording.stream.log("text", rr.TextLog("shown"))
    recording.close()
    with (
        pytest.raises(OneBotError, match="Wgpu validation error.*panicked at '.+'$") as error,
        headless_viewer(str(tmp_path / "x.rrd"), 0, 0) as client,
    ):
        client.take_screenshot()
    assert "Report bugs" not in str(error.value)


def test_last_words_are_those_of_the_program_and_its_folder_goes_with_it(tmp_path, monkeypatch):
    """What it complained about can be passed on to the user.

    Folders of processes that were killed go when the next one starts; others are in use.
    """
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    killed, other = (tmp_path / f"onebot-rerun-{process}-x" for process in (2**22 + 1, 1))
    killed.mkdir()
    other.mkdir()
    child = Child(["--no-such-option"])
    assert len({*tmp_path.iterdir()} - {other}) == 1 and not killed.exists()
    wait_for(lambda: not child.running, "its end")
    assert "no-such-option" in child.output()
    child.stop()
    assert [*tmp_path.iterdir()] == [other]
