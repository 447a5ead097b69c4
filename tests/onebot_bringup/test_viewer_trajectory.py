"""Trajectories as a ghost: which links it has, where they are when, and what is bad."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.shown_robot import RobotToShow
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.wire.messages import time_message
from tests.onebot_bringup.drive_support import chunks, column
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    describe,
    take,
    take_tf,
    transforms,
    type_name,
)

SECOND = 10**9
TRAJECTORY = type_name(JointTrajectory())
# A lift that nobody moves, an arm on it with a finger that mimics, and what stands beside it.
LIFT = """<robot name="lift">
  {links}
  <joint name="up" type="prismatic"><parent link="base"/><child link="lift"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 5"/><limit lower="0" upper="2" effort="1" velocity="1"/></joint>
  <joint name="turn" type="continuous"><parent link="lift"/><child link="arm"/><axis xyz="0 0 1"/>
    <origin xyz="1 0 0"/></joint>
  <joint name="hand" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="1 0 0"/>
  </joint>
  <joint name="finger" type="prismatic"><parent link="hand"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="2" effort="1" velocity="1"/>
    <mimic joint="turn" multiplier="0.5" offset="0.25"/></joint>
  <joint name="other" type="fixed"><parent link="base"/><child link="other"/></joint>
</robot>""".format(
    links="".join(
        f'<link name="{name}"><visual><origin xyz="0 0 0.5"/><geometry><box size="1 1 1"/>'
        "</geometry></visual></link>"
        for name in ("base", "lift", "arm", "hand", "finger", "other")
    )
)


def trajectory(joints, points, stamp_ns=START_NS) -> JointTrajectory:
    """Points of (seconds, positions)."""
    message = JointTrajectory(joint_names=list(joints))
    message.header.stamp = time_message(stamp_ns)
    for seconds, positions in points:
        whole, rest = divmod(seconds, 1)
        moment = Duration(sec=int(whole), nanosec=int(rest * 1e9))
        positions = [float(position) for position in positions]
        message.points.append(JointTrajectoryPoint(positions=positions, time_from_start=moment))
    return message


SLIDE = trajectory(["slide"], [(0.0, [0.0]), (1.0, [2.0])])


class Shown:
    """A view of a robot with one topic of trajectories."""

    def __init__(self, folder, urdf=ARM, links=("base", "tip"), view="{}", **options):
        self.file = folder / "x.rrd"
        self._recording = open_recording(save=self.file)
        self.view = RobotView(self._recording.stream, parse_view(f"trajectory: {view}"), **options)
        self.view.offer({"/move": TRAJECTORY})
        self.warnings = []
        if urdf:
            describe(self.view, urdf)
        for link in links[1:]:
            take_tf(self.view, transforms(links[0], link, 0.5))
        self.tick(0.0)

    def take(self, message, seconds=0.0):
        take(self.view, "/move", message, START_NS + int(seconds * SECOND))

    def tick(self, seconds):
        self.warnings += self.view.tick(START_NS + int(seconds * SECOND))

    def end(self):
        self.view.finish()
        self._recording.close()
        return self.file


def poses(file, entity) -> list:
    """The seconds, the place and the turn of each row."""
    found = []
    for chunk in chunks(file, entity):
        batch = chunk.to_record_batch()
        if "InstancePoses3D:translations" in batch.schema.names:
            stamps = batch.column("ros_time").cast("int64").to_pylist()
            places = batch.column("InstancePoses3D:translations").to_pylist()
            turns = batch.column("InstancePoses3D:quaternions").to_pylist()
            rows = zip(stamps, places, turns, strict=True)
            found += [((stamp - START_NS) / 1e9, *place, *turn) for stamp, place, turn in rows]
    return found


def ended(file) -> list:
    """The seconds at which the ghost vanished."""
    times = [
        stamp
        for chunk in chunks(file, "/trajectory/move")
        if "Clear:is_recursive" in chunk.to_record_batch().schema.names
        for stamp in chunk.to_record_batch().column("ros_time").cast("int64").to_pylist()
    ]
    return [(stamp - START_NS) / 1e9 for stamp in times]


TIP = "/trajectory/move/base/tip/0"


def test_the_ghost_moves_when_the_robot_is_to(tmp_path):
    """No sooner than that time: the page would follow it into the future; then it vanishes."""
    shown = Shown(tmp_path, view="{color: [1, 2, 3], alpha: 0.2}")
    shown.take(SLIDE)
    shown.tick(0.5)
    before = len(chunks(shown.file, TIP)) if shown.file.exists() else 0
    assert before <= 3
    for seconds in (0.9, 1.9, 2.1):
        shown.tick(seconds)
    file = shown.end()
    found = poses(file, TIP)
    assert len(found) == 21
    for seconds, place, _ in found:
        np.testing.assert_allclose(place, [0.0, 2.0 * seconds, 0.1], atol=1e-6)
    assert [seconds for seconds, *_ in found] == pytest.approx(np.linspace(0.0, 1.0, 21))
    assert ended(file) == [2.0]
    assert column(file, TIP, "Asset3D:albedo_factor") == [[0x01020333]]
    assert column(file, TIP, "CoordinateFrame:frame") == [["base"]]
    assert shown.warnings == []


def test_what_is_not_due_is_not_logged(tmp_path):
    """A trajectory that goes on when the recording ends is cut."""
    shown = Shown(tmp_path)
    shown.take(SLIDE)
    shown.tick(0.5)
    file = shown.end()
    assert poses(file, TIP)[-1][0] == 0.5
    assert ended(file) == []


def test_the_ghost_is_what_moves(tmp_path):
    """At the link that carries it, wherever that is; what mimics moves, too."""
    links = ("base", "lift", "arm", "hand", "finger", "other")
    shown = Shown(tmp_path, LIFT, links)
    shown.take(trajectory(["turn"], [(0.0, [np.pi / 2])]))
    shown.tick(5.0)
    file = shown.end()
    for link, place in (
        ("arm", (1, 0, 0.5)),
        ("hand", (1, 1, 0.5)),
        ("finger", (1, 2.035398, 0.5)),
    ):
        entity = f"/trajectory/move/lift/{link}/0"
        [(seconds, found, turn)] = poses(file, entity)
        assert (seconds, found) == (0.0, pytest.approx(place, abs=1e-5))
        assert turn == pytest.approx([0, 0, 0.5**0.5, 0.5**0.5], abs=1e-6)
        assert column(file, entity, "CoordinateFrame:frame") == [["lift"]]
    for link in ("base", "other", "lift"):
        assert not chunks(file, f"/trajectory/move/base/{link}/0")


def test_another_trajectory_replaces_it(tmp_path):
    """From its start on; the shapes stay. One without points ends it."""
    shown = Shown(tmp_path)
    shown.take(SLIDE)
    shown.tick(0.45)
    back = trajectory(["slide"], [(0.0, [1.0]), (0.5, [0.0])], START_NS + SECOND // 2)
    shown.take(back, 0.5)
    shown.tick(0.7)
    shown.take(trajectory(["slide"], [], START_NS + 3 * SECOND // 4), 0.75)
    shown.tick(3.0)
    file = shown.end()
    places = {seconds: place[1] for seconds, place, _ in poses(file, TIP)}
    assert max(places) == 0.75
    assert places[0.45] == pytest.approx(0.9) and places[0.5] == pytest.approx(1.0)
    assert places[0.7] == pytest.approx(0.6)
    assert ended(file) == [0.75]
    assert len(column(file, TIP, "Asset3D:albedo_factor")) == 1


def test_another_look_draws_it_anew(tmp_path):
    """At once, where it is."""
    shown = Shown(tmp_path)
    shown.take(SLIDE)
    shown.tick(0.5)
    shown.view.set_view(parse_view("trajectory: {color: [1, 2, 3], alpha: 1.0}"))
    shown.tick(0.6)
    file = shown.end()
    assert column(file, TIP, "Asset3D:albedo_factor")[-1] == [0x010203FF]
    assert poses(file, TIP)[-1][0] == pytest.approx(0.6)


def test_the_robot_may_come_later(tmp_path):
    """As a latched trajectory may."""
    shown = Shown(tmp_path, urdf="")
    shown.take(SLIDE)
    shown.tick(0.2)
    describe(shown.view, ARM)
    for seconds in (0.3, 0.4):
        shown.tick(seconds)
    assert shown.warnings == []
    assert poses(shown.end(), TIP)[-1][0] == pytest.approx(0.4)


def test_of_several_robots_it_is_that_of_the_namespace(tmp_path):
    """They have the same joints."""
    robots = [RobotToShow(f"/{name}", f"{name}/") for name in "ab"]
    recording = open_recording(save=tmp_path / "x.rrd")
    view = RobotView(recording.stream, robots=robots)
    topic = "/b/move"
    view.offer({topic: TRAJECTORY})
    for name in ("/a", "/b"):
        take(view, f"{name}/robot_description", String(data=ARM))
    take_tf(view, transforms("b/base", "b/tip", 0.5))
    take_tf(view, transforms("b/base", "a/base", 0.5))
    take(view, topic, SLIDE)
    view.tick(START_NS + SECOND)
    view.finish()
    recording.close()
    entity = "/trajectory/b/move/b\\/base/tip/0"
    assert column(tmp_path / "x.rrd", entity, "CoordinateFrame:frame") == [["b/base"]]


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (trajectory(["slide", "x"], [(0.0, [0.0, 1.0])]), "no robot that is shown has the joints"),
        (trajectory(["slide"], [(0.0, [0.0]), (1.0, [])]), "each joint must have one"),
        (trajectory([], [(0.0, [])]), "each joint must have one"),
        (trajectory(["slide", "slide"], [(0.0, [0.0, 1.0])]), "each joint must have one"),
        (trajectory(["slide"], [(0.0, [np.nan])]), "not finite"),
        (trajectory(["slide"], [(1.0, [0.0]), (0.5, [1.0])]), "times do not increase"),
        (trajectory(["slide"], [(-1.0, [0.0])]), "times do not increase"),
        (trajectory(["slide"], [(2e9, [0.0])]), "longer than a day"),
    ],
)
def test_bad_trajectories_are_refused(tmp_path, message, said):
    """And said; the ghost goes on."""
    shown = Shown(tmp_path)
    shown.take(SLIDE)
    shown.take(message)
    shown.tick(1.0)
    assert len(poses(shown.end(), TIP)) == 21
    [warning] = shown.warnings
    assert said in warning


def test_a_long_trajectory_has_not_too_many_poses(tmp_path):
    """However many points it has."""
    shown = Shown(tmp_path)
    shown.take(trajectory(["slide"], [(0.01 * step, [0.0]) for step in range(5000)]))
    shown.take(trajectory(["slide"], [(0.0, [0.0]), (50000.0, [1.0])], START_NS + 1))
    shown.tick(50001.0)
    assert len(poses(shown.end(), TIP)) <= 2001
