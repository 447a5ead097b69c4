"""Trajectories of joints: the path of a link in the file."""

import math
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_bringup.viewer.core.shown_robot import RobotToShow
from tests.onebot_bringup.drive_support import column, entities, frames, stamps
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    describe,
    stamped,
    take,
    take_joints,
    take_tf,
    transforms,
)

SECOND = 10**9
KIND = "trajectory_msgs/msg/JointTrajectory"
LIFTED = Path(__file__).with_name("lifted.urdf").read_text()
REST = 0.5  # the middle of the lift's range, m
ARM_JOINTS = ("shoulder", "elbow")
BENDS = [(0.0, 0.0), (1.0, -0.5), (1.0, 2.0)]


def trajectory(joints, positions, stamp_ns=START_NS) -> JointTrajectory:
    """A point a second with positions of these joints."""
    message = stamped(JointTrajectory(joint_names=[*joints]), stamp_ns)
    for second, values in enumerate(positions):
        point = JointTrajectoryPoint(positions=[*map(float, values)])
        point.time_from_start.sec = second
        message.points.append(point)
    return message


def tool(positions, height=REST):
    """Where the tool is, (N, 3)."""
    shoulder, both = np.cumsum(np.array(positions, float).reshape(-1, 2), axis=1).T
    x, y = np.cos(shoulder) + np.cos(both), np.sin(shoulder) + np.sin(both)
    return np.stack([x, y, np.full_like(x, height)], axis=1)


def lines(file, name="plan"):
    """The line of each row, (N, 3); None for none."""
    rows = column(file, f"/joint_trajectory/{name}", "LineStrips3D:strips")
    return [np.array(row[0]) if row else None for row in rows]


def marks(file, name="plan"):
    """The points of each row, (N, 3)."""
    rows = column(file, f"/joint_trajectory/{name}", "Points3D:positions")
    return [np.array(row).reshape(-1, 3) for row in rows]


class Lifted(Shown):
    """The robot with the lift, drawn into a file."""

    def __init__(self, folder, view="", urdf=LIFTED):
        super().__init__(folder, view, robot=False)
        self.seconds = 0
        if urdf:
            describe(self.view, urdf)
            assert self.later() == []

    def later(self, *messages, joints=()) -> list[str]:
        """Publish trajectories, and where joints are, a second later; what the user is told."""
        self.seconds += 1
        now = START_NS + self.seconds * SECOND
        for message in messages:
            self.send("/plan", stamped(message, now), at=now)
        if joints:
            take_joints(self.view, now, *zip(*joints, strict=True))
        return self.tick(now)


def test_the_path_leads_through_the_points_as_the_arm_bends(tmp_path):
    """In the frame of the root link, at the time of the stamp; each point is marked."""
    shown = Lifted(tmp_path, "joint_trajectory: {color: [1, 2, 3], line_width: 0.1}")
    assert shown.later(trajectory(ARM_JOINTS, BENDS)) == []
    file = shown.end()
    [line], [points] = lines(file), marks(file)
    np.testing.assert_allclose(points, tool(BENDS), atol=1e-6)
    # By 1.5 rad and by 2.5 rad, in steps of at most 5 degrees; only the elbow moves at the end.
    counts = [math.ceil(angle / math.radians(5)) for angle in (1.5, 2.5)]
    assert len(line) == 1 + sum(counts)
    shoulder = np.linspace((0.0, 0.0), (1.0, -0.5), counts[0] + 1)
    elbow = np.linspace((1.0, -0.5), (1.0, 2.0), counts[1] + 1)
    np.testing.assert_allclose(line, tool([*shoulder, *elbow[1:]]), atol=1e-6)
    assert frames(file, "/joint_trajectory/plan") == ["base"]
    assert stamps(file, "/joint_trajectory/plan") == [START_NS + 2 * SECOND]
    for shape, radius in (("LineStrips3D", 0.05), ("Points3D", 0.1)):
        assert column(file, "/joint_trajectory/plan", f"{shape}:colors") == [[0x010203FF]]
        [[found]] = column(file, "/joint_trajectory/plan", f"{shape}:radii")
        assert found == pytest.approx(radius)


def test_other_joints_are_where_they_are_now(tmp_path):
    """At rest until they are known; those that the trajectory moves are where it has them."""
    shown = Lifted(tmp_path)
    shown.later(trajectory(ARM_JOINTS, BENDS))
    for height in (0.3, math.nan):
        shown.later(joints=[("grasp", 1.0), ("lift", height), ("shoulder", 2.0)])
        shown.later(trajectory(ARM_JOINTS, BENDS))
    found = [tool(BENDS, height) for height in (REST, 0.3, REST)]
    np.testing.assert_allclose(marks(shown.end()), found, atol=1e-6)


@pytest.mark.parametrize(
    ("joints", "positions", "view", "places"),
    [
        (["lift"], [[0.2], [0.8]], "", [(2, 0, 0.2), (2, 0, 0.8)]),  # a straight line, of the tool
        (["shoulder"], [[0.0]], "", [(2, 0, REST)]),
        (["grasp"], [[0.0], [0.5]], "", [(2, 0, REST), (2, 1, REST)]),
        (["lift", "grasp"], [[0.3, 1.0]], "", [(2, 2, 0.3)]),
        (["lift"], [[0.3]], "{link: upper}", [(0, 0, 0.3)]),
        (["elbow"], [[0.0]], "{link: finger}", [(2, 0, REST)]),
        (["elbow"], [[0.0]], "{link: upper}", [(0, 0, REST)]),  # above what moves
    ],
)
def test_the_link_is_the_last_that_moves_or_the_one_named(
    tmp_path, joints, positions, view, places
):
    """A tool that fixed joints hold; a finger only where its joint is named."""
    shown = Lifted(tmp_path, f"joint_trajectory: {view}" if view else "")
    assert shown.later(trajectory(joints, positions)) == []
    file = shown.end()
    np.testing.assert_allclose(marks(file)[0], places, atol=1e-6)
    np.testing.assert_allclose(lines(file)[0], places, atol=1e-6)


def test_mimic_joints_follow(tmp_path):
    """Whatever joint_states has of them."""
    follows = LIFTED.replace(
        '<origin xyz="1 0 0"/>', '<origin xyz="1 0 0"/><mimic joint="shoulder" multiplier="-2"/>'
    )
    shown = Lifted(tmp_path, urdf=follows)
    shown.later(joints=[("elbow", 0.1)])
    shown.later(trajectory(["shoulder"], [[0.0], [0.7]]))
    np.testing.assert_allclose(marks(shown.end())[0], tool([(0.0, 0.0), (0.7, -1.4)]), atol=1e-6)


BAD = [
    (trajectory(["shoulder", "elbov"], BENDS), 'no moving joint "elbov" (did you mean "elbow"?'),
    (trajectory(ARM_JOINTS, [*BENDS, [0.0]]), "point 3 has 1 positions for 2 joints"),
    (
        trajectory(ARM_JOINTS, [*BENDS, (0, math.nan)]),
        'at point 3 the position of joint "elbow" is',
    ),
]


@pytest.mark.parametrize(("message", "reported"), BAD)
def test_what_cannot_be_drawn_is_reported_once(tmp_path, message, reported):
    """The path before stays, and the next one is drawn."""
    shown = Lifted(tmp_path)
    assert shown.later(trajectory(ARM_JOINTS, BENDS)) == []
    [warning] = shown.later(message)
    assert warning.startswith('joint trajectory "/plan": ') and reported in warning
    assert shown.later(message) == []
    assert shown.later(trajectory(ARM_JOINTS, BENDS[:2])) == []
    assert [len(points) for points in marks(shown.end())] == [3, 2]


def test_no_points_clear_the_path(tmp_path):
    """Whatever joints are named."""
    shown = Lifted(tmp_path)
    shown.later(trajectory(ARM_JOINTS, BENDS))
    assert shown.later(trajectory(["x"], [])) == []
    file = shown.end()
    assert [line is None for line in lines(file)] == [False, True]
    assert [len(points) for points in marks(file)] == [3, 0]


def test_an_unknown_link_is_reported(tmp_path):
    """Another setting draws the path."""
    shown = Lifted(tmp_path, "joint_trajectory: {topics: {/plan: {link: tol}}}")
    [warning] = shown.later(trajectory(ARM_JOINTS, BENDS))
    assert 'robot "lifted" has no link "tol" (did you mean "tool"?' in warning
    shown.look("joint_trajectory: {link: upper}")
    np.testing.assert_allclose(marks(shown.end()), [[[0, 0, REST]] * 3], atol=1e-6)


def test_very_many_points_are_drawn_by_a_few(tmp_path):
    """From the first to the last; as many turns as there may be."""
    shown = Lifted(tmp_path)
    turns = np.linspace(0.0, 1000.0, 10_000)
    assert shown.later(trajectory(["shoulder"], turns[:, None])) == []
    assert shown.later(trajectory(ARM_JOINTS, [(0.0, 0.0), (1e30, 0.0)])) == []
    file = shown.end()
    [[points, _], [line, long]] = marks(file), lines(file)
    assert len(points) == 1000 and len(line) <= 2000 and len(long) <= 2000
    np.testing.assert_allclose(points[[0, -1]], tool([(0.0, 0.0), (1000.0, 0.0)]), atol=1e-5)


def test_it_waits_for_the_description_and_follows_what_changes(tmp_path, monkeypatch):
    """Drawn at its own time once the robot is known, and anew some seconds later."""
    shown = Lifted(tmp_path, urdf="")
    shown.later(trajectory(ARM_JOINTS, BENDS))
    assert entities(tmp_path / "x.rrd") == set()
    describe(shown.view, LIFTED)
    shown.later()
    monkeypatch.setattr("onebot_bringup.viewer.core.rerun_limits.REPEAT_AFTER", -1.0)
    describe(shown.view, LIFTED.replace('"0.9 0 0"', '"1.9 0 0"'))
    shown.later(joints=[("lift", 0.3)])
    file = shown.end()
    places = [points[0].tolist() for points in marks(file)[:2]]
    assert places == [pytest.approx([2.0, 0.0, REST]), pytest.approx([3.0, 0.0, 0.3])]
    assert {*stamps(file, "/joint_trajectory/plan")} == {START_NS + SECOND}


def test_each_robot_has_its_own_trajectories(tmp_path):
    """By the namespace of the topic; joint states are subscribed also of a robot without curves."""
    robots = [RobotToShow(f"/{name}", f"{name}/", plotted=False) for name in ("a", "ab")]
    shown = Shown(tmp_path, robot=False, robots=robots)
    view = shown.view
    assert "/ab/joint_states" not in view.topics
    assert view.offer({"/ab/plan": KIND, "/plan": KIND}) == []
    assert {"/a/joint_states", "/ab/joint_states"} <= view.topics.keys()
    for name, height in (("a", 0.3), ("ab", 0.6)):
        take(view, f"/{name}/robot_description", String(data=LIFTED))
        take(view, f"/{name}/joint_states", JointState(name=["lift"], position=[height]))
        take_tf(view, transforms("world", f"{name}/base", height))
    for name in ("/ab/plan", "/plan"):
        take(view, name, trajectory(ARM_JOINTS, BENDS))
    shown.tick()
    file = shown.end()
    for name, robot, height in (("plan", "a", 0.3), ("ab/plan", "ab", 0.6)):
        assert frames(file, f"/joint_trajectory/{name}") == [f"{robot}/base"]
        assert marks(file, name)[-1][0, 2] == pytest.approx(height)
