"""The steering page in a real browser, steering over real DDS."""

import itertools
import json
import math
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from sensor_msgs.msg import Image, LaserScan
from std_msgs.msg import Bool, String

from onebot_description.elements.packages import package_share
from onebot_description.geometry.poses import yaw_of
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.steering_support import Steering, Way, steering
from tests.ros_support import LATCHED, Peer
from tests.steering_browser_support import Page
from tests.support import wait_for
from tests.support_browser import hosts_reached

pytestmark = pytest.mark.slow

ONEBOT = package_share("onebot_description") / "urdf" / "onebot.urdf.xacro"
TOPIC = "/velocity_controller/cmd_vel"
STILL = Twist()
LIMITS = {"max_linear": 0.5, "max_angular": 1.0}


@pytest.fixture(scope="module")
def node(domain: int) -> Iterator[Steering]:
    with steering(**LIMITS) as node:
        yield node


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    with Peer(domain) as peer:
        yield peer


@pytest.fixture
def alone(ros_domain: int) -> Iterator[Peer]:
    """A robot in a domain without the node that tests share."""
    with Peer(ros_domain) as peer:
        yield peer


@pytest.fixture
def heard(peer: Peer) -> list[Twist]:
    """The commands that a robot receives."""
    return peer.hear(Twist, TOPIC, 1000)


@pytest.fixture
def page(tab: Page, node: Steering, heard: list[Twist]) -> Page:
    """The page of ``node``, for the robot that hears them."""
    tab.open(node.address)
    if tab.find("#topic-name").get_property("value") != TOPIC:
        tab.enter("#topic-name", TOPIC)
    wait_for(lambda: tab.text("#topic output") == "Twist, 1 subscriber", "the robot")
    return tab


def pair(twist: Twist) -> tuple[float, float]:
    return twist.linear.x, twist.angular.z


def moving(heard: list[Twist]) -> Callable[[], Twist | None]:
    """Gives the first command that moves the robot, of those that are yet to come."""
    begin = len(heard)
    return lambda: next((m for m in heard[begin:] if m != STILL), None)


def at(heard: list[Twist], linear: float, angular: float) -> Callable[[], bool]:
    """Gives whether this is the latest command."""
    return lambda: bool(heard) and pair(heard[-1]) == (linear, angular)


def wait_to_stop(page: Page, heard: list[Twist]) -> None:
    """Wait for the command of zero, and see that it is the last one and repeated."""
    wait_for_zero(page, heard)
    wait_for(lambda: heard[-3:] == 3 * [STILL], "more of them")
    count = len(heard)
    page.wait_for_states(5)
    assert heard[count:] == [STILL] * len(heard[count:]) and len(heard) <= count + 2


def let_go(page: Page, heard: list[Twist]) -> None:
    """Release the mouse, and see that this stops the robot."""
    page.let_go()
    wait_to_stop(page, heard)


def wait_for_zero(page: Page, heard: list[Twist]) -> None:
    """Wait until nobody drives; a page that is late for a moment stops the robot, too."""
    wait_for(lambda: page.body("driver") == "nobody" and heard[-1] == STILL, "the stop")


def test_it_loads_from_its_own_port_only(tab: Page, node: Steering) -> None:
    """Offline: the page requests nothing from other hosts, and the browser logs no problem."""

    def loaded() -> list[str]:
        """What it loads; nothing if its connection was lost meanwhile, on a busy machine."""
        tab.driver.get("about:blank")
        for log in ("performance", "browser"):
            tab.driver.get_log(log)
        tab.driver.get(node.address)
        wait_for(lambda: tab.connected, "the page to connect")
        wait_for(lambda: tab.text("#driver") == "Nobody drives", "the state")
        script = "return performance.getEntriesByType('resource').map((entry) => entry.name)"
        names = tab.driver.execute_script(script)
        return [] if tab.driver.current_url in names else names

    resources = wait_for(loaded, "the page with one connection")
    assert hosts_reached(tab.driver) == {"127.0.0.1"}
    assert len(resources) > 9
    assert all(name.startswith(f"http://127.0.0.1:{node.port}/static/") for name in resources)
    assert tab.driver.get_log("browser") == []


def test_the_joystick_drives_the_robot(page: Page, heard: list[Twist]) -> None:
    """Held with the mouse, by its place on the pad; the page shows the command.

    To let go stops it at once, by a release, also from a pad that is held beyond its rim.
    """

    def drives() -> Twist | None:
        speed = heard[-1].linear.x if heard else 0.0
        shown = abs(page.number("linear-command") - speed) < 0.006
        return heard[-1] if speed > 0.0 and shown else None

    linear, angular = pair(page.drive_by_pad(-0.6, 0.7, drives))
    assert page.text("#driver") == "You drive" and page.body("hand") == "joystick"
    # Without the dead zone of 6 % on each axis; a pixel is 1 % of the radius.
    assert linear == pytest.approx(0.5 * (0.7 - 0.06) / 0.94, abs=0.015)
    assert angular == pytest.approx(1.0 * (0.6 - 0.06) / 0.94, abs=0.03)
    releases = page.said().count("release")
    let_go(page, heard)
    assert page.said().count("release") == releases + 1 and page.said()[-1] == "release"
    assert pair(page.drive_by_pad(0.0, 1.5, moving(heard))) == (0.5, 0.0)
    let_go(page, heard)
    page.drive_until(
        lambda: (page.hold_pad(0.0, 0.5), page.drag(-600, 0)),
        page.let_go,
        lambda: heard and heard[-1].angular.z > 0.8,
        "the pad, held over the view",
    )
    let_go(page, heard)


BLUR = "window.dispatchEvent(new Event('blur'))"  # as of a window of another program in front


def test_leaving_the_page_stops(page: Page, heard: list[Twist]) -> None:
    """The window without focus, the tab left or loaded anew, while the pad is held."""
    driver, own = page.driver, page.driver.current_window_handle
    for leave in (
        lambda: driver.execute_script(BLUR),
        lambda: driver.switch_to.new_window("tab"),
        driver.refresh,
    ):
        page.drive_by_pad(0.0, 0.5, moving(heard))
        leave()
        wait_for(lambda: heard[-1] == STILL, "the stop")
        if leave != driver.refresh:
            wait_for(lambda: page.sent()[-1]["type"] == "release", "the page to let go")
        if driver.current_window_handle != own:
            driver.close()
            driver.switch_to.window(own)
        page.let_go()


def test_a_page_that_lost_its_server_comes_back_still(tab: Page, alone: Peer) -> None:
    """It says that it is lost, connects anew, and does not drive.

    The limit that was chosen by hand is still there.
    """
    heard = alone.hear(Twist, TOPIC, 1000)
    with steering(check=False, **LIMITS) as node:
        tab.open(node.address)
        tab.enter("#linear-limit", "0,4")
        tab.drive_by_pad(0.0, 0.5, moving(heard))
        node.process.send_signal(signal.SIGKILL)
        wait_for(lambda: tab.body("connection") == "down", "the page to notice")
        assert "stops by itself" in tab.text("#message")
        assert tab.number("linear-command") == 0.0
        assert tab.find("#linear input").get_property("value") == "0"
        assert not tab.find("#linear button").is_enabled()
        port = node.port
    begin = len(heard)
    with steering(port=port, **LIMITS) as node:
        wait_for(lambda: tab.connected, "the page to connect anew")
        tab.drag(3, 3)  # the button is still down
        tab.wait_for_states(5)
        assert tab.limit("linear") == "0.4", "the limit was lost with the server"
        assert tab.text("#driver") == "Nobody drives" and tab.text("#message") == ""
        assert heard[begin:] == []
        tab.let_go()
        tab.drive_by_keys("w", at(heard, 0.4, 0.0))
        tab.release_keys("w")


def test_a_connection_that_is_too_slow_stops_and_says_so(
    page: Page, tab: Page, node: Steering, heard: list[Twist]
) -> None:
    """It queues up no commands; when it is fast again, what is held drives again."""
    sides = itertools.cycle((1, -1))

    def said() -> str:
        tab.drag(next(sides), 0)  # a hand that is there
        return tab.text("#message")

    with Way(node.address) as way:
        tab.open(way.address)
        tab.drive_by_pad(0.0, 1.5, at(heard, 0.5, 0.0))
        way.delay = 0.8
        wait_for(lambda: "too slow to drive" in said(), "word of it")
        wait_for(lambda: said() and heard[-1] == STILL, "the stop")
        wait_for(lambda: "no message from the page that drives" in node.output, "a warning")
        states = [message for _, message in tab.frames() if message["type"] == "state"]
        assert len(tab.sent()) - states[-1]["received"] <= 8, "commands are queued"
        way.delay = 0.0
        wait_for(lambda: said() == "" and heard[-1] != STILL, "it to drive again")
        let_go(tab, heard)


@pytest.mark.parametrize("gamepad", ["navigator.getGamepads = undefined"], indirect=True)
def test_arrows_and_letters_drive_while_they_are_down(
    gamepad: None, page: Page, heard: list[Twist]
) -> None:
    """Together too, at half speed with Shift; not what is typed into a field.

    Also without gamepads, of which Firefox has none at the address of another computer.
    """
    for keys, wanted in {
        (Keys.ARROW_UP,): (0.5, 0.0),
        (Keys.ARROW_DOWN, Keys.ARROW_LEFT): (-0.5, 1.0),
        ("w", "d"): (0.5, -1.0),
        ("s",): (-0.5, 0.0),
        (Keys.SHIFT, Keys.ARROW_RIGHT): (0.0, -0.5),
    }.items():
        page.drive_by_keys(keys, at(heard, *wanted))
        assert page.body("hand") == "keyboard"
        page.release_keys(keys)
        wait_to_stop(page, heard)
    begin = len(heard)
    page.find("#topic-name").click()
    page.act().send_keys("wasd", Keys.ARROW_UP).perform()
    page.wait_for_states(3)
    assert len(heard) == begin


def test_what_takes_the_keys_lets_go(peer: Peer, page: Page, heard: list[Twist]) -> None:
    """A menu, a list or a drag swallows the key's release; a finger that rests opens no menu.

    Of keys that are let go while the command key is down, macOS sends no release.
    """
    robots = [peer.node.create_subscription(Twist, f"/{n}/cmd_vel", print, 1) for n in "ab"]

    def ask(selector: str, event: str) -> bool:
        """Whether what is held is held after that event, too."""
        script = """const { hand } = document.body.dataset;
        document.querySelector(arguments[0]).dispatchEvent(
          new MouseEvent(arguments[1], { bubbles: true, cancelable: true }));
        return hand === document.body.dataset.hand"""
        return bool(page.driver.execute_script(script, selector, event))

    wait_for(lambda: page.find("#robot select").is_displayed(), "the list of robots")
    for take in (
        lambda: page.act().context_click(page.find("#view")).perform(),
        lambda: page.act().move_to_element(page.find("#robot select")).click().perform(),
        lambda: ask("#readout", "dragstart"),
        lambda: page.act().key_down(Keys.META).perform(),
    ):
        page.drive_by_keys("w", moving(heard))
        take()
        wait_to_stop(page, heard)
        page.act().key_up(Keys.META).perform()
        page.wait_for_states(3)
        assert page.said()[-1] == "release" and page.body("hand") == ""
        page.release_keys("w")
        page.act().send_keys(Keys.ESCAPE).perform()
        page.find("#view").click()
    controls = {"#pad": (0, -60), "#linear input": (0, -60), "#linear [name=plus]": (0, 0)}
    for selector, (right, down) in controls.items():
        page.drive_by_mouse(selector, right, down, moving(heard))
        assert ask(selector, "contextmenu"), "no menu opens there"
        ask("#view", "contextmenu")
        wait_to_stop(page, heard)
        page.let_go()
    for robot in robots:
        peer.run(peer.node.destroy_subscription, robot)


def test_the_space_bar_stops_and_the_held_key_does_not_resume(
    peer: Peer, page: Page, heard: list[Twist]
) -> None:
    """Wherever the focus is, with Ctrl too; what is held has to be let go first.

    A robot with a lock is locked meanwhile; the page shows so, and who else publishes commands.
    """
    locks = peer.hear(Bool, f"{TOPIC}_lock")
    peer.node.create_publisher(Twist, TOPIC, 10)
    page.driver.execute_script("document.querySelector('#linear button').focus()")
    page.drive_by_keys("w", moving(heard))
    page.act().key_down(Keys.CONTROL).send_keys(" ").key_up(Keys.CONTROL).perform()
    wait_to_stop(page, heard)
    assert "stop" in page.said()
    locked = "Locked: drive to unlock · commands also from /peer"
    wait_for(lambda: page.text("#driver") == locked, "the lock")
    assert locks and all(lock.data for lock in locks)
    page.release_keys("w")
    page.drive_by_keys("w", moving(heard))
    wait_for(lambda: not locks[-1].data, "the unlock")
    assert page.text("#driver").startswith("You drive")
    page.find("#stop").click()
    wait_to_stop(page, heard)
    page.release_keys("w")


def test_the_sliders_drive_while_held_and_spring_back(page: Page, heard: list[Twist]) -> None:
    """By their thumbs and by their buttons, which go on in steps."""
    linear, angular = page.find("#linear input"), page.find("#angular input")
    page.drive_by_mouse("#linear input", 0, -linear.size["height"], at(heard, 0.5, 0.0))
    assert page.body("hand") == "sliders"
    let_go(page, heard)
    page.drive_by_mouse("#angular input", angular.size["width"], 0, at(heard, 0.0, -1.0))
    let_go(page, heard)
    assert float(linear.get_property("value")) == float(angular.get_property("value")) == 0.0
    begin = len(heard)
    page.drive_by_mouse("#angular [name=plus]", 0, 0, at(heard, 0.0, 1.0))
    first = next(m for m in heard[begin:] if m != STILL)
    assert 0.0 < first.angular.z < 1.0
    let_go(page, heard)


def test_limits_are_edited_by_the_user(page: Page, heard: list[Twist]) -> None:
    """They count for the next command; beside the field it says what is refused or too much."""
    assert page.limit("linear") == "0.5" and page.limit("angular") == "1"
    page.enter("#angular-limit", "-3")
    wait_for(lambda: page.limit("angular") == "1", "the old one")
    assert page.text("#angular-hint") == "-3 rejected: a limit must be above zero."
    assert "limits" not in page.said()
    page.enter("#linear-limit", "1e9")
    mark = "Limited to 0.5 m/s by max_linear."
    wait_for(lambda: page.text("#linear-hint") == mark, "the mark")
    page.enter("#linear-limit", "0,2")
    wait_for(lambda: page.limit("linear") == "0.2", "the number with a comma")
    wait_for(lambda: page.text("#linear-hint") == "", "the mark to go")
    page.enter("#linear-limit", "")
    wait_for(lambda: page.limit("linear") == "0.5", "the robot's own")
    _works_out_as_the_server_does(page)


def _works_out_as_the_server_does(page: Page) -> None:
    """The limit that an entry is, and the braking distance of the controller."""
    entries = [
        "0,5", "0.5", ",5", "5.", "+2", "1e3", "", "-3", "0", "1,000.5", "0x1", "NaN", "3 m"
    ]  # fmt: skip
    assert page.module("settings.js", "limitOf", [[words] for words in entries]) == [
        0.5, 0.5, 0.5, 5, 2, 1000, None, *["RangeError"] * 6
    ]  # fmt: skip
    ways = {  # m, from m/s at m/s2 and m/s3, as the controller's limiter brakes
        (1.0, 0.5, None): 1.0,
        (0.3, 2.0, None): 0.0225,
        (1.0, 0.5, 1.0): 1.245,
        (0.1, 2.0, 1.0): 0.0298,
        (1.0, None, 3.0): 0.5443,
    }
    cases = [[speed, {"deceleration": a, "jerk": j}] for speed, a, j in ways]
    found = page.module("braking.js", "brakingDistance", cases)
    assert found == pytest.approx([*ways.values()], rel=0.01)


def test_another_topic_is_entered(peer: Peer, page: Page) -> None:
    """The topics around are offered; a name that is none is refused with a sentence."""
    stamped = peer.hear(TwistStamped, "/other/cmd_vel", 1000)
    offered = "return [...document.querySelectorAll('datalist option')].map((o) => o.value)"
    wait_for(lambda: "/other/cmd_vel" in page.driver.execute_script(offered), "the topic's offer")
    wait_for(lambda: page.text("#topic output") == "Twist, 1 subscriber", "its own type")
    page.enter("#topic-name", "not-a-topic")
    wait_for(lambda: "is not a valid name" in page.text("#topic-hint"), "the error")
    field = page.find("#topic-name")
    wait_for(lambda: field.get_property("value") == TOPIC, "the topic to be put back")
    page.enter("#topic-name", "/other/cmd_vel")
    wait_for(lambda: page.text("#topic output") == "TwistStamped, 1 subscriber", "its type")
    assert page.driver.title == "other \N{EN DASH} Steering"
    page.drive_by_keys("w", lambda: stamped and pair(stamped[-1].twist) == (0.5, 0.0))
    page.release_keys("w")


def test_another_robot_is_chosen(peer: Peer, page: Page) -> None:
    """By the keyboard too, whose next press does not drive."""
    topics = {name: f"/{name}/velocity_controller/cmd_vel" for name in ("robot1", "robot2")}
    heard = {name: peer.hear(Twist, topic, 1000) for name, topic in topics.items()}
    wait_for(lambda: "robot2" in page.text("#robot select"), "the choice")
    assert page.in_sight("#robot select")
    page.driver.execute_script("arguments[0].focus()", page.find("#robot select"))
    for name in ("robot1", "robot2"):
        page.act().send_keys(Keys.ARROW_DOWN).perform()
        wait_for(lambda name=name: page.driver.title.startswith(name), "the robot")
    page.act().send_keys(Keys.ARROW_DOWN).send_keys(Keys.ENTER).perform()
    assert page.find("#robot select").get_property("value") == topics["robot2"]
    page.wait_for_states(3)
    assert heard == {"robot1": [], "robot2": []}
    page.drive_by_keys("w", lambda: heard["robot2"] and pair(heard["robot2"][-1]) == (0.5, 0.0))
    page.release_keys("w")


def test_a_press_on_the_map_is_published_with_its_heading(peer: Peer, page: Page) -> None:
    """As in RViz: press, drag to where it faces, release; a tool is for one place."""
    goals = peer.hear(PoseStamped, "/goal_pose")
    points = peer.hear(PointStamped, "/clicked_point")
    at = Odometry(child_frame_id="base_link")
    at.header.frame_id, at.pose.pose.position.x, at.twist.twist.linear.x = "odom", 1.0, 0.25
    moved = peer.node.create_publisher(Odometry, "/velocity_controller/odom", 10)
    timer = peer.node.create_timer(0.05, lambda: moved.publish(at))
    wait_for(lambda: page.number("x") == 1.0, "the odometry")
    assert page.number("linear-measured") == 0.25

    def pressed(selector: str) -> bool:
        return page.find(selector).get_attribute("aria-pressed") == "true"

    page.find("[data-tool=goal]").click()
    assert pressed("[data-tool=goal]") and pressed("[name=map]")
    robot = "#ground .robot:not(.absent)"
    wait_for(lambda: page.driver.find_elements(By.CSS_SELECTOR, robot), "the robot on the map")
    page.hold("#ground svg", 0, -50)
    assert goals == []
    page.act().send_keys(Keys.ESCAPE).perform()
    page.let_go()
    page.find("[data-tool=goal]").click()
    page.hold("#ground svg", 0, -50)
    page.let_go()
    wait_for(lambda: "Published /goal_pose" in page.text("#ground [role=status]"), "the goal")
    wait_for(lambda: goals, "its message")
    pose = goals[0].pose
    turn = pose.orientation
    assert len(goals) == 1 and goals[0].header.frame_id == "odom"
    assert yaw_of(turn.x, turn.y, turn.z, turn.w) == pytest.approx(math.pi / 2)
    assert not pressed("[data-tool=goal]") and pressed("[name=map]")

    page.devtools("Emulation.setTouchEmulationEnabled", enabled=True)
    page.find("[data-tool=point]").click()
    page.touch({0: ("#ground svg", 80)})
    page.end_touch()
    wait_for(lambda: points, "the point")
    assert (points[0].point.x, points[0].point.y) == pytest.approx((1.0, 1.0), abs=0.02)
    page.find("[data-tool=goal]").click()
    for name, words in {"x": "3", "y": "-0,5", "yaw": "180"}.items():
        page.enter(f"#ground [name={name}]", words)
    page.find("[name=publish]").click()
    wait_for(lambda: len(goals) == 2, "the place by numbers")
    pose = goals[1].pose
    assert (pose.position.x, pose.position.y) == (3.0, -0.5)
    assert pose.orientation.z == pytest.approx(1.0)
    peer.run(peer.node.destroy_timer, timer)


def test_displays_and_parameters_are_set_in_panels(ros_domain: int, alone: Peer, tab: Page) -> None:
    """By check boxes and fields; a refused value says why, and the old one stays."""
    alone.node.declare_parameter("speed", 0.5)
    alone.node.declare_parameter("lights", False)
    alone.node.add_on_set_parameters_callback(
        lambda them: SetParametersResult(successful=them[0].value != 9.0, reason="too fast")
    )
    with Peer(ros_domain, "rerun_viewer") as viewer, steering(topic="/cmd_vel") as node:
        settings = {"hidden": ["/other"], "shown": ["scan", "/map"], "grid.visible": True}
        for name, value in settings.items():
            viewer.node.declare_parameter(name, value)
        shown = [{"topic": "/scan", "type": "sensor_msgs/msg/LaserScan", "visible": True}]
        address = "http://127.0.0.1:9/?url=rerun%2Bhttp://127.0.0.1:9/proxy"
        for topic, text in (
            ("page", address),
            ("displays", json.dumps({"shown": shown, "legend": []})),
        ):
            to = viewer.publisher(String, f"/rerun_viewer/{topic}", LATCHED)
            to.publish(String(data=text))
        tab.open(node.address)

        def row(panel: str, name: str) -> Any:
            path = f"//*[@id='{panel}']//*[contains(@class, 'row')][label[text()='{name}']]"
            return wait_for(lambda: tab.driver.find_elements(By.XPATH, path), name)[0]

        def field(panel: str, name: str) -> Any:
            return row(panel, name).find_element(By.TAG_NAME, "input")

        def values(of: Peer, *names: str) -> list[Any]:
            return [of.node.get_parameter(name).value for name in names]

        tab.find("[name=displays]").click()
        assert field("displays", "/scan").is_selected()
        field("displays", "/scan").click()
        hidden = [["/other", "/scan"], ["/map"]]
        wait_for(lambda: values(viewer, "hidden", "shown") == hidden, "the topic to be hidden")
        field("displays", "grid").click()
        wait_for(lambda: values(viewer, "grid.visible") == [False], "the grid to be hidden")

        tab.find("[name=parameters]").click()
        field("parameters", "lights").click()
        wait_for(lambda: values(alone, "lights") == [True], "the lights")
        speed = field("parameters", "speed").get_attribute("id")
        tab.enter(f"#{speed}", "9")
        wait_for(lambda: "too fast" in row("parameters", "speed").text, "the reason")
        wait_for(lambda: tab.find(f"#{speed}").get_property("value") == "0.5", "the old value")
        tab.enter(f"#{speed}", "1.5")
        wait_for(lambda: values(alone, "speed") == [1.5], "the speed")
        tab.enter("#parameters-filter", "LIGHT")
        assert not row("parameters", "speed").is_displayed()
        assert row("parameters", "lights").is_displayed()


def test_it_shows_what_the_sensors_see(peer: Peer, page: Page) -> None:
    """The walls on the map, the camera, and an obstacle that is too near for braking.

    The camera is subscribed to while its picture is shown.
    """
    for name in ("linear.x.max_velocity", "linear.x.max_acceleration"):
        peer.node.declare_parameter(name, 0.5)
    camera, walls = "/camera/image_raw", [3.0, 0.2, 1.0, 2.0]  # m to the left, right, top, bottom
    right, top, left, bottom = (walls[side] for side in (1, 2, 0, 3))
    scan = LaserScan(angle_increment=math.pi / 2, range_max=9.0, ranges=[right, top, left, bottom])
    odometry, frame = Odometry(child_frame_id="base"), TransformStamped(child_frame_id="base")
    odometry.header.frame_id = frame.header.frame_id = "odom"
    scan.header.frame_id = "base"
    picture = Image(width=160, height=1, step=160, encoding="mono8", data=bytes(160))
    messages = {"/scan": scan, "/velocity_controller/odom": odometry, camera: picture}
    for topic, message in {
        "/tf_static": TFMessage(transforms=[frame]),
        "/robot_description": String(data=ROBOT),
    }.items():
        peer.node.create_publisher(type(message), topic, LATCHED).publish(message)
    publishers = {
        peer.node.create_publisher(type(message), topic, 1): message
        for topic, message in messages.items()
    }
    timer = peer.node.create_timer(0.05, lambda: [p.publish(m) for p, m in publishers.items()])

    # The page replaces the element with each picture: an element found once is soon stale.
    picture_shown = (
        "const i = document.querySelector('#camera img'); return [i.naturalWidth, i.alt]"
    )
    wait_for(lambda: page.driver.execute_script(picture_shown) == [160, camera], "a picture")
    page.driver.execute_script("document.querySelector('#camera').open = false")
    wait_for(lambda: not peer.node.count_subscribers(camera), "the camera to be left")

    page.find("[name=map]").click()
    for _ in range(2):  # all of it
        page.find("[name=farther]").click()
    wanted = pytest.approx(walls, abs=0.1)
    wait_for(lambda: page.driver.execute_script(WALLS) == wanted, "the walls")
    page.find("[name=map]").click()

    distance = page.find("#braking output")

    def redness() -> int:
        red, green, blue = re.findall(r"\d+", distance.value_of_css_property("color"))[:3]
        return int(red) - max(int(green), int(blue))

    wait_for(lambda: page.text("#braking output") == "0.25 m", "the braking distance")
    assert redness() < 30 and not page.text("#braking small")
    page.drive_by_keys("w", lambda: page.text("#braking small") == "obstacle at 0.10 m")
    wait_for(lambda: redness() > 60, "red")
    page.release_keys("w")
    peer.run(peer.node.destroy_timer, timer)


ROBOT = """<robot name="box"><link name="base">
  <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
</link></robot>"""
# The farthest dots to the left, right, top and bottom of the robot, m: at 80 pixels a meter; each
# press of a button is a factor of 1.5.
WALLS = """
const box = document.querySelector("#ground .scan").getBBox();
const { width, height } = document.querySelector("#ground svg").getBoundingClientRect();
const sides = [width / 2 - box.x, box.x + box.width - width / 2,
               height / 2 - box.y, box.y + box.height - height / 2];
return sides.map((pixels) => pixels * 1.5 ** 2 / 80);
"""


def test_a_second_finger_stops_and_all_that_is_held_stays_so(
    page: Page, tab: Page, node: Steering, heard: list[Twist]
) -> None:
    """On press; until it is lifted nothing drives, and then only what is pressed anew.

    On a phone; a touch that the system takes away stops the robot, too.
    """
    tab.devtools("Emulation.setTouchEmulationEnabled", enabled=True)
    tab.emulate(390, 844, mobile=True)
    tab.open(node.address)
    assert tab.driver.execute_script("return document.documentElement.scrollWidth") == 390
    tab.drive_by_finger(1, at(heard, 0.5, 0.0))
    tab.end_touch("touchCancel")
    wait_to_stop(tab, heard)
    tab.drive_by_finger(1, at(heard, 0.5, 0.0))
    tab.touch({1: ("#pad", 300), 2: ("#stop", 0)})
    wait_for_zero(tab, heard)
    with at_rest(tab, heard):
        tab.touch({1: ("#pad", 30), 2: ("#stop", 0)})
        tab.touch({2: ("#stop", 0)})
        for part, up in {"#pad": 30, "#linear input": 40, "#linear [name=plus]": 0}.items():
            tab.touch({2: ("#stop", 0), 3: (part, 0)})
            tab.touch({2: ("#stop", 0), 3: (part, up)})
            tab.touch({2: ("#stop", 0)})
        tab.touch({2: ("#stop", 0), 4: ("#pad", 0)})
        tab.touch({4: ("#pad", 0)})  # the stop is released, and this one was pressed before
        tab.touch({4: ("#pad", 300)})
    tab.end_touch()


@contextmanager
def at_rest(page: Page, heard: list[Twist]) -> Iterator[None]:
    """See that nothing moves the robot in the block, and for some states after it."""
    begin = len(heard)
    yield
    page.wait_for_states(5)
    assert [pair(m) for m in heard[begin:] if m != STILL] == []
    assert page.body("hand") == ""


def test_a_pressed_stop_keeps_the_robot_stopped(
    gamepad: None, page: Page, heard: list[Twist]
) -> None:
    """Before the mouse or the key is released; keys and gamepads wait for that."""
    for key in ("", Keys.ENTER, " "):
        page.drive_by_keys("w", at(heard, 0.5, 0.0))
        _press_stop(page, key)
        wait_for_zero(page, heard)
        with at_rest(page, heard):
            page.act().key_up("w").key_down("w").key_down(Keys.ARROW_LEFT).perform()
            page.stick(0, -1)
        with at_rest(page, heard):  # what was pressed meanwhile is not released yet
            page.act().key_up(key).perform() if key else page.let_go()
        page.stick()
        page.act().key_up("w").key_up(Keys.ARROW_LEFT).perform()


def _press_stop(page: Page, key: str) -> None:
    """With a key, or with the mouse, which goes on to the view."""
    if key:
        page.driver.execute_script("document.querySelector('#stop').focus()")
        page.act().key_down(key).perform()
    else:
        page.hold("#stop", 0, 0)
        page.drag(-600, 0)


def test_a_gamepad_drives(gamepad: None, page: Page, heard: list[Twist]) -> None:
    """Beyond its dead zone; unplugged, or stopped by its button, it stops the robot.

    One that is plugged in has to be at rest first: it may be another, with a lever without middle.
    """
    page.stick(0, 0.1)
    assert not heard
    page.drive_by_stick([0, -1], at(heard, 0.5, 0.0))
    assert page.body("hand") == "gamepad"
    page.stick(0, -1, stop=True)
    wait_for_zero(page, heard)
    with at_rest(page, heard):
        page.stick(0, -1, stop=False)
    page.stick()
    page.drive_by_stick([-1], at(heard, 0.0, 1.0))
    page.stick(-1, there=False)
    wait_to_stop(page, heard)
    for there, change in ((False, "disconnected"), (True, "connected")):
        page.stick(0, -1, there=there)
        page.driver.execute_script(
            f"const event = new Event('gamepad{change}');"
            "event.gamepad = { index: 0 }; window.dispatchEvent(event);"
        )
    with at_rest(page, heard):
        page.wait_for_states(3)
    page.drive_by_stick([0, -1], at(heard, 0.5, 0.0))
    page.stick()
    wait_to_stop(page, heard)
