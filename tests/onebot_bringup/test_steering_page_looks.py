"""How the steering page looks in a real browser: accessibility, layouts, colors, motion."""

import re
from collections.abc import Iterator
from importlib.resources import files

import pytest
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor

from onebot_description.ros.domains import used_domain
from tests.onebot_bringup.steering_support import PageClient, Steering, steering
from tests.ros_support import Peer
from tests.steering_browser_support import Page
from tests.support import wait_for

pytestmark = pytest.mark.slow

SCREENS = {
    "laptop": (1280, 657, False),
    "small phone": (360, 640, True),
}
STEERS = (
    "#pad", "#linear", "#angular", "#stop", "#braking", "#linear-limit", "#angular-limit",
    "#driver", "#connection", "#robot select",
)  # fmt: skip


@pytest.fixture(scope="module")
def node() -> Iterator[Steering]:
    with (
        used_domain() as domain,
        Peer(domain) as peer,
        steering(max_linear=0.5, max_angular=1.0) as node,
    ):
        for number in range(10, 12):  # there is a choice of robots
            peer.hear(Twist, f"/robot{number}/velocity_controller/cmd_vel")
        fine = FloatingPointRange(from_value=0.0, to_value=2.0)
        about = ParameterDescriptor(description="m/s", floating_point_range=[fine])
        peer.node.declare_parameter("speed", 0.5, about)
        yield node


@pytest.fixture
def page(node: Steering, chromium: Page) -> Iterator[Page]:
    yield chromium.open(node.address)
    chromium.act().key_up("w").perform()
    chromium.emulate_nothing()


# What is seen now and then: a message, the notes on a view that loads and lags, and on lost keys.
WARN = """
document.querySelector("#message").textContent = "Something to look at.";
document.querySelector("#slow").hidden = false;
document.querySelector("#view").classList.replace("empty", "loading");
document.body.classList.add("keys-away");
"""

# Every rule, the experimental ones too, but for those of level AAA: a contrast of 7 to 1.
# Of the page as it is painted: the map is drawn anew by a frame in which its size has changed.
AXE = """
const painted = () => new Promise(requestAnimationFrame);
const rules = axe.getRules().filter((rule) => !rule.tags.includes("wcag2aaa"));
const enabled = Object.fromEntries(rules.map((rule) => [rule.ruleId, { enabled: true }]));
const options = { rules: enabled, resultTypes: ["violations", "incomplete"] };
return painted().then(painted).then(() => axe.run(document, options));
"""


def words(html: str) -> list[str]:
    """The words that an element shows; arrows are none."""
    return re.findall(r"\w\w+", re.sub("<[^>]*>", "", html))


def findings(page: Page) -> list[str]:
    """What axe-core finds wrong, and contrasts of words that it could not measure."""
    page.driver.execute_script((files("axe_playwright_python") / "axe.min.js").read_text())
    found = page.driver.execute_script(AXE)
    return [
        f"{rule['id']}: {spot['html'][:120]} {spot['failureSummary']}"
        for rule in [*found["violations"], *found["incomplete"]]
        for spot in rule["nodes"]
        if rule in found["violations"] or (rule["id"] == "color-contrast" and words(spot["html"]))
    ]


@pytest.mark.parametrize(("screen", "scheme"), [("laptop", "light"), ("small phone", "dark")])
def test_axe_finds_nothing(node: Steering, page: Page, screen: str, scheme: str) -> None:
    """At rest, its map and panel; while it drives, a limit refused; while another page drives."""
    page.emulate(*SCREENS[screen], prefers_color_scheme=scheme)
    assert (sum(channels(style(page, "aside", "backgroundColor"))) > 400) == (scheme == "light")
    found = {"at rest": findings(page)}
    page.find("[data-tool=goal]").click()
    found["map"] = findings(page)
    page.find("[name=map]").click()
    page.find("[name=parameters]").click()
    wait_for(lambda: "m/s" in page.text("#parameters .rows"), "the parameters")
    found["parameters"] = findings(page)
    page.find("[name=parameters]").click()
    page.driver.execute_script(WARN)
    page.enter("#linear-limit", "fast")
    page.act().key_down("w").perform()
    wait_for(lambda: page.body("driver") == "you", "this page to drive")
    assert "rejected" in page.text("#linear-hint")
    found["driving"] = findings(page)
    page.act().key_up("w").perform()
    with PageClient(node.address) as other:
        other.hold(0.3)
        wait_for(lambda: page.body("driver") == "other", "the other page to drive")
        found["driven"] = findings(page)
    assert found == dict.fromkeys(found, [])


# Whether each element is on the screen as a whole, and is what is seen at its middle and edges.
IN_SIGHT = """
return Object.fromEntries(arguments[0].map((selector) => {
  const element = document.querySelector(selector);
  const { left, top, right, bottom } = element.getBoundingClientRect();
  const [x, y] = [(left + right) / 2, (top + bottom) / 2];
  const points = [[x, y], [left + 2, y], [right - 2, y], [x, top + 2], [x, bottom - 2]];
  const inside = left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
  const seen = points.every((point) => element.contains(document.elementFromPoint(...point)));
  return [selector, inside && seen || { left, top, right, bottom, inside, seen }];
}));
"""


# Notes and messages have a place outside of the frame, which is still to be seen.
COVERED = """
const view = document.createElement("iframe");
document.querySelector("#view").append(view);
const { left, top, right, bottom } = view.getBoundingClientRect();
return ["#slow", "#message", "#readout"].filter((selector) => {
  const box = document.querySelector(selector).getBoundingClientRect();
  const apart = box.left >= right || box.right <= left || box.top >= bottom || box.bottom <= top;
  return !apart || box.height === 0 || bottom - top < 40;
});
"""


@pytest.mark.parametrize("screen", SCREENS)
def test_what_steers_is_in_sight_without_scrolling(page: Page, screen: str) -> None:
    """All of it, at sizes that a finger meets, and beside the robot's view."""
    page.emulate(*SCREENS[screen])
    page.wait_for_states(1)
    assert page.driver.execute_script(IN_SIGHT, STEERS) == dict.fromkeys(STEERS, True)
    for selector in ("aside", "body", "html"):
        script = (
            "const e = document.querySelector(arguments[0]);"
            "return [e.scrollWidth - e.clientWidth, e.scrollHeight - e.clientHeight]"
        )
        assert page.driver.execute_script(script, selector) == [0, 0], f"{selector} scrolls"
    for selector, size in {"#pad": 120, "#stop": 52, "#view": 150}.items():
        assert min(page.find(selector).size.values()) >= size
    for selector in ("#linear input", "#angular input"):
        assert max(page.find(selector).size.values()) >= 60
    page.driver.execute_script(WARN)
    assert page.driver.execute_script(COVERED) == []


def style(page: Page, selector: str, name: str, pseudo: str | None = None) -> str:
    """One of an element's computed styles."""
    return str(
        page.driver.execute_script(
            "return getComputedStyle(document.querySelector(arguments[0]), arguments[2])"
            "[arguments[1]]",
            selector, name, pseudo,
        )
    )  # fmt: skip


def channels(color: str) -> list[float]:
    """Red, green and blue, 0 to 255, and alpha where there is one."""
    return [float(number) for number in re.findall(r"[\d.]+", color)]


def test_forced_colors_keep_what_is_told_by_color(page: Page) -> None:
    """Backgrounds are gone: there are borders, and what is drawn keeps two colors."""
    page.emulate(1280, 657, forced_colors="active")
    page.driver.execute_script(WARN)
    page.act().key_down("w").perform()
    wait_for(lambda: page.body("driver") == "you", "this page to drive")
    assert page.text("#driver") == "You drive" and page.text("#connection") == "Connected"
    bounded = ("#stop", ".axis button", "#topic-name", "#driver", "#connection", "#message", ".bar")
    for selector in bounded:
        assert style(page, selector, "borderTopStyle") == "solid", selector
        assert style(page, selector, "borderTopWidth") != "0px", selector
    ground = style(page, ".bar", "backgroundColor")
    fill = style(page, ".bar", "backgroundColor", "::before")
    tick = style(page, ".bar", "backgroundColor", "::after")
    assert len({ground, fill, tick}) == 3
    assert style(page, "#pad .rim", "stroke") != style(page, "#pad .rim", "fill")


MOVING = """
const moving = (element) =>
  getComputedStyle(element).transitionDuration.split(", ").some((time) => time !== "0s") ||
  getComputedStyle(element).animationName !== "none";
return [...document.querySelectorAll("*")].filter(moving).map((element) => element.className);
"""


def test_reduced_motion_moves_nothing_by_itself(page: Page) -> None:
    """No transition and no animation, of the joystick's thumb neither."""
    page.act().key_down("w").perform()
    wait_for(lambda: "led" in page.find("#pad").get_attribute("class"), "the thumb to show it")
    page.emulate(1280, 657, prefers_reduced_motion="no-preference")
    assert page.driver.execute_script(MOVING) != []
    page.emulate(1280, 657, prefers_reduced_motion="reduce")
    assert page.driver.execute_script(MOVING) == []
    page.act().key_up("w").perform()
