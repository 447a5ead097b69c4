"""The steering page's node on real DDS, with a WebSocket client in the page's place."""

import re
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import aiohttp
import pytest
from std_msgs.msg import String

from onebot_bringup.steering.steering_page import SteeringPage
from onebot_description.errors import OneBotError
from tests.onebot_bringup.steering_support import (
    Commands,
    PageClient,
    Steering,
    requested,
    steered,
    visited,
)
from tests.ros_support import LATCHED
from tests.support import PATIENCE, wait_for


def test_commands_go_out_while_held_and_stop_when_let_go(shared):
    """At the fixed rate and as held, within the limits; then three zeros, and nothing more."""
    with visited(*shared) as (peer, page):
        robot = Commands(peer, page)
        assert robot.speeds == [] and page.state["driver"] is None
        page.hold(0.25, -0.5)
        wait_for(lambda: len(robot.speeds) > 10, "ten commands")
        assert page.state["driver"] == page.id and page.state["you"]
        speeds = {"linear": 0.25, "angular": -0.5, "lateral": 0.0}
        assert page.state["command"] == {**speeds, "joints": {}}
        page.hold(100.0, 100.0)
        robot.reach(1.0)
        assert robot.heard[-1].angular.z == 1.0, "on the same arc"
        page.let_go()
        robot.come_to_rest()
        wait_for(lambda: page.state["driver"] is None, "control to be free")


def test_the_log_says_that_a_page_left_and_ctrl_c_stops_the_robot(peer):
    """Refused, closed, broken off, too large a message; and whether it drove.

    Refusals of a kind are logged at most every five seconds. Zeros go out before the node ends, and
    pages are told that it goes.
    """
    stopped = "; it drove, so the robot is stopped"
    left = f"a page was closed, or its connection was lost{stopped}"
    with steered(5) as (node, refused, closed, broken, huge, driving):
        robot = Commands(peer, refused)
        for page, end, words, times in (
            (refused, lambda: [refused.say("{}") for _ in range(30)], "page: the type must be", 1),
            (closed, closed.close, left, 1),
            (broken, broken.cut, left, 2),
            (huge, lambda: huge.say("x" * 200_000), left, 3),
        ):
            count = len(robot.moving)
            page.hold(0.3)
            wait_for(lambda count=count: len(robot.moving) > count, "commands")
            page.silence()
            end()
            wait_for(lambda words=words, n=times: node.output.count(words) >= n, words)
            robot.come_to_rest()
        assert node.output.count("page: the type must be") < 15
        driving.hold(0.25)
        robot.reach(0.25)
        assert node.interrupt() == 0
        robot.come_to_rest()
        wait_for(lambda: driving.closed, "the end of the connection")


def _status(address: str, path: str, **headers: str) -> tuple[int, str]:
    """The status of a request, and what the answer says."""
    parts = urlsplit(address)
    request = Request(f"{parts.scheme}://{parts.netloc}{path}", headers=headers)
    with requested(request) as answer:
        return answer.status, answer.read().decode()


def test_page_is_served_with_a_strict_policy(shared):
    """The page and its parts are there; nothing may be loaded from elsewhere, or frame it."""
    address = shared[1].address
    assert "127.0.0.1" in address and "token" not in address
    with urlopen(address, timeout=PATIENCE) as answer:
        policy = answer.headers["Content-Security-Policy"]
        assert "<html" in answer.read().decode()
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'self'" in policy and "frame-ancestors 'self'" in policy
    assert "unsafe" not in policy
    port = urlsplit(address).port  # of the view, at loopback's other name
    assert set(re.findall(r"http:[^ ;]*", policy)) == {f"http://localhost:{port}"}
    assert _status(address, "/static/page.js")[0] == 200
    assert _status(address, "/static/../steering_page.py")[0] in (403, 404)
    assert _status(address, "/view/none/")[0] == 404


def test_foreign_hosts_and_origins_are_refused(shared):
    """Neither a page of another site nor a name that somebody else made lead here can talk."""
    address = shared[1].address
    foreign = {"Sec-Fetch-Site": "cross-site"}
    for path in ("/", "/tools/nodes", "/static/page.js"):
        assert _status(address, path, **foreign)[0] == 403
        assert _status(address, path, **{"Sec-Fetch-Site": "same-site"})[0] == 403
        assert _status(address, path, **{"Sec-Fetch-Site": "same-origin"})[0] == 200
    link = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert _status(address, "/", **foreign, **link)[0] == 200
    for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example"}):
        assert _status(address, "/", **headers)[0] == 403
        with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
            PageClient(address, **headers)
        assert caught.value.status == 403
    with PageClient(address, Origin=address.partition("/?")[0]) as page:
        assert page.id


def test_a_wrong_parameter_is_one_clear_error(start_node):
    with pytest.raises(OneBotError, match='^"a//b" is not a valid name: .*[^:]$'):
        start_node(SteeringPage, topic="a//b")


def test_the_address_is_printed_when_the_view_is_there(peer):
    """For that long it waits, to be the last line; the page is there before."""
    page = peer.node.create_publisher(String, "/rerun_viewer/page", LATCHED)
    with Steering(await_view=600.0) as node:
        wait_for(lambda: page.get_subscription_count(), "the node")
        peer.set_parameters("/steering_page")  # waits until it spins
        assert "open http" not in node.output
        page.publish(String(data="http://127.0.0.1:9090/?url=x"))
        assert urlopen(node.address, timeout=PATIENCE).status == 200
