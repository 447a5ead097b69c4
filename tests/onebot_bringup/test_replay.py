"""``onebot replay``: recordings of any kind shown as the robot was."""

import pytest
from geometry_msgs.msg import Twist
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.bags.shown_bag import ShownBag, frame_prefix_of
from onebot_bringup.cli.main import main
from onebot_bringup.cli.snapshot import kind_of
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.rendering import headless_viewer
from tests.onebot_bringup.bag_support import write_words
from tests.onebot_bringup.cli_support import running
from tests.onebot_bringup.drive_support import chunks, column
from tests.onebot_bringup.other_robots import SECOND, START, OtherRobot, transform
from tests.onebot_bringup.viewer_support import ARM, VIEW
from tests.support import wait_for
from tests.support_rendering import require_renderer

GARBAGE = b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0"
SPEED = "{commanded: {topic: /cmd_vel, type: Twist}}"


def recorded(folder):
    """A recording by ros2 bag."""
    return OtherRobot(folder, Stores.ROS2_JAZZY, StoragePlugin.MCAP)


def record_arm(folder, *, space="", prefix=""):
    """The arm moving 1 m along x within 5 s, recorded at START."""
    with recorded(folder) as robot:
        robot.write(f"{space}/robot_description", String(data=ARM))
        for step in range(51):
            time, x = step / 10, step / 50
            robot.write("/tf", transform(f"{prefix}base", f"{prefix}tip", x, time), time)
            robot.write(f"{space}/joint_states", JointState(name=["slide"], position=[x]), time)
            robot.write(f"{space}/cmd_vel", Twist(), time)


def to_rrd(folder, path, *, from_start=True, **options):
    """Log a recording into a .rrd file; what is shown, and what was said."""
    said: list[str] = []
    recording = open_recording(None, path)
    bag = ShownBag(Bag(folder), warn=said.append, **options)
    shown = bag.log(recording.stream, from_start=from_start)
    recording.close()
    return shown, said


def test_shows_the_robot_where_it_was(tmp_path):
    """At the end of its time the recorded arm stands where its last transform says."""
    record_arm(tmp_path / "bag")
    view = tmp_path / "view.yaml"
    view.write_text(VIEW)
    shown, said = to_rrd(tmp_path / "bag", tmp_path / "a.rrd", view=str(view), from_start=False)
    assert (shown.robot, said) == ("arm", [])
    assert shown.messages == 1 + 2 * 51
    assert shown.seconds == pytest.approx(5.0)
    [place] = column(tmp_path / "a.rrd", "/tf", "Transform3D:translation")[-1]
    assert place == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.slow
def test_plays_from_the_beginning(tmp_path):
    """The viewer has the whole time on its timeline, and its layout plays it from the start."""
    require_renderer()
    record_arm(tmp_path / "bag")
    to_rrd(tmp_path / "bag", tmp_path / "a.rrd")
    with headless_viewer(str(tmp_path / "a.rrd")) as client:
        state = client.get_state()
        (recording,) = state.recordings
        (timeline,) = (line for line in recording.timelines if line.name == "ros_time")
        assert (timeline.start, timeline.end) == (START, START + 5 * SECOND)
        first = recording.current_time

        def moved():
            (now,) = client.get_state().recordings
            return now.current_time > first or now.current_time == timeline.end

        wait_for(moved, "the viewer to play")
        graph = client.get_transform_graph(include_transforms=True)
        assert "tip" in str(graph)


def test_frame_prefix_is_found_out(tmp_path):
    """Recorded with a frame_prefix, the robot is in one piece."""
    record_arm(tmp_path / "bag", space="/a", prefix="a/")
    shown, said = to_rrd(tmp_path / "bag", tmp_path / "a.rrd")
    assert (shown.robot, said) == ("arm", [])


@pytest.mark.parametrize(
    ("frames", "namespace", "prefix"),
    [
        (["base", "tip"], "", ""),
        (["base", "tip"], "/a", ""),
        (["a/base", "a/tip"], "", "a/"),
        (["a/base", "a/tip", "b/base", "b/tip"], "/b", "b/"),
        (["base", "tip", "b/base", "b/tip"], "/b", "b/"),
        (["base", "tip", "b/base", "b/tip"], "", ""),
        (["left_base", "base", "tip"], "", ""),
        (["odom"], "/a", ""),
    ],
)
def test_frame_prefix(frames, namespace, prefix):
    """The prefix that most links have; of several robots, the one named like the namespace."""
    assert frame_prefix_of("base", ["base", "tip"], frames, namespace) == prefix


def test_several_robots(tmp_path, capsys):
    """All are shown, each in its frames; namespace:= shows one; a wrong one is an error."""
    folder = tmp_path / "bag"
    with recorded(folder) as robot:
        for space, name in (("a", "arm"), ("b", "other")):
            urdf = ARM.replace('name="arm"', f'name="{name}"')
            robot.write(f"/{space}/robot_description", String(data=urdf))
            robot.write("/tf", transform("world", f"{space}/base"))
            robot.write("/tf", transform(f"{space}/base", f"{space}/tip"))
    shown, said = to_rrd(folder, tmp_path / "a.rrd")
    assert (shown.robot, shown.messages, said) == ("arm", 6, [])
    assert "showing the robots in /a, /b; namespace:= chooses one" in capsys.readouterr().out
    for space in "ab":
        frames = column(tmp_path / "a.rrd", f"/{space}/robot/visual/tip/0", "CoordinateFrame:frame")
        assert frames == [[f"{space}/tip"]]
    shown, said = to_rrd(folder, tmp_path / "b.rrd", namespace="b")
    assert (shown.robot, shown.messages, said) == ("other", 5, [])
    assert chunks(tmp_path / "b.rrd", "/robot/visual/tip/0")
    words = ["viewer:=none", f"save:={tmp_path}/c.rrd", "namespace:=/c"]
    assert main(["replay", str(folder), *words]) == 1
    assert "namespace:=/c" in capsys.readouterr().err


@pytest.mark.parametrize("good", [True, False])
def test_undecodable_messages(tmp_path, capsys, good):
    """Each topic's are reported once, with their number.

    Nothing else to show is an error, and leaves the file that would be replaced.
    """
    file = tmp_path / "a.rrd"
    file.write_text("the last recording")
    folder = tmp_path / "bag"
    topics = {
        "/robot_description": "std_msgs/msg/String",
        "/joint_states": "sensor_msgs/msg/JointState",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/odom": "nav_msgs/msg/Odometry",
        "/cmd_vel": "geometry_msgs/msg/Twist",
    }
    with recorded(folder) as robot:
        for step in range(20):
            for name, kind in topics.items():
                robot.write(name, GARBAGE, step / 1000, kind=kind)
        if good:
            robot.write("/robot_description", String(data=ARM), 1.0)
    view = tmp_path / "view.yaml"
    view.write_text(f"{VIEW}\ntrails: {{way: {{topic: /odom}}}}\nspeeds: {{lines: {SPEED}}}\n")
    words = ["viewer:=none", f"save:={file}", f"view:={view}"]
    assert main(["replay", str(folder), *words]) == (0 if good else 1)
    assert (file.read_bytes() == b"the last recording") != good
    said = capsys.readouterr()
    for name in topics:
        assert f"20 messages of {name} were skipped; the first: " in said.err
    if good:
        assert 'of "arm": 1 messages' in said.out
    else:
        assert f"nothing in {folder} can be shown: it has /cmd_vel (geometry_msgs/msg/T" in said.err


def test_a_folder_of_any_name(tmp_path, capsys):
    """record:=run.rrd has made a folder: it is replayed as one, and snapshots are made of it."""
    record_arm(tmp_path / "run.rrd")
    save = f"save:={tmp_path}/a.rrd"
    assert main(["replay", str(tmp_path / "run.rrd"), "viewer:=none", "view:=none", save]) == 0
    assert 'showing 5.0 s of "arm": 103 messages' in capsys.readouterr().out
    assert kind_of(str(tmp_path / "run.rrd")) == "bag"
    assert kind_of(str(tmp_path / "a.rrd")) == "rrd"


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["a", "b"], 2, "takes one recording, not 2"),
        (["none"], 1, "there is no recording none"),
        (["other.rrd"], 1, "other.rrd is not a Rerun recording"),
        (["other.txt"], 1, "write a file whose name ends in"),
        (["bag", "veiwer:=web"], 2, 'no argument "veiwer" (did you mean "viewer"?'),
        (["bag", "viewer:=none"], 2, "viewer:=none needs save:=FILE.rrd"),
        (["bag", "view:=none.yaml"], 1, "view:=none.yaml: no such file"),
        (["bag", "web_port:=99999"], 2, "web_port:=99999 is not valid; write an integer"),
    ],
)
def test_mistakes(tmp_path, monkeypatch, capsys, words, code, message):
    monkeypatch.chdir(tmp_path)
    write_words(tmp_path / "bag")
    for name in ("other.rrd", "other.txt"):
        (tmp_path / name).write_text("what is this?")
    assert main(["replay", *words]) == code
    assert message in capsys.readouterr().err


def test_a_rrd_file_is_served_until_interrupted(tmp_path):
    """With exit code 0."""
    open_recording(None, tmp_path / "a.rrd").close()
    quiet = ("grpc_port:=0", "web_port:=0", "open_browser:=false")
    with running(tmp_path, "replay", str(tmp_path / "a.rrd"), *quiet) as replay:
        replay.says("open http://127.0.0.1:")
        assert "showing" in replay.out
        assert replay.interrupt() == 0
        assert "Traceback" not in replay.err
