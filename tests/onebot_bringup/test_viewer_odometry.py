"""Odometry as arrows, as RViz draws it: how many are kept, and how far apart they are."""

import numpy as np
import pytest
from nav_msgs.msg import Odometry

from onebot_description.wire.messages import time_message
from tests.onebot_bringup.drive_support import column, frames
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    describe,
    show,
    take_tf,
    transforms,
)


def odometry(x, yaw=0.0, number=0, frame="base") -> Odometry:
    """A robot on the x axis."""
    message = Odometry()
    message.header.frame_id, message.header.stamp = frame, time_message(START_NS + number)
    message.pose.pose.position.x = float(x)
    turn = message.pose.pose.orientation
    turn.z, turn.w = np.sin(yaw / 2), np.cos(yaw / 2)
    return message


def _shown(folder, settings, *messages):
    """Where the arrows of each row begin, and what is warned of."""
    found = [("/odom", message) for message in messages]
    file, warnings = show(folder, f"odometry: {settings}", *found)
    rows = column(file, "/odometry/odom", "Arrows3D:origins")
    return [[x for x, _, _ in row] for row in rows], warnings


def test_an_arrow_each_eighth_of_a_metre(tmp_path):
    """The last ones, each with those before it."""
    drive = [odometry(x / 16, number=x) for x in range(9)]
    rows, warnings = _shown(tmp_path, "{keep: 3, position_tolerance: 0.125}", *drive)
    last = [[0], [0, 1], [0, 1, 2], [1, 2, 3], [2, 3, 4]]
    assert rows == [[eighths / 8 for eighths in row] for row in last]
    assert warnings == []


@pytest.mark.parametrize(("settings", "count"), [("{}", 3), ("{angle_tolerance: 0.5}", 1)])
def test_an_arrow_each_turn(tmp_path, settings, count):
    """By the angle, also beyond half a turn."""
    turns = [odometry(0, yaw, number) for number, yaw in enumerate((3.0, 3.05, 3.2, -2.98))]
    rows, _ = _shown(tmp_path, settings, *turns)
    assert len(rows) == count


def test_another_frame_begins_anew(tmp_path):
    """As in the other one the arrows are elsewhere."""
    rows, _ = _shown(tmp_path, "{}", odometry(1), odometry(2, frame="tip", number=1))
    assert rows == [[1], [2]]
    assert frames(tmp_path / "x.rrd", "/odometry/odom") == ["base", "tip"]


@pytest.mark.parametrize(
    ("view", "visible"),
    [
        ("", True),
        ("trails: {a: {topic: odom}}", False),
        ("covariance: {a: {topic: odom}}", False),
        ("speeds: {lines: {a: {topic: odom, type: Odometry}}}", True),
        ("{trails: {a: {topic: odom}}, shown: [odom]}", True),
    ],
)
def test_what_has_a_trail_is_not_shown_by_itself(tmp_path, view, visible):
    """It would be there twice; it may be asked for."""
    shown = Shown(tmp_path, view, resolve=lambda name: f"/{name.lstrip('/')}")
    shown.send("/odom", odometry(0))
    assert [each.visible for each in shown.view.offered] == [visible]
    shown.end()


def test_arrows_are_in_proportion_to_the_robot(tmp_path):
    """Also those drawn before it was known; without one they are as RViz's."""
    box = '<visual><geometry><box size="0.03 0.04 0.12"/></geometry></visual>'
    shown = Shown(tmp_path, robot=False)
    take_tf(shown.view, transforms("base", "tip", 0.5))
    shown.send("/odom", odometry(0))
    shown.tick()
    describe(shown.view, f'<robot name="small"><link name="base">{box}</link></robot>')
    shown.tick()
    vectors = column(shown.end(), "/odometry/odom", "Arrows3D:vectors")
    assert np.ravel(vectors) == pytest.approx([1.3, 0, 0, 0.65 * 0.13, 0, 0])


def test_another_look_keeps_the_arrows(tmp_path):
    """All that were there."""
    shown = Shown(tmp_path)
    shown.send("/odom", *(odometry(number, number=number) for number in range(3)))
    shown.tick()
    shown.look("odometry: {color: [1, 2, 3]}")
    file = shown.end()
    rows = column(file, "/odometry/odom", "Arrows3D:origins")
    assert [len(row) for row in rows] == [1, 2, 3, 3]
    assert column(file, "/odometry/odom", "Arrows3D:colors")[-1] == [0x010203FF]
