"""Planned paths: what is in the file, and what Rerun, a bag and the node show of them."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message

from onebot_bringup.bags.reader import Bag
from onebot_bringup.bags.writer import BagWriter
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.path import PATH, PathLine, PathPoints, PathSettings
from onebot_bringup.viewer.pictures import headless_viewer, render
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.wire.messages import time_message
from tests.onebot_bringup.bag_support import topic
from tests.onebot_bringup.drive_support import chunks, column, while_written
from tests.onebot_bringup.test_replay import START, record_arm, to_rrd
from tests.onebot_bringup.test_rerun_topics import Driver, _viewer
from tests.onebot_bringup.viewer_support import ARM, START_NS, describe, take, take_tf, transforms
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for
from tests.support_rendering import center, colored, pixels, require_renderer

GREEN = (0, 220, 60)
SECOND = 10**9
# From behind and above: +y is to the left in the picture, +x up.
VIEW = """
fixed_frame: base
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 0.0, 8.0], target: [0.0, 0.0, 0.0]}
joint_plot: {positions: false, velocities: false}
paths: {topics: [plan, /other/plan], color: [0, 220, 60], width: 0.1, height: 0.5}
"""


def path(points, frame="base", stamp_ns=START_NS) -> Path:
    """A path through (x, y, z) places."""
    message = Path()
    message.header.frame_id, message.header.stamp = frame, time_message(stamp_ns)
    for x, y, z in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, z
        message.poses.append(pose)
    return message


LINE = [(float(x), -1.0, 0.0) for x in range(-2, 3)]


def _begun(tmp_path, view=VIEW, **options):
    """A view with a robot, the file that it is written to, and its end."""
    recording = open_recording(save=tmp_path / "x.rrd")
    live = RobotView(recording.stream, parse_view(view), **options)
    describe(live, ARM)
    take_tf(live, transforms("base", "tip", 0.5))

    def end():
        live.finish()
        recording.close()
        return tmp_path / "x.rrd"

    return live, end


def _lines(file, name="plan"):
    """The line of each row, (N, 3); None for none."""
    rows = column(file, f"/paths/{name}", "LineStrips3D:strips")
    return [np.array(row[0]) if row else None for row in rows]


def test_paths_that_wait_are_kept_up_to_a_bound(tmp_path):
    """Of bytes: the last ones, and one at least."""
    recording = open_recording(save=tmp_path / "x.rrd")
    line = PathLine(recording.stream, "plan", PathSettings(), (0, 220, 60))
    for number, megabytes in enumerate((4, 4, 4, 4, 1, 40, 1)):
        points = np.full((megabytes * 2**20 // 24, 3), float(number))
        line.add(START_NS + number, PathPoints(START_NS, "base", points))
        if number == 4:
            line.flush()
    line.flush()
    recording.close()
    found = [strip[0][0] for strip in _lines(tmp_path / "x.rrd")]
    assert found == [1.0, 2.0, 3.0, 4.0, 6.0]


def test_a_path_is_a_line_at_its_own_time(tmp_path):
    """Through its poses, in its frame, as the settings draw it; another replaces it."""
    live, end = _begun(tmp_path)
    take(live, "plan", path(LINE))
    take(live, "/other/plan", path(LINE[:2], "tip", START_NS + 5))
    live.tick(START_NS)
    take(live, "plan", path(LINE[1:], stamp_ns=START_NS + SECOND))
    live.tick(START_NS + SECOND)
    file = end()
    first, second = _lines(file)
    np.testing.assert_allclose(first, np.array(LINE) + [0, 0, 0.5])
    np.testing.assert_allclose(second, np.array(LINE[1:]) + [0, 0, 0.5])
    assert len(_lines(file, "other/plan")[0]) == 2
    times = column(file, "/paths/plan", "ros_time")
    stamps = np.array(times, "datetime64[ns]").astype(np.int64)
    np.testing.assert_array_equal(stamps, [START_NS, START_NS + SECOND])
    assert column(file, "/paths/plan", "CoordinateFrame:frame") == [["base"]]
    assert column(file, "/paths/other/plan", "CoordinateFrame:frame") == [["tip"]]
    assert column(file, "/paths/plan", "LineStrips3D:colors") == [[0x00DC3CFF]]
    [[radius]] = column(file, "/paths/plan", "LineStrips3D:radii")
    assert radius == pytest.approx(0.05)


def test_an_empty_path_clears_the_line(tmp_path):
    """Also one without a frame; one before any other draws nothing."""
    live, end = _begun(tmp_path)
    take(live, "/other/plan", path([], frame=""))
    sent = [(LINE, "base"), ([], "base"), (LINE, "base"), ([], "")]
    for at, (points, frame) in enumerate(sent):
        take(live, "plan", path(points, frame, START_NS + at))
    file = end()
    assert [line is None for line in _lines(file)] == [False, True, False, True]
    assert chunks(file, "/paths/other/plan") == []


def test_places_that_are_not_finite_are_left_out(tmp_path):
    """The line leads over them."""
    live, end = _begun(tmp_path)
    take(live, "plan", path([LINE[0], (np.nan, 0.0, 0.0), (0.0, 1e300, 0.0), LINE[1]]))
    [line] = _lines(end())
    np.testing.assert_allclose(line[:, :2], np.array(LINE[:2])[:, :2])


def test_a_path_in_an_unknown_frame_waits_and_is_warned_of(tmp_path):
    """It would be an error in the view; it is drawn once the transform comes."""
    now = [0.0]
    live, end = _begun(tmp_path, clock=lambda: now[0])
    take(live, "plan", path(LINE, "map"))
    assert live.tick(START_NS) == []
    now[0] = 4.0
    [warning] = live.tick(START_NS)
    assert 'path "plan" is in the frame "map"' in warning
    take_tf(live, transforms("map", "base", 0.0), static=True)
    live.tick(START_NS + SECOND)
    assert len(_lines(end())) == 1


def test_bad_messages_are_reported(tmp_path):
    """And cost nothing of the others."""
    bad = []
    live, end = _begun(tmp_path, report=lambda *args: bad.append(args))
    for data in (b"", bytes(serialize_message(path(LINE)))[:-9], b"\0\1\0\0\xff\xff\xff\xff"):
        live.take("plan", PATH.name, data, START_NS)
    take(live, "plan", path(LINE))
    assert len(_lines(end())) == 1
    assert [name for name, _ in bad] == ["plan"] * 3
    assert all("it is no Path" in str(error) for _, error in bad)


def test_what_is_sent_once_is_logged_again(tmp_path, monkeypatch):
    """A server with a memory limit drops the oldest data."""
    monkeypatch.setattr("onebot_bringup.viewer.displays.path.REPEAT_AFTER", -1.0)
    live, end = _begun(tmp_path)
    take(live, "plan", path(LINE))
    for tick in range(5):
        live.tick(START_NS + tick * SECOND)
    assert len(_lines(end())) == 6


def test_settings_take_effect_on_the_next_path(tmp_path):
    """Invisible, its topics are not subscribed; another colour draws anew."""
    live, end = _begun(tmp_path)
    assert {"plan", "/other/plan"} <= set(live.topics)
    live.set_view(parse_view(VIEW.replace("paths: {", "paths: {visible: false, ")))
    assert not {"plan", "/other/plan"} & set(live.topics)
    take(live, "plan", path(LINE))
    live.set_view(parse_view(VIEW.replace("[0, 220, 60]", "[1, 2, 3]")))
    take(live, "plan", path(LINE))
    file = end()
    assert len(_lines(file)) == 1
    assert column(file, "/paths/plan", "LineStrips3D:colors") == [[0x010203FF]]


def test_paths_are_on_by_default_and_give_way(tmp_path):
    """A view without the key takes plan and path, but not where something else is asked for."""
    live, _ = _begun(tmp_path, "")
    assert {"plan", "path"} <= set(live.topics)
    live, end = _begun(tmp_path, "trails: {a: {topic: path}}")
    assert live.wants("path", "nav_msgs/msg/Odometry") and not live.wants("path", PATH.name)
    end()


def test_the_picture_has_the_line(tmp_path):
    """A metre to the right of the robot, as long as it is, and without an error."""
    require_renderer()
    live, end = _begun(tmp_path)
    take(live, "plan", path(LINE))
    live.tick(START_NS)
    file = end()
    with headless_viewer(str(file), 600, 600) as client:
        assert [view.reports for view in client.get_state().views] == [[]]
    render(file, tmp_path / "x.png", 600, 600)
    green = colored(pixels(tmp_path / "x.png"), GREEN)
    rows, columns = np.nonzero(green)
    assert center(green)[0] > 0.55
    assert np.ptp(rows) > 5 * np.ptp(columns)


def test_a_bag_s_path_is_replayed(tmp_path):
    """In the robot's namespace, at its time."""
    record_arm(tmp_path / "bag", space="/left")
    whole = Bag(tmp_path / "bag")
    bag = BagWriter(tmp_path / "both")
    numbers = {name: bag.add_topic(topic(name, kind)) for name, kind in whole.topics.items()}
    for message in whole.messages(list(whole.topics)):
        bag.write(numbers[message.topic], message.time, message.data)
    number = bag.add_topic(topic("/left/plan", PATH.name))
    bag.write(number, START + SECOND, bytes(serialize_message(path(LINE, stamp_ns=START + 7))))
    bag.close()
    shown, said = to_rrd(tmp_path / "both", tmp_path / "a.rrd")
    assert (shown.messages, said) == (1 + 2 * 51 + 1, [])
    [line] = _lines(tmp_path / "a.rrd")
    np.testing.assert_allclose(line, LINE)


@pytest.mark.parametrize("qos", [10, LATCHED])
def test_the_viewer_shows_a_path_that_is_published(ros_domain, tmp_path, qos):
    """Also one that was latched before the viewer has subscribed, and by a later parameter."""
    file = tmp_path / "x.rrd"
    with Peer(ros_domain) as peer:
        plan = peer.node.create_publisher(Path, "plan", qos)
        if qos is LATCHED:
            plan.publish(path(LINE, "odom"))
        with _viewer(tmp_path, viewer="none") as node:
            driver = Driver(peer)

            def recorded() -> bool:
                driver.step()
                if qos is not LATCHED:
                    plan.publish(path(LINE, "odom"))
                return bool(while_written(_lines, file))

            wait_for(recorded, "the path in the file")
            [done] = peer.set_parameters("/rerun_viewer", **{"paths.topics": ["detour"]})
            assert done.successful
            wait_for(lambda: plan.get_subscription_count() == 0, "the viewer to unsubscribe")
            [refused] = peer.set_parameters("/rerun_viewer", **{"paths.width": -1.0})
            assert not refused.successful and "paths.width" in refused.reason
            assert node.interrupt() == 0
