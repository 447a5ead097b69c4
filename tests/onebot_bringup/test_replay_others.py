"""``onebot replay`` of other people's robots: any topics, frames, types, storage and distro."""

import numpy as np
import pytest
import rerun.blueprint as rrb
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from onebot_bringup.bags import shown_bag
from onebot_bringup.bags.bag_reader import Bag
from onebot_bringup.bags.shown_bag import ShownBag
from onebot_bringup.viewer.display_server import open_recording
from onebot_description.ros.wire.interface_text import full_definition
from tests.onebot_bringup.drive_support import column, entities, frames
from tests.onebot_bringup.other_robots import OtherRobot, transform
from tests.onebot_bringup.test_viewer_image import image
from tests.onebot_bringup.test_viewer_laser_scan import scan
from tests.onebot_bringup.test_viewer_map import grid
from tests.onebot_bringup.test_viewer_marker import marker
from tests.onebot_bringup.viewer_support import ARM

PATH = "nav_msgs/msg/Path"
NO_ROBOT = "holds no robot_description: showing the rest without the robot"


def path(*xs):
    """A path along x."""
    found = Path()
    for x in xs:
        pose = PoseStamped()
        pose.pose.position.x = float(x)
        found.poses.append(pose)
    return found


class Replayed:
    """A recording that was replayed into a file."""

    def __init__(self, folder, **options):
        self.warnings, self.printed, blueprints = [], [], []
        self.file = folder.parent / "replayed.rrd"
        recording = open_recording(None, self.file)
        stream = recording.stream
        stream.send_blueprint = lambda item, **_: blueprints.append(item)
        self.flushes = 0
        flush = stream.flush

        def counted(**options):
            self.flushes += 1
            flush(**options)

        stream.flush = counted
        bag = ShownBag(
            Bag(folder), warn=self.warnings.append, progress=self.printed.append, **options
        )
        self.shown = bag.log(stream)
        recording.close()
        parts = [blueprints[-1].root_container]
        while not isinstance(parts[0], rrb.Spatial3DView):
            parts = [*getattr(parts[0], "contents", []), *parts[1:]]
        properties = parts[0].properties
        (self.fixed_frame,) = (
            properties["SpatialInformation"].target_frame.as_arrow_array().to_pylist()
        )

    def ends(self, topic):
        """Where each of the paths of a topic ends, along x."""
        found = column(self.file, f"/path{topic}", "LineStrips3D:strips")
        return [row[0][-1][0] if row else None for row in found]


@pytest.mark.parametrize(
    ("distro", "plugin", "compression"),
    [
        (Stores.ROS2_FOXY, StoragePlugin.SQLITE3, CompressionMode.NONE),
        (Stores.ROS2_HUMBLE, StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (Stores.ROS2_HUMBLE, StoragePlugin.MCAP, CompressionMode.NONE),
        (Stores.ROS2_JAZZY, StoragePlugin.SQLITE3, CompressionMode.FILE),
        (Stores.ROS2_JAZZY, StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_distros_and_storages(tmp_path, distro, plugin, compression):
    """A robot with types that are not installed is shown, whatever has recorded it."""
    with OtherRobot(tmp_path / "bag", distro, plugin, compression) as robot:
        robot.write("/tf_static", transform("base_link", "lidar"))
        for step in range(10):
            time = step / 10
            robot.write("/tf", transform("map", "base_link", time, time), time)
            robot.write("/plan", path(0, 1 + step), time, frame="base_link")
            robot.write_velocity("/vehicle/status", 1.5, time)
    replayed = Replayed(tmp_path / "bag")
    assert replayed.fixed_frame == "map"
    assert replayed.ends("/plan") == [1 + step for step in range(10)]
    assert frames(replayed.file, "/path/plan") == ["base_link"]
    assert [NO_ROBOT in sentence for sentence in replayed.warnings] == [True]


def test_a_world_is_replayed_in_the_view_of_a_world(tmp_path):
    """As the bringup showed it live."""
    with OtherRobot(tmp_path / "bag", Stores.ROS2_JAZZY, StoragePlugin.MCAP) as robot:
        for name, link in (("robot", "base_link"), ("world", "world")):
            urdf = f'<robot name="onebot"><link name="{link}"/></robot>'
            robot.write(f"/{name}_description", String(data=urdf))
        robot.write("/tf", transform("world", "odom"))
        robot.write("/tf", transform("odom", "base_link"))
    assert Replayed(tmp_path / "bag").fixed_frame == "world"


def navigating_robot():
    """Messages of a robot with Nav2: the topic, its display and the frame."""
    waypoint = marker(frame="map")
    waypoint.header.stamp = Time()
    return [
        ("/scan", "laser_scan", "lidar", scan()),
        ("/camera/image_raw", "image", "camera", image("mono8", np.zeros((2, 4), np.uint8))),
        ("/map", "map", "map", grid([[0, 100], [-1, 50]])),
        ("/plan", "path", "map", path(0, 2)),
        ("/waypoints", "marker", "map", MarkerArray(markers=[waypoint])),
        ("/rosout", "log", "", Log(level=20, name="amcl", msg="localized")),
    ]


@pytest.mark.parametrize("stamps_from", [None, 5.0])
def test_a_robot_that_navigates(tmp_path, stamps_from):
    """Its topics are shown, in simulated time too, without a warning."""
    messages = navigating_robot()
    with OtherRobot(tmp_path / "bag", Stores.ROS2_JAZZY, StoragePlugin.MCAP) as robot:
        for parent, child in (("map", "odom"), ("base_link", "lidar"), ("base_link", "camera")):
            robot.write("/tf_static", transform(parent, child))
        for step in range(4):
            stamp = None if stamps_from is None else stamps_from + step
            moved = transform("odom", "base_link", step, step)
            if stamp is not None:
                moved.transforms[0].header.stamp = Time(sec=int(stamp))
            robot.write("/tf", moved, step)
            for topic, _, frame, message in messages:
                robot.write(topic, message, step, stamp=stamp, frame=frame)
    view = tmp_path / "view.yaml"
    view.write_text("shown: [/rosout]\n")
    replayed = Replayed(tmp_path / "bag", view=view)
    assert replayed.fixed_frame == "map"
    assert [NO_ROBOT in sentence for sentence in replayed.warnings] == [True]
    assert replayed.shown.messages == 3 + 4 + 4 * len(messages)
    logged = entities(replayed.file)
    for topic, key, _, _ in messages:
        assert any(entity.startswith(f"/{key}{topic}") for entity in logged), (topic, logged)


@pytest.mark.parametrize(
    ("plugin", "plotted"), [(StoragePlugin.MCAP, True), (StoragePlugin.SQLITE3, False)]
)
def test_types_that_are_not_installed(tmp_path, plugin, plotted):
    """They are read by the recording's definition; one that has none is named, once."""
    with OtherRobot(tmp_path / "bag", Stores.ROS2_HUMBLE, plugin) as robot:
        for step in range(20):
            robot.write("/plan", path(0, 2), step, frame="map")
            robot.write_velocity("/vehicle/status", step / 2, step)
    view = tmp_path / "view.yaml"
    field = "{topic: /vehicle/status, field: longitudinal_velocity}"
    view.write_text(f"curves: {{lines: {{speed: {field}}}}}\n")
    replayed = Replayed(tmp_path / "bag", view=view)
    curve = column(replayed.file, "/curves/speed", "Scalars:scalars")
    assert [value for (value,) in curve] == [step / 2 for step in range(20 * plotted)]
    assert len(replayed.ends("/plan")) == 20
    problems = [text for text in replayed.warnings if "/vehicle/status cannot be plotted" in text]
    assert len(problems) == (not plotted)
    assert all("VelocityReport is neither in" in problem for problem in problems)


@pytest.mark.parametrize(("wanted", "fixed"), [("", "map"), ("odom", "odom")])
def test_fixed_frame(tmp_path, wanted, fixed):
    """The given one, or else the root of the transforms above most topics."""
    with OtherRobot(tmp_path / "bag") as robot:
        robot.write("/tf", transform("a", "b"))
        robot.write("/first_plan", path(0, 2), frame="b")
        for number in range(3):
            robot.write(f"/early_plan{number}", path(0, 2), frame="nowhere")
        robot.write("/tf", transform("map", "odom"))
        robot.write("/tf", transform("odom", "base_link"))
        robot.write("/plan", path(0, 2), 1.0, frame="base_link")
        robot.write("/other_plan", path(0, 2), 1.0, frame="odom")
    assert Replayed(tmp_path / "bag", fixed_frame=wanted).fixed_frame == fixed


def test_the_definition_in_the_recording_counts(tmp_path):
    """Of a type that is installed otherwise, messages are read as they were recorded."""
    poses = "geometry_msgs/PoseStamped[] poses"
    text = full_definition(PATH)
    assert text.count(poses) == 1
    text = text.replace(poses, f"uint64 id\n{poses}")
    with OtherRobot(tmp_path / "bag", Stores.ROS2_JAZZY) as robot:
        message = path(0, 2)
        message.header.frame_id = "map"  # up to here 20 bytes
        data = bytes(serialize_message(message))
        robot.write("/plan", data[:20] + bytes(8) + data[20:], kind=PATH, definition=text)
    assert Replayed(tmp_path / "bag").ends("/plan") == [2]


@pytest.mark.parametrize("text", ["what is this?", "nav_msgs/Missing[] poses\n"])
def test_a_broken_definition(tmp_path, text):
    """Topics of the type are left out with one warning; the rest is shown."""
    with OtherRobot(tmp_path / "bag", Stores.ROS2_JAZZY, StoragePlugin.MCAP) as robot:
        robot.write("/tf", transform("map", "base"))
        for topic in ("/plan", "/local_plan"):
            robot.write(topic, path(0, 2), frame="map", definition=text)
    replayed = Replayed(tmp_path / "bag")
    assert (replayed.fixed_frame, replayed.shown.messages) == ("map", 1)
    [_, warning] = replayed.warnings
    assert warning.startswith("/local_plan, /plan cannot be shown: ")


def test_nothing_is_dropped(tmp_path):
    """However fast they came: a replay has the time that a live viewer has not."""
    with OtherRobot(tmp_path / "bag") as robot:
        for step in range(600):
            robot.write("/plan", path(0, step), step / 1000, frame="map")
    assert Replayed(tmp_path / "bag").ends("/plan") == list(range(600))


def test_waits_for_the_file_to_be_written(tmp_path, monkeypatch):
    """Else all of a large recording is in memory, where it is read faster than it is written."""
    monkeypatch.setattr(shown_bag, "_MAX_QUEUED", 100_000)
    with OtherRobot(tmp_path / "bag") as robot:
        for step in range(20):
            picture = image("rgb8", np.zeros((100, 300, 3), np.uint8))
            robot.write("/image", picture, step / 100, frame="camera")
    assert Replayed(tmp_path / "bag").flushes == 10


def test_transforms_below_a_namespace(tmp_path):
    """Where robots publish /tf in their namespaces, those of the robot that is shown are read."""
    with OtherRobot(tmp_path / "bag") as robot:
        for space in ("/a", "/b"):
            robot.write(f"{space}/robot_description", String(data=ARM))
            robot.write(f"{space}/tf", transform("map", "base"))
            robot.write(f"{space}/tf_static", transform("base", "tip"))
            robot.write(f"{space}/plan", path(0, 2), frame="map")
    replayed = Replayed(tmp_path / "bag")
    assert replayed.fixed_frame == "map"
    assert replayed.warnings == ["not shown: the transforms in /b; namespace:= chooses one"]
    replayed = Replayed(tmp_path / "bag", namespace="b")
    assert (replayed.fixed_frame, replayed.warnings) == ("map", [])
    assert (replayed.ends("/a/plan"), replayed.ends("/b/plan")) == ([], [2])
