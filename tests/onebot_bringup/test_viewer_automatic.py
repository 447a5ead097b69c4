"""What is shown without being named, and what of a flood is dropped."""

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from visualization_msgs.msg import Marker

from onebot_bringup.viewer.automatic import MAX_SHOWN, choose_topics
from onebot_bringup.viewer.core.stage import Stage
from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import START_NS, Shown, describe
from tests.onebot_description.sensor_blocks import rays

PATH = "nav_msgs/msg/Path"


def full_name(topic):
    """As a node in no namespace resolves it."""
    return topic if topic.startswith("/") else f"/{topic}"


def _offered(view, topics, before=()):
    stage = Stage(None, resolve=full_name)
    offered, _ = choose_topics(stage, parse_view(view), topics, offered=before)
    return offered


def _visible(view, topics, before=()):
    return [each.topic for each in _offered(view, topics, before) if each.visible]


@pytest.mark.parametrize(
    ("view", "visible"),
    [
        ("", ["/a", "/b"]),
        ("hidden: [a]", ["/b"]),
        ("automatic: false", []),
        ("{automatic: false, shown: [b]}", ["/b"]),
        ("{automatic: false, path: {topics: {/a: {}}}}", ["/a"]),
        ("path: {visible: false}", []),
        ("path: {visible: false, topics: {a: {visible: true}}}", ["/a"]),
        ("path: {topics: {a: {visible: false}}}", ["/b"]),
        ("{shown: [a, _hidden/c], path: {visible: false}}", ["/_hidden/c", "/a"]),
    ],
)
def test_which_topics_are_shown(view, visible):
    """Those of a type that has a display, but as the view says."""
    topics = {"/b": PATH, "/a": PATH, "/_hidden/c": PATH, "/x": "foo_msgs/msg/Bar"}
    assert _visible(view, topics) == visible


IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def test_a_picture_is_shown_once():
    """Not what image_transport publishes beside it, too, but where that is all there is."""
    topics = {"/a/compressed": COMPRESSED, "/b": IMAGE, "/b/compressed": COMPRESSED}
    topics["/b/compressedDepth"] = COMPRESSED
    assert _visible("", topics) == ["/a/compressed", "/b"]
    assert _visible("shown: [/b/compressed]", topics) == ["/a/compressed", "/b", "/b/compressed"]


def test_a_scan_is_not_shown_again_as_a_cloud(tmp_path):
    """Unless it has several rows, or the view names it; the description may come last."""
    lidars = rays("<topic>scan</topic>"), rays("<topic>rows</topic>", rows=4, name="rows")
    robot = f'<robot name="r"><link name="a"/>{"".join(lidars)}</robot>'
    scan, cloud = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
    names = ("scan", "rows")
    topics = dict.fromkeys(names, scan) | {f"{name}/points": cloud for name in names}
    shown = Shown(tmp_path, robot=False)
    shown.view.offer(topics)

    def visible():
        return {each.topic for each in shown.view.offered if each.visible}

    assert visible() == topics.keys()
    describe(shown.view, robot)
    shown.tick()
    assert visible() == topics.keys() - {"scan/points"}
    shown.look("shown: [scan/points]")
    assert visible() == topics.keys()


def test_of_very_many_those_that_are_shown_stay():
    """Another one that is published does not take the place of one that is seen."""
    many = {f"/n{number:03}": PATH for number in range(MAX_SHOWN)}
    before = _offered("", many)
    assert all(each.visible for each in before)
    assert "/a" not in _visible("", many | {"/a": PATH}, before)
    assert "/a" in _visible("shown: [a]", many | {"/a": PATH}, before)


def test_a_display_rests_in_proportion_to_the_bytes_of_messages(tmp_path):
    """With which Rerun works in its own threads."""
    display = Shown(tmp_path, live=True).view.message_displays[0]
    assert display.is_due(0)
    display.size = 400_000_000
    display.flush()
    assert not display.is_due(2_900_000_000) and display.is_due(4_000_000_000)


def _path(length):
    message = Path(poses=[PoseStamped(), PoseStamped()])
    message.header.frame_id = "base"
    message.poses[1].pose.position.x = float(length)
    return message


def flood(tmp_path, monkeypatch, topic, messages):
    """Send more than there is time for; returns the file, and what is said."""
    monkeypatch.setattr("onebot_bringup.viewer.core.drawing._REST", 1e9)
    now, said = [0.0], []
    shown = Shown(tmp_path, live=True, clock=lambda: now[0])
    for number, message in enumerate(messages, 1):
        shown.send(topic, message)
        if number % 100 == 0:
            now[0] = float(number)
            said += shown.tick(START_NS + number * 10**9)
    return shown.end(), said


def test_a_flood_is_dropped_but_for_the_newest(tmp_path, monkeypatch):
    """It is said once, and the last message is shown."""
    file, said = flood(tmp_path, monkeypatch, "/plan", map(_path, range(400)))
    lines = column(file, "/path/plan", "LineStrips3D:strips")
    assert len(lines) < 400 and lines[-1][0][1][0] == 399.0
    assert [sentence for sentence in said if "dropped" in sentence] == [
        "path: more messages arrive than can be shown without delay: old ones are dropped"
    ]


def test_of_a_flood_of_single_markers_none_is_dropped(tmp_path, monkeypatch):
    """Each is one of many, or deletes another; they are drawn later, together."""
    markers = [Marker(id=number, type=Marker.SPHERE) for number in range(400)]
    for marker in markers:
        marker.header.frame_id = "base"
        marker.scale.x = marker.scale.y = marker.scale.z = marker.color.a = 1.0
    file, said = flood(tmp_path, monkeypatch, "/marks", markers)
    centers = column(file, "/marker/marks/spheres", "InstancePoses3D:translations")
    assert [len(row) for row in centers] == [100, 400] and said == []


def test_what_may_not_be_dropped_is_bounded_by_its_size(tmp_path, monkeypatch):
    """The oldest are dropped, and a warning says so; a single large message is kept."""
    monkeypatch.setattr("onebot_bringup.viewer.core.inbox._MAX_BYTES", 1000)
    shown = Shown(tmp_path, live=True, clock=lambda: 0.0)
    for number in range(10):
        shown.send("/marks", Marker(text="x" * 2000, id=number))
    assert any("marker: more messages arrive" in sentence for sentence in shown.tick())
