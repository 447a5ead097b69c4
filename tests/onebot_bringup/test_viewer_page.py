"""The viewer's page in a real browser."""

import re
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import rerun as rr
from selenium.webdriver import Chrome
from std_msgs.msg import String

from onebot_bringup.serving import rerun_proxy
from onebot_bringup.viewer.display_server import WebPage, open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import load_view
from onebot_description.description import load_description
from onebot_description.description.packages import package_share
from onebot_description.model.robot_model import RobotModel
from onebot_description.ros.wire.messages import OdometrySample, TfArrays
from tests.onebot_bringup.viewer_support import (
    ARM,
    BLUE,
    describe,
    take_command,
    take_joints,
    take_odometry,
    take_tf,
    viewer_node,
)
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for
from tests.support_browser import DRAWING_PATIENCE, SMALL, browser, hosts_reached, wait_for_color

pytestmark = pytest.mark.slow


def test_page_shows_the_robot_and_stays_on_this_machine(ros_domain, tmp_path):
    """The address it prints opens a page with the robot in its colour, and asks no other host."""
    with (
        viewer_node(tmp_path, viewer="web") as node,
        Peer(ros_domain) as peer,
        browser(tmp_path / "profile", SMALL, webgl=True) as page,
    ):
        peer.publisher(String, "robot_description", LATCHED).publish(String(data=ARM))
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        address = wait_for(
            lambda: re.search(r"open (http://127\.0\.0\.1:\d+)", node.output), "the address"
        )
        page.get(address[1])
        wait_for_color(page, BLUE, 2000)
        assert hosts_reached(page) == {"127.0.0.1"}


# Three frames of 300 ms each and then one as fast as the browser can: of each, how long the one
# before took and how long its own clock and the real one say that 50 ms are; and whether the clock
# ever went back.
FRAMES = """
const done = arguments[0], found = [];
let before = null, last = performance.now(), backward = false;
function clock() {
  const now = performance.now();
  backward ||= now < last;
  return (last = now);
}
function spin(ms) {
  const start = Date.now();
  while (Date.now() < start + ms) clock();
  return Date.now() - start;
}
function frame(time) {
  const start = clock(), real = spin(50), own = clock() - start;
  if (before !== null) found.push({before: time - before, real, own});
  before = time;
  if (found.length < 3) spin(250);
  if (found.length < 6) requestAnimationFrame(frame);
  else setTimeout(() => { clock(); done({found, backward}); });
}
requestAnimationFrame(frame);
"""


def test_rerun_reads_for_up_to_half_of_a_slow_frame(tmp_path):
    """Its clock, by which it reads for 10 ms, is slower there; it is right in fast frames."""
    script = Path(rerun_proxy.__file__).with_name("rerun_page.js")
    (tmp_path / "page.html").write_text(f"<script>{script.read_text()}</script>")
    with browser(tmp_path / "profile") as page:
        page.get((tmp_path / "page.html").as_uri())
        measured = page.execute_async_script(FRAMES)
    frames = measured["found"]
    assert not measured["backward"]
    assert max(frame["before"] for frame in frames) >= 300
    for frame in frames:
        slower = max(1.0, 0.5 * frame["before"] / 10)
        assert frame["own"] == pytest.approx(frame["real"] / slower, rel=0.1, abs=2.0), frames


# Pictures that take the longer the more pixels they have, as much longer with each until the canvas
# gets fewer. Of each is found whether the one before was drawn when it began.
PICTURES = """
const done = arguments[0], canvas = document.body.appendChild(document.createElement("canvas"));
canvas.style = "width: 600px; height: 400px";
new ResizeObserver(([entry]) => {
  canvas.width = entry.contentRect.width * devicePixelRatio;
  canvas.height = entry.contentRect.height * devicePixelRatio;
}).observe(canvas);
const gl = canvas.getContext("webgl2"), program = gl.createProgram();
function add(kind, text) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, `#version 300 es
precision highp float;
${text}`);
  gl.compileShader(shader);
  gl.attachShader(program, shader);
}
add(gl.VERTEX_SHADER, `void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`);
add(gl.FRAGMENT_SHADER, `uniform int steps; out vec4 color;
void main() {
  float x = gl_FragCoord.x;
  for (int i = 0; i < steps; i++) x = sin(x) + gl_FragCoord.y;
  color = vec4(x);
}`);
gl.linkProgram(program);
gl.useProgram(program);
let steps = 100, pictures = 0, early = 0, before = null;
const start = 600 * devicePixelRatio;
function draw() {
  if (before && gl.getSyncParameter(before, gl.SYNC_STATUS) !== gl.SIGNALED) early++;
  if (pictures && canvas.width < start || early) {
    return done({pictures, early, width: canvas.width / start, ratio: devicePixelRatio});
  }
  requestAnimationFrame(draw);
  if (canvas.width < start) return; // its size was not observed yet
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.uniform1i(gl.getUniformLocation(program, "steps"), steps = Math.min(1.2 * steps, 1e6));
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  before = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  pictures++;
}
requestAnimationFrame(draw);
"""


def test_a_picture_begins_when_the_one_before_is_drawn_and_slow_ones_get_fewer_pixels(tmp_path):
    """Pictures that Chromium takes the commands of ahead are old before they are seen."""
    script = Path(rerun_proxy.__file__).with_name("rerun_page.js")
    (tmp_path / "page.html").write_text(f"<body><script>{script.read_text()}</script>")
    with browser(tmp_path / "profile", webgl=True) as page:
        page.get((tmp_path / "page.html").as_uri())
        found = page.execute_async_script(PICTURES)
    assert found["early"] == 0 and 0.6 <= found["ratio"] < 1.0, found
    assert found["width"] == pytest.approx(found["ratio"], abs=0.01)


class Progress(NamedTuple):
    """How far a page is."""

    end: float  # the last time that it has read, s
    reads: int  # frames in which it has read


class ShownView:
    """How far Rerun's page has read what was logged, and in how many of its frames."""

    # The range of its timeline is in its state: nanoseconds as varints, the end is the largest.
    _COUNT = """
    function end(bytes) {
      let latest = 0, run = 0;
      for (let at = 0; at < bytes.length; at++) {
        const byte = bytes[at];
        if (byte < 128 && run >= 8) {
          let value = byte;
          for (let i = 1; i <= 8; i++) value = value * 128 + (bytes[at - i] & 127);
          const seconds = value / 1e9;
          if (Math.abs(seconds - Date.now() / 1000) < 3600) latest = Math.max(latest, seconds);
        }
        run = byte < 128 ? 0 : run + 1;
      }
      return latest;
    }
    window.reads = window.end = 0;
    requestAnimationFrame(function count() {
      const now = end(window._handle?.viewer_state() ?? []);
      if (now > window.end) window.reads++;
      window.end = now;
      requestAnimationFrame(count);
    });
    """

    def __init__(self, page: Chrome) -> None:
        self._page = page
        page.execute_script(self._COUNT)

    def progress(self) -> Progress:
        """How far it is."""
        return Progress(*self._page.execute_script("return [window.end, window.reads]"))


def _use_fine_screen(page: Chrome, width: int, height: int) -> None:
    """Make the page so large, in CSS pixels of two by two of the screen's."""
    screen = {"width": width, "height": height, "deviceScaleFactor": 2.0, "mobile": False}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)


def _pixels(page: Chrome) -> tuple[int, int]:
    """Width and height of Rerun's picture."""
    canvas = page.find_element("css selector", "canvas")
    return int(canvas.get_property("width")), int(canvas.get_property("height"))


_DRIVE = 30.0  # s
_READS = 10  # frames; it takes 2, and 35 where each reads for 10 ms only


class DrivingRobot:
    """OneBot on a circle, logged as the viewer's node does."""

    _STATE = 20_000_000  # ns
    _STATES_PER_TICK = 3

    def __init__(self, recording: rr.RecordingStream, start_ns: int) -> None:
        share = package_share("onebot_description")
        description = load_description(share / "urdf" / "onebot.urdf.xacro")
        self._view = RobotView(recording, load_view(share / "config" / "view.yaml"), live=True)
        describe(self._view, description.urdf)
        joints = description.joints
        self._names = [joint.name for joint in joints if joint.kind != "fixed"]
        self._parents = ["odom", *(joint.parent for joint in joints)]
        self._children = ["base_link", *(joint.child for joint in joints)]
        model = RobotModel.from_description(description)
        self._links = model.transforms(np.zeros(len(self._names)))
        self._start_ns, self._step = start_ns, 0
        self.drive(0.0)

    def drive(self, seconds: float) -> float:
        """Drive on; the time of the last state, s."""
        for _ in range(max(1, round(seconds * 1e9 / self._STATE / self._STATES_PER_TICK))):
            for _ in range(self._STATES_PER_TICK):
                stamp_ns = self._move()
            self._view.tick(stamp_ns)
        return stamp_ns * 1e-9

    def _move(self) -> int:
        stamp_ns, yaw = self._start_ns + self._step * self._STATE, 0.01 * self._step
        self._step += 1
        translations, rotations = self._links
        place = np.array([0.6 * np.sin(yaw), 0.6 * (1 - np.cos(yaw)), 0.0])
        turn = np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
        places, turns = np.vstack([place, translations]), np.vstack([turn, rotations])
        stamps = np.full(len(self._children), stamp_ns)
        take_tf(self._view, TfArrays(self._parents, self._children, stamps, places, turns))
        positions = [10.0 * yaw] * len(self._names)
        take_joints(self._view, stamp_ns, self._names, positions, positions)
        speed, turning = np.array([0.3, 0.0, 0.0]), np.array([0.0, 0.0, 0.5])
        sample = OdometrySample(stamp_ns, "odom", "base_link", place, turn, speed, turning)
        take_odometry(self._view, "velocity_controller/odom", stamp_ns, sample)
        take_command(self._view, "velocity_controller/cmd_vel", stamp_ns, 0.3, 0.5)
        return stamp_ns


def _wait_for_pixels(page: Chrome, width: int, height: int) -> None:
    """Wait for a picture of these proportions, in 1.5 million pixels at most."""

    def fits() -> bool:
        found = _pixels(page)
        return found[0] / found[1] == pytest.approx(width / height, rel=0.01) and (
            found[0] * found[1] <= 1.51e6
        )

    wait_for(fits, f"a picture of {width} by {height}", DRAWING_PATIENCE)


def test_the_page_keeps_up_with_a_driving_robot_where_it_draws_in_software(tmp_path):
    """A few of its frames read all that a robot sends in half a minute, however slow they are.

    The screen is a fine one: the picture has fewer pixels, 1.5 million in all.
    """
    recording = open_recording(0)
    host = WebPage(0, recording.uri, recording.server)
    try:
        robot = DrivingRobot(recording.stream, time.time_ns() - round(_DRIVE * 1e9))
        wait_for(lambda: host.ready, "the page")
        with browser(tmp_path / "profile", webgl=True) as page:
            _use_fine_screen(page, 1000, 700)
            page.get(host.url)
            view = ShownView(page)
            wait_for(lambda: view.progress().reads, "data in the page", DRAWING_PATIENCE)
            _wait_for_pixels(page, 1000, 700)
            _use_fine_screen(page, 1400, 900)
            _wait_for_pixels(page, 1400, 900)
            last = robot.drive(_DRIVE)
            recording.stream.flush()
            most = view.progress().reads + _READS

            def read_all() -> Progress | None:
                now = view.progress()
                return now if now.end > last - 0.001 or now.reads > most else None

            assert wait_for(read_all, "the end of the drive", DRAWING_PATIENCE).reads <= most
    finally:
        host.stop()
        recording.close()
