"""The viewer's page in a real browser."""

import re

import pytest
from std_msgs.msg import String

from tests.onebot_bringup.viewer_support import ARM, BLUE, VIEW
from tests.ros_support import LATCHED, NodeProcess, Peer, ros_args
from tests.support import wait_for
from tests.support_browser import browser, hosts_reached, screenshot
from tests.support_rendering import colored, pixels

pytestmark = pytest.mark.slow


def test_page_shows_the_robot_and_stays_on_this_machine(ros_domain, tmp_path):
    """The address it prints opens a page with the robot in its colour, and asks no other host."""
    (tmp_path / "view.yaml").write_text(VIEW)
    args = ros_args(grpc_port=0, web_port=0, open_browser="false", view=tmp_path / "view.yaml")
    with (
        NodeProcess("onebot_bringup.viewer.rerun_viewer", *args) as node,
        Peer(ros_domain) as peer,
        browser(tmp_path / "profile") as page,
    ):
        peer.publisher(String, "robot_description", LATCHED).publish(String(data=ARM))
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        address = wait_for(
            lambda: re.search(r"open (http://127\.0\.0\.1:\d+)", node.output), "the address"
        )
        page.get(address[1])
        # Software WebGL takes some 20 s to the first picture on two cores.
        wait_for(
            lambda: colored(pixels(screenshot(page)), BLUE).sum() > 2000,
            "the base in the picture",
            timeout=240.0,
        )
        page.save_screenshot(str(tmp_path / "page.png"))
        assert hosts_reached(page) == {"127.0.0.1"}
