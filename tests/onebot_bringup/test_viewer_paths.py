"""Planned paths: what is in the file, and what Rerun and the node show of them."""

import json

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import String

from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup.drive_support import chunks, column, frames, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    stamped,
    take,
    take_tf,
    transforms,
    viewer_node,
)
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

SECOND = 10**9
# From behind and above: +y is to the left in the picture, +x up.
VIEW = """
fixed_frame: base
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 0.0, 8.0], target: [0.0, 0.0, 0.0]}
joint_plot: {positions: false, velocities: false}
path: {color: [0, 220, 60], line_width: 0.1, height: 0.5}
"""
PATH = "nav_msgs/msg/Path"
OFFERED = {"/plan": PATH, "/other/plan": PATH}


def path(points, frame="base", stamp_ns=START_NS) -> Path:
    """A path through (x, y, z) places."""
    message = stamped(Path(), stamp_ns, frame)
    for x, y, z in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, z
        message.poses.append(pose)
    return message


LINE = [(float(x), -1.0, 0.0) for x in range(-2, 3)]


def _begun(tmp_path, view=VIEW, **options):
    """A view with a robot and two topics of paths, and what ends it."""
    shown = Shown(tmp_path, view, **options)
    assert shown.view.offer(OFFERED) == []
    return shown.view, shown.end


def _lines(file, name="plan"):
    """The line of each row, (N, 3); None for none."""
    rows = column(file, f"/path/{name}", "LineStrips3D:strips")
    return [np.array(row[0]) if row else None for row in rows]


def test_a_path_is_drawn_while_simulated_time_stands_still(tmp_path):
    """As when the simulation is paused: paths are drawn some times a second of whatever clock."""
    now = [0.0]
    live, end = _begun(tmp_path, clock=lambda: now[0], live=True)
    live.tick(START_NS)
    take(live, "/plan", path(LINE))
    for _ in range(10):
        now[0] += 0.05
        live.tick(START_NS)
    assert len(_lines(end())) == 1


def test_a_new_topic_does_not_recolor_the_others(tmp_path):
    """Each keeps its color, whatever the names."""
    live, end = _begun(tmp_path, "")
    for offered in ({"/plan": PATH}, {**OFFERED, "/a": PATH}):
        live.offer(offered)
        for topic in offered:
            take(live, topic, path(LINE))
        live.tick(START_NS)
    file = end()
    colors = [column(file, f"/path{topic}", "LineStrips3D:colors") for topic in ("/plan", "/a")]
    assert len(colors[0]) == 1 and colors[0] != colors[1]


def test_a_path_is_a_line_at_its_own_time(tmp_path):
    """Through its poses, in its frame, as the settings draw it; another replaces it."""
    live, end = _begun(tmp_path)
    take(live, "/plan", path(LINE))
    take(live, "/other/plan", path(LINE[:2], "tip", START_NS + 5))
    live.tick(START_NS)
    take(live, "/plan", path(LINE[1:], stamp_ns=START_NS + SECOND))
    live.tick(START_NS + SECOND)
    file = end()
    first, second = _lines(file)
    np.testing.assert_allclose(first, np.array(LINE) + [0, 0, 0.5])
    np.testing.assert_allclose(second, np.array(LINE[1:]) + [0, 0, 0.5])
    assert len(_lines(file, "other/plan")[0]) == 2
    assert stamps(file, "/path/plan") == [START_NS, START_NS + SECOND]
    assert frames(file, "/path/plan") == ["base"]
    assert frames(file, "/path/other/plan") == ["tip"]
    assert column(file, "/path/plan", "LineStrips3D:colors") == [[0x00DC3CFF]]
    [[radius]] = column(file, "/path/plan", "LineStrips3D:radii")
    assert radius == pytest.approx(0.05)


def test_an_empty_path_clears_the_line(tmp_path):
    """Also one without a frame; one before any other draws nothing."""
    live, end = _begun(tmp_path)
    take(live, "/other/plan", path([], frame=""))
    sent = [(LINE, "base"), ([], "base"), (LINE, "base"), ([], "")]
    for at, (points, frame) in enumerate(sent):
        take(live, "/plan", path(points, frame, START_NS + at))
    file = end()
    assert [line is None for line in _lines(file)] == [False, True, False, True]
    assert chunks(file, "/path/other/plan") == []


def test_settings_take_effect_at_once(tmp_path):
    """The last path is drawn in another color, also one that waits for its frame."""
    live, end = _begun(tmp_path)
    take(live, "/plan", path(LINE))
    take(live, "/other/plan", path(LINE[1:], "map"))
    live.tick(START_NS)
    live.set_view(parse_view(VIEW.replace("[0, 220, 60]", "[1, 2, 3]")))
    take_tf(live, transforms("map", "base", 0.0), static=True)
    file = end()
    assert len(_lines(file)) == 2 and len(_lines(file, "other/plan")) == 1
    colors = column(file, "/path/plan", "LineStrips3D:colors")
    assert colors == [[0x00DC3CFF], [0x010203FF]]


def test_a_topic_has_a_look_of_its_own(tmp_path):
    """By its name as any in a view, relative to the namespace."""
    view = VIEW.replace("height: 0.5", "topics: {plan: {color: [1, 2, 3], height: 1.0}}")
    live, end = _begun(tmp_path, view, resolve=lambda name: f"/{name.lstrip('/')}")
    for name in OFFERED:
        take(live, name, path(LINE))
    file = end()
    assert column(file, "/path/plan", "LineStrips3D:colors") == [[0x010203FF]]
    assert column(file, "/path/other/plan", "LineStrips3D:colors") == [[0x00DC3CFF]]
    assert [_lines(file, name)[0][0, 2] for name in ("plan", "other/plan")] == [1.0, 0.0]


@pytest.mark.parametrize("change", ["hidden: [/plan]", "path: {visible: false}", ""])
def test_a_hidden_path_is_erased_and_no_longer_subscribed(tmp_path, change):
    """By its name, with all of its kind, or where its publisher has gone."""
    live, end = _begun(tmp_path, "")
    take(live, "/plan", path(LINE))
    live.tick(START_NS)
    live.set_view(parse_view(change))
    live.offer({name: PATH for name in OFFERED if change or name != "/plan"})
    assert "/plan" not in live.topics and not live.wants("/plan", PATH)
    shown = {each.topic: each.visible for each in live.offered}
    assert shown.get("/plan", False) is False
    assert column(end(), "/path/plan", "Clear:is_recursive")


def test_the_viewer_shows_a_path_that_is_published(ros_domain, tmp_path):
    """Also one that was latched before the viewer has subscribed, until a parameter hides it."""
    with Peer(ros_domain) as peer:
        plan = peer.node.create_publisher(Path, "plan", 10)
        peer.node.create_publisher(Path, "latched", LATCHED).publish(path(LINE, "odom"))
        with viewer_node(tmp_path, "") as node:
            displays = peer.hear(String, "/rerun_viewer/displays", LATCHED)

            def shown(topic, visible):
                offered = {"topic": topic, "type": PATH, "visible": visible}
                return bool(displays) and offered in json.loads(displays[-1].data)["shown"]

            wait_for(lambda: shown("/plan", True) and shown("/latched", True), "the paths")
            wait_for(lambda: plan.get_subscription_count() == 1, "the viewer to subscribe")
            [done] = peer.set_parameters("/rerun_viewer", **{"hidden": ["plan"]})
            assert done.successful
            wait_for(lambda: plan.get_subscription_count() == 0, "the viewer to unsubscribe")
            wait_for(lambda: shown("/plan", False), "the path hidden")
            assert node.interrupt() == 0
    assert _lines(tmp_path / "x.rrd", "latched")
