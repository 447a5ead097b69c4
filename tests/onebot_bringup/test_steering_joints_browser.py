"""The steering page's joints in a real browser: a slider moves an arm only while it is held."""

from collections.abc import Callable, Iterator

import pytest
from geometry_msgs.msg import Twist
from selenium.webdriver.common.keys import Keys

from tests.onebot_bringup.joints_support import STANDING, UPPER, Arm, described
from tests.onebot_bringup.steering_support import TOPIC, Steering, steering
from tests.onebot_control.arm_support import MODULE
from tests.ros_support import NodeProcess
from tests.steering_browser_support import Page
from tests.support import wait_for

pytestmark = pytest.mark.slow

SLIDER = "#joint-0"


@pytest.fixture(scope="module")
def arm(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arm]:
    model = tmp_path_factory.mktemp("robot") / "standing.urdf"
    model.write_text(STANDING)
    with NodeProcess(MODULE, str(model)), described(domain, STANDING) as peer:
        yield Arm(peer)


@pytest.fixture(scope="module")
def node(arm: Arm) -> Iterator[Steering]:
    with steering() as node:
        yield node


@pytest.fixture
def page(tab: Page, node: Steering) -> Page:
    return opened(tab, node)


@pytest.fixture
def twists(arm: Arm) -> Iterator[list[Twist]]:
    """The arm is on a robot that drives: what that is commanded."""
    heard: list[Twist] = []
    node = arm.peer.node
    wheels = node.create_subscription(Twist, TOPIC, heard.append, 100)
    yield heard
    arm.peer.run(node.destroy_subscription, wheels)


def opened(tab: Page, node: Steering) -> Page:
    """The page, with its panel of joints."""
    tab.open(node.address)
    wait_for(lambda: tab.find("[name=joints]").is_displayed(), "the joints")
    if not tab.find("#joints").is_displayed():
        tab.find("[name=joints]").click()
    return tab


def moving(arm: Arm) -> Callable[[], bool]:
    """Gives whether the arm has moved from where it is."""
    start = arm.positions()[0]
    return lambda: abs(arm.positions()[0] - start) > 0.05


def hold(page: Page, arm: Arm, reached: Callable[[], bool] = lambda: True) -> None:
    """Hold the arm's slider at half of its way, to where there is room, until it has moved."""
    side, moves = -1.0 if arm.positions()[0] > 0.0 else 1.0, moving(arm)
    right = side * page.find(SLIDER).size["width"] / 4
    page.drive_by_mouse(SLIDER, right, 0, lambda: moves() and reached())


def stop(arm: Arm, end: Callable[[], object]) -> None:
    """Do something that stops it, and see that it does, not at a limit."""
    end()
    arm.rest()
    assert abs(arm.positions()[0]) < UPPER - 0.01


def let_go(page: Page) -> None:
    """Let go of a slider, and wait for the page to heed it: without processor time it does late."""
    page.let_go()
    wait_for(lambda: page.body("hand") == "", "the end of the hold")


def value(page: Page) -> float:
    return float(page.find(SLIDER).get_property("value"))


def test_a_slider_moves_its_joint_while_it_is_held(page: Page, arm: Arm) -> None:
    """With that share of its speed; let go, it springs back, and the joint stops.

    So it does when the panel of joints is closed.
    """

    def names() -> list[str]:
        labels = page.find("#joints").find_elements("css selector", "label")
        return [label.text for label in labels]

    wait_for(lambda: names() == ["arm_joint", "lift_joint"], "the sliders")

    def moves_at_its_share() -> bool:
        shown = page.body("hand") == "joints" and page.text("#driver") == "You move it"
        return shown and abs(abs(arm.speed()) - abs(value(page))) < 0.03

    hold(page, arm, moves_at_its_share)
    stop(arm, lambda: let_go(page))
    assert value(page) == 0.0 and page.body("hand") == ""
    assert page.find(SLIDER).get_attribute("aria-valuetext") == "0.00 rad/s"
    words = f"{arm.positions()[0]:.3f} rad".replace("-", "\N{MINUS SIGN}")
    wait_for(lambda: page.text("#joint-0-position") == words, "where it is")
    hold(page, arm)
    stop(arm, page.find("[name=joints]").click)
    page.let_go()


def test_arrow_keys_move_the_joint_with_the_focus(
    page: Page, arm: Arm, twists: list[Twist]
) -> None:
    """And do not drive; without the focus they drive and move no joint."""
    wait_for(lambda: page.find("#pad").is_displayed(), "the wheels")
    for key, sign in ((Keys.ARROW_RIGHT, 1.0), (Keys.ARROW_DOWN, -1.0)):
        page.driver.execute_script("arguments[0].focus()", page.find(SLIDER))
        moves = moving(arm)
        page.drive_by_keys(key, lambda moves=moves: page.body("hand") == "joints" and moves())
        wait_for(lambda sign=sign: sign * arm.speed() > 0.9, "its full speed")
        stop(arm, lambda key=key: page.release_keys(key))
    assert not [twist for twist in twists if twist != Twist()]
    hold(page, arm)
    stop(arm, lambda: let_go(page))
    count = len(arm.commands)
    page.drive_by_keys(Keys.ARROW_UP, lambda: twists[-1].linear.x > 0.0)
    page.release_keys(Keys.ARROW_UP)
    wait_for(lambda: twists[-1] == Twist(), "the stop")
    assert len(arm.commands) == count


def test_an_arm_that_stands_has_its_joints_only(
    page: Page, arm: Arm, request: pytest.FixtureRequest
) -> None:
    """They are open from the beginning; what drives is there as soon as there are wheels."""
    tools = "[data-tool=goal]", "[data-tool=estimate]", "[data-camera=follow]"
    driving = "#pad", "#linear", "#angular", "#braking", "#settings", "#readout", *tools
    wait_for(lambda: not any(page.find(part).is_displayed() for part in driving), "no wheels")
    assert page.find(SLIDER).is_displayed() and page.find("#stop").is_displayed()
    assert page.find("[data-tool=point]").is_displayed()
    assert "odometry" not in page.find("body").text.lower()

    def says(words: str) -> bool:
        return page.text("#driver").startswith(words)  # a page that was left may still be open

    wait_for(lambda: says("Nobody moves it"), "the state")
    page.act().send_keys(" ").perform()
    wait_for(lambda: says("Locked: move a joint to unlock"), "the lock")
    request.getfixturevalue("twists")
    wait_for(lambda: all(page.find(part).is_displayed() for part in driving), "the wheels")
    assert says("Locked: move a joint to unlock"), "the wheels are not locked"
