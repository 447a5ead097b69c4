"""A click on the map of the steering page drives the robot there, and the page's stop stops it."""

import math
import re

import pytest
from nav_msgs.msg import Odometry
from selenium.webdriver.common.by import By

from tests.ros_support import NodeProcess, Peer
from tests.steering_browser_support import Page
from tests.support import wait_for

pytestmark = pytest.mark.slow

BRINGUP = "onebot_bringup.launch.onebot_bringup"
WORDS = "world:=maze", "y:=0.8", "sensors_enabled:=true", "navigate:=true", "viewer:=none"
SLOW_MOTION = "real_time_factor:=0.25"  # beside a browser, a loaded computer may not keep pace
PLACE = re.compile(r"x (\S+) m, y (\S+) m, (\S+)° in map")


def click(page: Page, right: int, up: int) -> tuple[float, float]:
    """Click a place on the map with the tool 2D Goal Pose; return what the page says it is, m."""
    page.find("[data-tool=goal]").click()
    drawing = page.find("#ground svg")
    mouse = page.act().move_to_element_with_offset(drawing, right, -up).click_and_hold()
    mouse.move_by_offset(30, 0).release().perform()
    words = wait_for(lambda: PLACE.search(page.text("#ground [role=status]")), "the place")
    x, y, _ = (float(word.replace("\u2212", "-")) for word in words.groups())
    return x, y


def test_a_click_drives_the_robot_there_and_stop_stops_it(peer: Peer, tab: Page) -> None:
    """The map shows the robot's way there; nothing unlocks the robot but a drive by hand."""
    with NodeProcess(BRINGUP, *WORDS, SLOW_MOTION, "steer:=true", "port:=0") as bringup:
        truth = peer.hear(Odometry, "velocity_controller/ground_truth")
        address = wait_for(lambda: re.search(r"open (http://\S+)\n", bringup.output), "the page")
        tab.open(address[1])
        tab.find("[name=map]").click()
        wait_for(
            lambda: tab.driver.find_elements(By.CSS_SELECTOR, "#ground .map:not(.absent)"),
            "the map",
        )

        def away(place: tuple[float, float]) -> float:
            position = truth[-1].pose.pose.position
            return math.dist(place, (position.x, position.y))

        place = click(tab, 60, 0)
        wait_for(lambda: tab.find("#ground .path").get_attribute("d"), "its way on the map")
        wait_for(lambda: tab.find("#ground .footprint").get_attribute("d"), "its footprint")
        wait_for(lambda: "Navigator: arrived" in tab.text("#driver"), "the robot to arrive")
        assert away(place) < 0.1 and truth[-1].pose.pose.position.x > 0.3
        # It is still on its way when the browser presses stop, however late that is.
        slow = peer.set_parameters("velocity_controller", **{"linear.x.max_velocity": 0.1})
        assert slow[0].successful
        place = click(tab, -60, 0)
        wait_for(lambda: abs(truth[-1].twist.twist.linear.x) > 0.02, "the robot to drive")
        tab.find("#stop").click()
        wait_for(lambda: abs(truth[-1].twist.twist.linear.x) < 1e-3, "the robot to stop")
        wait_for(lambda: "Locked" in tab.text("#driver"), "the lock")
        assert away(place) > 0.1
        click(tab, -60, 0)
        wait_for(lambda: "rejected: the robot is locked" in bringup.output, "a refusal")
