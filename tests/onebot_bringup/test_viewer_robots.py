"""Several robots in one view, each at its place, under its namespace, with curves of its own."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from builtin_interfaces.msg import Time
from std_msgs.msg import String

from onebot_bringup.cli.live_picture import RunningRobots, running_robots
from onebot_bringup.cli.session import Session
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import transforms_message
from tests.onebot_bringup.drive_support import chunks, column, frames, odometry
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    take,
    take_odometry,
    take_tf,
    transforms,
)
from tests.ros_support import LATCHED, Peer

FRAME = "CoordinateFrame:frame"
TENTH = 100_000_000
VIEW = """
fixed_frame: odom
axes: {frames: [base]}
grid: {visible: false}
camera: {eye: [0.1, 0.0, 0.0], target: [0.0, 0.0, 0.0], follow: base}
joint_plot: {positions: false, velocities: false}
trails: {way: {topic: odom}, plan: {topic: /plan}}
speeds: {lines: {measured: {topic: odom, type: Odometry}}}
"""
WORLD = """<robot name="maze"><link name="wall">
  <visual><geometry><box size="1 .1 .5"/></geometry></visual></link></robot>"""


class Fleet:
    """Two arms, /left and /right of the world, 2 m apart, drawn into a file or for a viewer."""

    def __init__(self, file: Path | None, view: str = VIEW, **options) -> None:
        self.now = 100.0
        self.recording = open_recording(0 if file is None else None, file)
        self.sent: list[rrb.Blueprint] = []
        if file is not None:
            self.recording.stream.send_blueprint = lambda item, **_: self.sent.append(item)
        robots = [RobotToShow("/left", "left/"), RobotToShow("/right", "right/", **options)]
        stream = self.recording.stream
        self.view = RobotView(stream, parse_view(view), robots=robots, clock=lambda: self.now)

    def describe(self, space: str, urdf: str = ARM) -> None:
        """One of them gets its description."""
        take(self.view, f"{space}/robot_description", String(data=urdf))

    def place(self, space: str, y: float) -> None:
        """One of them stands there, with its tip 0.7 m beside it."""
        take_tf(self.view, transforms("world", f"{space}/odom", y))
        take_tf(self.view, transforms(f"{space}/odom", f"{space}/base", 0.0))
        take_tf(self.view, transforms(f"{space}/base", f"{space}/tip", 0.7))

    def show(self) -> list[str]:
        """Show both; what the user is told."""
        for space, y in (("left", -1.0), ("right", 1.0)):
            self.describe(f"/{space}")
            self.place(space, y)
        return self.view.tick(START_NS)

    def end(self) -> None:
        """Close the file."""
        self.view.finish()
        self.recording.close()


def test_each_robot_is_logged_under_its_namespace_in_its_frames(tmp_path):
    """Shapes, trails, axes; a topic that is no robot's own is drawn once."""
    fleet = Fleet(tmp_path / "x.rrd")
    assert fleet.show() == []
    assert list(fleet.view.robots) == ["/left", "/right"]
    assert fleet.view.robots["/left"] is fleet.view.robots["/right"]  # parsed once
    assert (fleet.view.stage.fixed_frame, fleet.view.stage.missing) == ("world", [])
    for step in range(5):
        stamp = START_NS + step * TENTH
        for space in ("left", "right"):
            message = odometry(0.1 * step, frame=f"{space}/odom")
            take_odometry(fleet.view, f"/{space}/odom", stamp, message)
        take_odometry(fleet.view, "/plan", stamp, odometry(0.1 * step, frame="world"))
        fleet.view.tick(stamp)
    fleet.end()
    file = tmp_path / "x.rrd"
    for space in ("left", "right"):
        assert column(file, f"/{space}/robot/visual/tip/0", FRAME) == [[f"{space}/tip"]]
        assert frames(file, f"/{space}/trails/way") == [f"{space}/odom"]
        assert column(file, f"/{space}/speeds/linear/measured", "Scalars:scalars")
        axes = [bool(chunks(file, rf"/frames/{space}\/{link}")) for link in ("base", "tip")]
        assert axes == [True, False]
    assert chunks(file, "/left/trails/plan") and not chunks(file, "/right/trails/plan")


def test_curves_have_a_tab_for_each_robot_and_the_camera_sees_all(tmp_path):
    """A camera that follows a link is for one robot; one robot is chosen by its frame."""
    fleet = Fleet(tmp_path / "x.rrd")
    fleet.show()
    robots, tabs = fleet.sent[-1].root_container.contents
    assert isinstance(tabs, rrb.Tabs)
    assert [tab.name for tab in tabs.contents] == ["left", "right"]
    assert [view.origin for view in tabs.contents[1].contents] == [
        "right/speeds/linear",
        "right/speeds/angular",
    ]
    eye = robots.properties["EyeControls3D"]
    [position] = eye.position.as_arrow_array().to_pylist()
    assert position[0] > 1.0 and eye.tracking_entity is None
    fleet.view.set_view(parse_view(VIEW.replace("follow: base", "follow: right/base")))
    fleet.view.tick(START_NS)
    eye = fleet.sent[-1].root_container.contents[0].properties["EyeControls3D"]
    [position] = eye.position.as_arrow_array().to_pylist()
    assert position[0] == pytest.approx(0.1)
    assert eye.tracking_entity.as_arrow_array().to_pylist() == ["right/robot/visual/base/0"]
    wrong = parse_view(VIEW.replace("follow: base", "follow: basis"))
    assert 'the robot has no link "basis" (did you mean "base"?' in fleet.view.set_view(wrong)[0]
    fleet.end()


def test_robots_come_one_by_one(tmp_path):
    """The first is shown at once; the layout fits all that have come; who lacks is named."""
    fleet = Fleet(tmp_path / "x.rrd")
    fleet.describe("/right")
    fleet.place("right", 1.0)
    fleet.view.tick(START_NS)
    assert fleet.sent == []
    fleet.now += 1.5
    fleet.view.tick(START_NS)
    assert len(fleet.sent) == 1
    fleet.now += 2.0
    assert fleet.view.tick(START_NS) == ["no description yet of the robots in /left"]
    fleet.describe("/left", ARM[:-9])
    with pytest.raises(OneBotError):
        fleet.view.tick(START_NS)
    fleet.describe("/left")
    fleet.view.tick(START_NS)
    fleet.place("left", -1.0)
    fleet.view.tick(START_NS)
    assert len(fleet.sent) == 2
    fleet.end()


def test_the_world_is_shown_around_one_robot_and_around_many(tmp_path):
    """By its own description, which may come first, its links in the frames of their names."""
    fleet = Fleet(tmp_path / "x.rrd")
    take(fleet.view, "/world_description", String(data=WORLD))
    assert fleet.view.tick(START_NS) == []
    fleet.show()
    assert "wall" in fleet.view.stage.missing  # which a snapshot waits for
    take_tf(fleet.view, transforms("world", "wall", 3.0), static=True)
    fleet.now += 10.0
    assert fleet.view.tick(START_NS) == []
    assert not fleet.view.stage.missing
    fleet.end()
    assert column(tmp_path / "x.rrd", "/world/robot/visual/wall/0", FRAME) == [["wall"]]
    assert "/world_description" in RobotView(fleet.recording.stream).topics


def test_a_snapshot_takes_all_robots_that_run(ros_domain, tmp_path, monkeypatch):
    """Found by their descriptions; a prefix that nobody publishes is the namespace."""
    with Peer(ros_domain) as peer, Session() as session:
        edges: list[tuple[str, str]] = []
        for space in ("left", "right"):
            topic = f"/{space}/robot_description"
            # By its name it has a view of its own.
            urdf = ARM.replace('"arm"', '"onebot"').replace('"base"', '"base_link"')
            peer.node.create_publisher(String, topic, LATCHED).publish(String(data=urdf))
            chain = ["world", *(f"{space}/{frame}" for frame in ("odom", "base_link", "tip"))]
            edges += pairwise(chain)
        static = peer.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(edges), 1))
        static.publish(transforms_message(Time(), *zip(*edges, strict=True), poses))
        robots = running_robots(session)
        found = [(one.namespace, one.frame_prefix) for one in robots]
        assert found == [("/left", "left/"), ("/right", "right/")]
        recording = open_recording(save=tmp_path / "x.rrd")
        sent: list[rrb.Blueprint] = []
        recording.stream.send_blueprint = lambda item, **_: sent.append(item)
        shown = RunningRobots(session, "", recording.stream, robots)
        shown.await_descriptions()
        assert shown.record() == []
        recording.close()
        assert "Background" in sent[-1].root_container.contents[0].properties
        assert column(tmp_path / "x.rrd", "/right/robot/visual/tip/0", FRAME) == [["right/tip"]]
        late = RunningRobots(session, "none", recording.stream, [*robots, RobotToShow("/later")])
        monkeypatch.setattr("onebot_bringup.cli.live_picture._FRAMES", 1.0)
        with pytest.raises(OneBotError, match="no description of the robots in /later within 1 s"):
            late.await_descriptions()


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({}, [("", "", True)]),
        ({"robots": ("b", "/x/a")}, [("/ns/b", "ns/b/", True), ("/x/a", "x/a/", True)]),
    ],
)
def test_robots_by_parameters(parameters, expected):
    """Namespaces relative to the node's, which prefix the frames; the first five are plotted."""

    def resolve(name: str) -> str:
        return name if name.startswith("/") else f"/ns/{name}"

    robots = ViewerParameters(**parameters).robots_to_show(resolve)
    assert [(one.namespace, one.frame_prefix, one.plotted) for one in robots] == expected
    many = ViewerParameters(robots=tuple(f"r{number}" for number in range(20)))
    assert sum(one.plotted for one in many.robots_to_show(resolve)) == 5
