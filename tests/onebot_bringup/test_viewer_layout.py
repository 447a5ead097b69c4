"""Another view of a robot that is on show, and layouts arranged and saved in the viewer."""

from pathlib import Path

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from onebot_bringup.viewer.display_server import WebPage, open_recording
from onebot_bringup.viewer.pictures import headless_viewer, still
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import ViewConfig, parse_view
from tests.onebot_bringup.drive_support import column, odometry
from tests.onebot_bringup.viewer_support import (
    ARM,
    BLUE,
    START_NS,
    describe,
    take_joints,
    take_odometry,
    take_tf,
    transforms,
)
from tests.support import wait_for
from tests.support_browser import DRAWING_PATIENCE, SMALL, browser, screenshot
from tests.support_rendering import colored, pixels, require_renderer

GREEN, MAGENTA = (0, 220, 60), (230, 20, 200)
VIEW = """
fixed_frame: odom
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 2.0, 8.0], target: [0.0, 2.0, 0.0]}
joint_plot: {positions: false, velocities: false}
trails:
  a: {topic: odom, color: [0, 220, 60], width: 0.2, height: 1.0}
"""


def _drive(live: RobotView, start: int, steps: int = 20) -> None:
    for step in range(start, start + steps):
        stamp, y = START_NS + step * 10**8, 0.1 * step
        take_tf(live, transforms("base", "tip", 0.5, stamp))
        take_tf(live, transforms("odom", "base", y, stamp))
        take_odometry(live, "odom", stamp, odometry(1, y))
        live.tick(stamp)


@pytest.mark.slow
def test_another_view_takes_effect_on_what_is_on_show(tmp_path):
    """A trail in another colour, whole; then none at all, without an error; then axes."""
    require_renderer()
    recording = open_recording(0)
    live = RobotView(recording.stream, parse_view(VIEW))
    describe(live, ARM)
    _drive(live, 0)
    with headless_viewer(recording.uri, 640, 480) as client:

        def sees(*, green: bool, magenta: bool) -> bool:
            image = pixels(still(client))
            found = [colored(image, color).mean() > 0.002 for color in (GREEN, MAGENTA)]
            return found == [green, magenta] and colored(image, BLUE).any()

        wait_for(lambda: sees(green=True, magenta=False), "the trail")
        live.set_view(parse_view(VIEW.replace("[0, 220, 60]", "[230, 20, 200]")))
        _drive(live, 20)
        wait_for(lambda: sees(green=False, magenta=True), "its new colour")
        live.set_view(parse_view(VIEW.partition("trails")[0]))
        _drive(live, 40)
        wait_for(lambda: sees(green=False, magenta=False), "no trail")
        live.set_view(parse_view(VIEW.replace("  a:", "  b:") + "collision: true"))
        _drive(live, 60)
        wait_for(lambda: colored(pixels(still(client)), GREEN).any(), "a trail of another name")
        assert [view.reports for view in client.get_state().views] == [[]]
    recording.close()


@pytest.mark.slow
def test_the_same_view_again_leaves_the_user_s_layout_alone(tmp_path):
    """Nothing is sent unless something changed: what was arranged in the viewer stays."""
    require_renderer()
    recording = open_recording(0)
    live = RobotView(recording.stream, parse_view(VIEW))
    describe(live, ARM)
    _drive(live, 0)
    with headless_viewer(recording.uri, 640, 480) as client:
        before = client.get_blueprint().blueprint_id
        live.set_view(parse_view(VIEW))
        _drive(live, 20)
        recording.stream.flush(timeout_sec=5.0)
        still(client)
        assert client.get_blueprint().blueprint_id == before
    recording.close()


@pytest.mark.slow
def test_a_layout_arranged_and_saved_in_the_page_is_shown_again(tmp_path):
    """In Chromium: open the list of views, save the layout, download it, load it: the same."""
    require_renderer()
    recording = open_recording(0)
    page = WebPage(0, recording.uri, recording.server)
    live = RobotView(recording.stream, ViewConfig())
    describe(live, ARM)
    for step in range(30):
        stamp = START_NS + step * 10**8
        take_tf(live, transforms("base", "tip", 0.5, stamp))
        take_joints(live, stamp, ("slide",), np.array([0.5]), np.empty(0))
        live.tick(stamp)
    recording.stream.flush(timeout_sec=5.0)
    try:
        wait_for(lambda: page.ready, "the page")
        file = _saved_in_page(page.url, tmp_path)
        with headless_viewer(recording.uri, 1280, 720) as client:
            ours = client.get_blueprint().blueprint
            assert "Collapsed" in str(ours["/blueprint_panel"])
            live.use_blueprint(file)
            wait_for(
                lambda: "Expanded" in str(client.get_blueprint().blueprint["/blueprint_panel"]),
                "the layout",
            )
            theirs = client.get_blueprint().blueprint
            views = {view.name for view in client.get_state().views}
            assert views == {"Robot", "Joint positions (rad, m)"}
            for path, part in ours.items():
                if path.startswith(("/view/", "/container/")):
                    assert theirs[path] == part, path
            live.use_blueprint(None)
            live.tick(stamp)
            wait_for(
                lambda: "Collapsed" in str(client.get_blueprint().blueprint["/blueprint_panel"]),
                "our own layout again",
            )
    finally:
        page.stop()
        recording.close()


def _saved_in_page(url: str, folder: Path) -> Path:
    """Open the viewer's list of views, and save the layout by the viewer's own command."""
    with browser(folder / "profile", SMALL) as chromium:
        chromium.execute_cdp_cmd(
            "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)}
        )
        chromium.get(url)

        def left_edge() -> float:
            mask = colored(pixels(screenshot(chromium)), BLUE)
            return float(np.nonzero(mask)[1].min()) if mask.sum() > 2000 else 0.0

        left = wait_for(left_edge, "the base in the picture", DRAWING_PATIENCE)
        chromium.find_element(By.TAG_NAME, "canvas").click()
        control, shift = Keys.CONTROL, Keys.SHIFT
        keys = ActionChains(chromium).key_down(control).key_down(shift).send_keys("b")
        keys.key_up(shift).key_up(control).perform()
        wait_for(
            lambda: left_edge() > left + 50,
            "the list, which moves the robot aside",
            DRAWING_PATIENCE,
        )
        palette = ActionChains(chromium).key_down(control).send_keys("p").key_up(control)
        _act(chromium, palette)
        _act(chromium, ActionChains(chromium).send_keys("save blueprint"))
        ActionChains(chromium).send_keys(Keys.ENTER).perform()
        found = wait_for(lambda: chromium.find_elements(By.ID, "rfd-output"), "the link to it")
        found[0].click()
        return wait_for(lambda: next(folder.glob("*.rbl"), None), "the file")


# Rerun handles input once a frame.
_FRAMES = """
let [frames, done] = arguments;
(function count() { frames-- > 0 ? requestAnimationFrame(count) : done(); })();
"""


def _act(chromium: webdriver.Chrome, action: ActionChains) -> None:
    """Press keys, and wait until Rerun has handled them: what follows may be for what they open."""
    action.perform()
    chromium.execute_async_script(_FRAMES, 4)


def _sent(live: RobotView, sent: list, view: str, start: int) -> int:
    """How many layouts are sent for a view."""
    live.set_view(parse_view(view))
    before = len(sent)
    _drive(live, start)
    return len(sent) - before


def test_only_what_is_in_a_layout_sends_another(tmp_path, monkeypatch):
    """Colours, lengths and topics do not: a camera turned by hand stays."""
    recording = open_recording(save=tmp_path / "x.rrd")
    sent: list[object] = []
    monkeypatch.setattr(recording.stream, "send_blueprint", lambda item, **_: sent.append(item))
    view = VIEW + "joint_ranges: {visible: true}\nspeeds: {lines: {v: {topic: odom}}}\n"
    live = RobotView(recording.stream, parse_view(view))
    describe(live, ARM)
    _drive(live, 0)
    assert len(sent) == 1
    for number, (old, new) in enumerate(
        [
            ("[0, 220, 60]", "[230, 20, 200]"),
            ("width: 0.2, height: 1.0", "width: 0.1"),
            ("axes: {visible: false}", "axes: {visible: false, length: 0.3, names: false}"),
            ("joint_ranges: {visible: true}", "joint_ranges: {visible: true, radius: 0.5}"),
            ("v: {topic: odom}", "v: {topic: odom, type: Odometry, color: [1, 2, 3]}"),
            ("velocities: false}", "velocities: false, limits: true}"),
            ("fixed_frame: odom", ""),
        ]
    ):
        assert old in view
        assert _sent(live, sent, view.replace(old, new), 20 * (2 * number + 1)) == 0, new
        assert _sent(live, sent, view, 20 * (2 * number + 2)) == 0, new
    for number, (old, new) in enumerate(
        [
            ("grid: {visible: false}", "grid: {visible: true}"),
            ("fixed_frame: odom", "fixed_frame: base"),
            ("  a:", "  b:"),
            ("height: 1.0", "height: 1.0, length: 5.0"),
            ("v: {topic", "w: {topic"),
            ("axes: {visible: false}", "axes: {visible: true}"),
        ]
    ):
        view = view.replace(old, new)
        assert _sent(live, sent, view, 20 * (20 + number)) == 1, new
    recording.close()


def test_axes_change_their_length_without_another_layout(tmp_path):
    """Longer by a parameter, and of a fitting length again."""
    recording = open_recording(save=tmp_path / "x.rrd")
    live = RobotView(recording.stream, parse_view(VIEW))
    describe(live, ARM)
    _drive(live, 0)
    for start, length in ((20, ", length: 0.7"), (40, "")):
        live.set_view(
            parse_view(VIEW.replace("axes: {visible: false", "axes: {visible: false" + length))
        )
        _drive(live, start)
    recording.close()
    [first, fitting, longer, again] = column(
        tmp_path / "x.rrd", "/frames/tip", "TransformAxes3D:axis_length"
    )
    assert longer == [np.float32(0.7)] and again == fitting != longer != first
