"""The viewer's page in a real browser."""

import re
from pathlib import Path

import pytest
from std_msgs.msg import String

from onebot_bringup.serving import rerun_proxy
from tests.onebot_bringup.viewer_support import (
    ARM,
    BLUE,
    viewer_node,
)
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for
from tests.support_browser import SMALL, browser, hosts_reached, wait_for_color

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


REFRESH = 17.0  # ms
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
        # The browser times frames by the screen's refreshes, so that each may be off by one.
        least, most = (
            frame["real"] / max(1.0, 0.5 * (frame["before"] + refresh) / 10)
            for refresh in (REFRESH, -REFRESH)
        )
        assert 0.9 * least - 2.0 < frame["own"] < 1.1 * most + 2.0, frames


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
    """Pictures that Chromium takes the commands of ahead are old before they are seen.

    Those of a fine screen have 1.5 million pixels at most from the beginning.
    """
    script = Path(rerun_proxy.__file__).with_name("rerun_page.js")
    (tmp_path / "page.html").write_text(f"<body><script>{script.read_text()}</script>")
    with browser(tmp_path / "profile", webgl=True) as page:
        page.get((tmp_path / "page.html").as_uri())
        found = page.execute_async_script(PICTURES)
        screen = {"width": 1400, "height": 900, "deviceScaleFactor": 2.0, "mobile": False}
        page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        page.refresh()
        ratio = page.execute_script("return devicePixelRatio")
    assert 1400 * 900 * ratio**2 == pytest.approx(1.5e6, rel=0.01)
    assert found["early"] == 0 and 0.6 <= found["ratio"] < 1.0, found
    assert found["width"] == pytest.approx(found["ratio"], abs=0.01)
