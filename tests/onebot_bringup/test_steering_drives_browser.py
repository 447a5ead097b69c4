"""The steering page has the controls of the robot's drive: one that goes sideways, and a car."""

from collections.abc import Callable, Iterator

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from selenium.webdriver.common.keys import Keys

from tests.onebot_bringup.steering_support import steering
from tests.onebot_bringup.test_steering_page_browser import wait_to_stop
from tests.ros_support import Peer
from tests.steering_browser_support import Page
from tests.support import wait_for

pytestmark = pytest.mark.slow

TOPIC = "/base_controller/reference"
TURNS = {"linear.x.max_velocity": 0.5, "angular.z.max_velocity": 1.0}
STRAFES = {**TURNS, "linear.y.max_velocity": 0.3, "linear.y.max_acceleration": 0.1}
CAR = {
    **{**TURNS, "angular.z.max_velocity": 3.0, "wheelbase": 0.35, "minimum_turning_radius": 0.4},
    "steering_joints_names": ["right_steering_joint", "left_steering_joint"],
}
LATERAL = ".speeds .lateral", "#lateral-limit", "[name=sideways]", ".keys .lateral"


@pytest.fixture
def robot(ros_domain: int) -> Iterator[Peer]:
    """A controller's node."""
    with Peer(ros_domain, "base_controller") as robot:
        yield robot


@pytest.fixture
def heard(robot: Peer, request: pytest.FixtureRequest) -> list[Twist]:
    """What a controller with the test's parameters receives."""
    for name, value in request.param.items():
        robot.node.declare_parameter(name, value)
    return robot.hear(Twist, TOPIC, 1000)


@pytest.fixture
def page(heard: list[Twist], gamepad: None, tab: Page) -> Iterator[Page]:
    """Its page, once the limits are known."""
    with steering(topic=TOPIC) as node:
        tab.open(node.address)
        wait_for(lambda: tab.limit("linear") == "0.5", "the controller's limits")
        yield tab


def speeds(twist: Twist) -> tuple[float, float, float]:
    """Forward, to the left, and turning to the left."""
    return twist.linear.x, twist.linear.y, twist.angular.z


def at(heard: list[Twist], *wanted: float) -> Callable[[], bool]:
    """Gives whether this is the latest command."""
    return lambda: bool(heard) and speeds(heard[-1]) == pytest.approx(wanted, abs=1e-9)


def across(page: Page) -> float:
    """What the horizontal slider shows, -1 to 1, to the left."""
    return float(page.find("#angular input").get_property("value"))


@pytest.mark.parametrize("heard", [STRAFES], indirect=True)
def test_a_robot_is_driven_sideways(robot: Peer, page: Page, heard: list[Twist]) -> None:
    """By Q and E beside the others, within its own limit; the page shows the speed."""
    assert all(page.find(part).is_displayed() for part in LATERAL)
    odometry = Odometry(child_frame_id="base")
    odometry.twist.twist.linear.y = 0.12
    moved = robot.node.create_publisher(Odometry, "/base_controller/odom", 10)
    timer = robot.node.create_timer(0.05, lambda: moved.publish(odometry))
    for keys, wanted in {
        ("q",): (0.0, 0.3, 0.0),
        ("w", "e"): (0.5, -0.3, 0.0),
        (Keys.SHIFT, "q", "d"): (0.0, 0.15, -0.5),
        ("q", "e", "s"): (-0.5, 0.0, 0.0),
    }.items():
        page.drive_by_keys(keys, at(heard, *wanted))
        assert page.body("hand") == "keyboard"
        wait_for(lambda y=wanted[1]: page.number("lateral-command") == y, "the speed")
        page.release_keys(keys)
        wait_to_stop(page, heard)
    wait_for(lambda: page.number("lateral-measured") == 0.12, "the measured speed")
    # At 0.1 m/s2 from 0.3 m/s; forward nothing limits the braking.
    assert page.text("#braking output") == "0.45 m"
    page.enter("#lateral-limit", "0.1")
    page.drive_by_keys("q", at(heard, 0.0, 0.1, 0.0))
    page.act().send_keys(" ").perform()
    wait_to_stop(page, heard)
    page.release_keys("q")
    page.enter("#lateral-limit", "9")
    held = "Limited to 0.3 m/s by /base_controller."
    wait_for(lambda: page.text("#lateral-hint") == held, "the mark")
    robot.run(robot.node.destroy_timer, timer)


@pytest.mark.parametrize("heard", [STRAFES], indirect=True)
def test_joystick_slider_and_gamepad_drive_sideways(page: Page, heard: list[Twist]) -> None:
    """The horizontal axis of the page turns or drives sideways, as chosen; a choice lets go.

    On a gamepad the left stick drives in all directions, and the right one turns.
    """
    page.drive_by_pad(-1.5, 0.0, at(heard, 0.0, 0.0, 1.0))
    page.driver.execute_script("document.querySelector('[name=sideways]').click()")
    wait_to_stop(page, heard)
    page.drag(1, 1)
    page.wait_for_states(2)
    assert heard[-1] == Twist() and page.body("hand") == ""
    page.let_go()
    page.drive_by_pad(-1.5, 1.5, lambda: heard and heard[-1].linear.y > 0.1)
    assert heard[-1].linear.x > 0.3 and heard[-1].angular.z == 0.0
    page.let_go()
    wait_to_stop(page, heard)
    page.drive_by_mouse("#angular [name=minus]", 0, 0, at(heard, 0.0, -0.3, 0.0))
    assert across(page) == -1.0
    assert page.find("#angular").get_attribute("aria-label") == "Lateral speed"
    page.let_go()
    wait_to_stop(page, heard)
    page.drive_by_keys("e", at(heard, 0.0, -0.3, 0.0))
    wait_for(lambda: across(page) == -1.0, "the slider to show it")
    page.release_keys("e")
    page.find("[name=sideways]").click()
    assert page.find("#angular").get_attribute("aria-label") == "Angular speed"
    for sticks, wanted in (
        ([-1, 0, 0, 0], (0.0, 0.3, 0.0)),
        ([0, 0, 1, 0], (0.0, 0.0, -1.0)),
        ([0, -1, -1, 0], (0.5, 0.0, 1.0)),
    ):
        page.drive_by_stick(sticks, at(heard, *wanted))
        page.stick()
        wait_to_stop(page, heard)
    page.stick(mapping="")  # the third axis may be a trigger
    page.drive_by_stick([-1, 0, -1, 0], at(heard, 0.0, 0.0, 1.0))
    page.stick()
    assert "sideways" in page.find("#sticks").get_attribute("title")


@pytest.mark.parametrize("heard", [CAR], indirect=True)
def test_a_car_is_steered(page: Page, heard: list[Twist]) -> None:
    """The horizontal axis is the curvature, up to that of the least radius; standing, it waits."""
    assert page.text("#angular small") == "minimum radius 0.40\N{NO-BREAK SPACE}m"
    assert page.find("#angular small").is_displayed()
    assert not any(page.find(part).is_displayed() for part in LATERAL)
    page.drive_by_keys("a", lambda: across(page) == 1.0)
    page.wait_for_states(3)
    assert {speeds(twist) for twist in heard} == {(0.0, 0.0, 0.0)}
    page.release_keys("a")
    wait_for(lambda: across(page) == 0.0, "the bar to come back")
    for keys, wanted in {
        ("a", "w"): (0.5, 0.0, 1.25),
        ("d", "w"): (0.5, 0.0, -1.25),
        ("d", "s"): (-0.5, 0.0, 1.25),
        (Keys.SHIFT, "w", "a"): (0.25, 0.0, 0.625),
    }.items():
        page.drive_by_keys(keys, at(heard, *wanted))
        page.release_keys(keys)
        wait_to_stop(page, heard)
    slider = page.find("#angular input").size["width"]
    page.drive_by_mouse("#angular input", -slider, 0, lambda: page.body("driver") == "you")
    page.wait_for_states(3)
    assert across(page) == 1.0 and heard[-1] == Twist()
    page.let_go()
    page.drive_by_pad(0.4, 1.5, lambda: heard and heard[-1].linear.x > 0.4)
    assert -0.9 < heard[-1].angular.z * 0.4 / heard[-1].linear.x < -0.1
    bend = page.sent()[-1]["angular"] * 0.4 / page.sent()[-1]["linear"]
    wait_for(lambda: across(page) == pytest.approx(bend, abs=0.01), "the bar")
    page.let_go()
    wait_to_stop(page, heard)
    page.drive_by_stick([1, -1], lambda: heard and heard[-1].linear.x > 0.3)
    page.stick()
    assert "steers" in page.find("#sticks").get_attribute("title")
