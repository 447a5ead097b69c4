"""How the parts of the steering page share the screen: the view, cameras, panels and the map."""

import json
from collections.abc import Iterator

import pytest
from geometry_msgs.msg import Twist
from selenium.webdriver.support.select import Select
from sensor_msgs.msg import Image
from std_msgs.msg import String

from onebot_description.ros.domains import used_domain
from tests.onebot_bringup.steering_support import Steering, steering
from tests.onebot_bringup.viewer_support import ARM
from tests.ros_support import LATCHED, Peer
from tests.steering_browser_support import Page, viewer_page
from tests.support import wait_for

pytestmark = pytest.mark.slow

SCREENS = [(1280, 657), (1920, 1080)]
ROBOTS = {name: f"/{name}/velocity_controller/cmd_vel" for name in ("bare", "seeing")}
CAMERAS = {"/seeing/front/image_raw": (200, 60, 30), "/seeing/rear/image_raw": (30, 60, 200)}
DISPLAYS = {
    "shown": [],
    "legend": [
        {"kind": "trail", "name": "truth", "color": [77, 208, 225]},
        {"kind": "covariance", "name": "odometry", "color": [255, 176, 32]},
    ],
}
PARTS = "#view iframe", "aside", "#readout", "#camera", "#displays", "#parameters"


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Steering]:
    """Two robots with the same description; one of them has two cameras."""
    with (
        viewer_page(tmp_path_factory.mktemp("viewer")) as address,
        used_domain() as domain,
        Peer(domain) as peer,
        steering(topic=ROBOTS["seeing"]) as node,
    ):
        for name, topic in ROBOTS.items():
            peer.hear(Twist, topic)
            description = peer.node.create_publisher(String, f"/{name}/robot_description", LATCHED)
            description.publish(String(data=ARM))
        pictures = {
            peer.node.create_publisher(Image, topic, 1): picture(color)
            for topic, color in CAMERAS.items()
        }
        timer = peer.node.create_timer(0.1, lambda: [p.publish(m) for p, m in pictures.items()])
        for topic, text in {"page": address, "displays": json.dumps(DISPLAYS)}.items():
            latched = peer.node.create_publisher(String, f"/rerun_viewer/{topic}", LATCHED)
            latched.publish(String(data=text))
        yield node
        peer.run(peer.node.destroy_timer, timer)


def picture(color: tuple[int, int, int]) -> Image:
    """A picture of one color."""
    return Image(width=160, height=120, step=480, encoding="rgb8", data=bytes(color) * 160 * 120)


@pytest.fixture(params=ROBOTS)
def page(request: pytest.FixtureRequest, node: Steering, chromium: Page) -> Iterator[Page]:
    """The page of each robot."""
    chromium.open(node.address)
    robot = Select(chromium.find("#robot select"))
    wait_for(lambda: len(robot.options) == len(ROBOTS), "the robots")
    robot.select_by_visible_text(request.param)
    title = f"{request.param} (arm)"
    wait_for(lambda: chromium.text("h1") == title, "the robot's name")
    cameras = request.param == "seeing"
    wait_for(lambda: chromium.find("#camera").is_displayed() == cameras, "its cameras")
    wait_for(lambda: chromium.view_is_shown, "its view")
    yield chromium
    chromium.emulate_nothing()


# The page replaces the element with each picture: an element found once is soon stale.
PICTURE = """
const { width, height } = document.querySelector("#camera img").getBoundingClientRect();
return [width, height];
"""


@pytest.mark.parametrize("screen", SCREENS)
def test_the_view_is_the_largest_part(page: Page, screen: tuple[int, int]) -> None:
    """Whatever panel is open: nothing covers a part, and each is on the screen."""
    page.emulate(*screen)
    for panel in ("", "displays", "parameters"):
        if panel:
            page.find(f"[name={panel}]").click()
            wait_for(lambda panel=panel: page.in_sight(f"#{panel}"), "the panel")
        found = {
            selector: page.find(selector).rect for selector in PARTS if page.in_sight(selector)
        }
        assert ("#camera" in found) == page.find("#camera").is_displayed()
        assert {"#view iframe", "aside", "#readout"} <= found.keys()
        view = found["#view iframe"]
        assert view["width"] > 0.4 * screen[0]
        for box in found.values():
            assert box["width"] * box["height"] <= view["width"] * view["height"]
            assert box["x"] + box["width"] <= screen[0] and box["y"] + box["height"] <= screen[1]
        if "#camera" in found:
            wait_for(lambda: page.driver.execute_script(PICTURE)[1], "the picture")
            width, height = page.driver.execute_script(PICTURE)
            assert width >= 320 and height == pytest.approx(0.75 * width, abs=1.0)
    page.find("[name=parameters]").click()


@pytest.mark.parametrize("page", ["seeing"], indirect=True)
def test_goal_poses_keep_their_fields_beside_a_panel(page: Page) -> None:
    """On a laptop both are seen; on a phone the panel makes room."""
    for width, height in ((1280, 657), (390, 844)):
        page.emulate(width, height, mobile=width < 900)
        page.find("[name=displays]").click()
        assert page.in_sight("#displays")
        page.find("[data-tool=goal]").click()
        for field in ("x", "y", "yaw", "publish"):
            assert page.in_sight(f"#ground [name={field}]"), (width, field)
        assert page.in_sight("#displays") == (width > 900)
        page.find("[name=map]").click()
        if width > 900:
            page.find("[name=displays]").click()


@pytest.mark.parametrize("page", ["bare"], indirect=True)
def test_a_legend_names_the_lines_in_the_view(page: Page) -> None:
    """Below it, each with its color."""
    trail, sector = page.driver.execute_script(LEGEND)
    assert trail == ["truth: trail", "rgb(77, 208, 225)"]
    assert sector[0].startswith("odometry: covariance") and "sector" in sector[0]
    assert sector[1] == "rgb(255, 176, 32)"
    assert page.in_sight("#legend")


LEGEND = """
return [...document.querySelectorAll("#legend li")].map((item) =>
  [item.textContent, getComputedStyle(item, "::before").borderTopColor]);
"""


@pytest.mark.parametrize("page", ["seeing"], indirect=True)
def test_each_camera_can_be_chosen(page: Page) -> None:
    """One is shown at a time, and the keys drive after the choice."""

    def shown() -> str:
        script = "return document.querySelector('#camera img').alt"
        return str(page.driver.execute_script(script))

    for topic in (*CAMERAS, next(iter(CAMERAS))):
        Select(page.find("#camera select")).select_by_visible_text(topic)
        wait_for(lambda topic=topic: shown() == topic, "its picture")
    assert page.driver.execute_script("return document.activeElement.tagName") == "BODY"
