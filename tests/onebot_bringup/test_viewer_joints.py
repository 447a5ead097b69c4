"""Joints with their limits: in the plot, and in the robot."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.transformations import euler_matrix, rotation_matrix

from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.displays.joint_limits import (
    limited_joints,
    needle_strips,
    scale_strips,
)
from onebot_bringup.viewer.view_config import parse_view
from onebot_description.description import parse_description
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    Shown,
    describe,
    take_joints,
)

FRAME = "CoordinateFrame:frame"
TURNING = ARM.replace('type="prismatic"', 'type="revolute"').replace('"0 1 0"', '"0 0 1"')


def _joint(body: str, kind="revolute"):
    body = body.replace("<limit", '<limit effort="1" velocity="1"')
    return limited_joints(
        parse_description(
            f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{kind}">'
            f'<parent link="a"/><child link="b"/>{body}</joint></robot>',
            "robot_description",
        )
    )


@pytest.mark.parametrize(
    "body",
    [
        "",
        '<limit lower="1" upper="1"/>',
        '<limit lower="x" upper="1"/>',
        '<limit lower="-inf" upper="1"/>',
    ],
)
def test_a_joint_without_a_range_has_none(body):
    """Nothing strange is drawn of a joint without limits, or with odd ones."""
    assert _joint(body) == ()


def test_a_range_of_several_turns_is_one_circle_and_a_bar_is_straight():
    """An arc does not lie upon itself; a prismatic joint's bar is along its axis."""
    [joint] = _joint('<axis xyz="1 0 0"/><limit lower="-50" upper="50"/>')
    arc = scale_strips(joint, 1.0)[0]
    assert len(arc) < 80
    np.testing.assert_allclose(arc[0], arc[-1], atol=1e-9)
    np.testing.assert_allclose(arc[:, 0], 0.0, atol=1e-9)
    [slide] = _joint('<axis xyz="0 0 1"/><limit lower="-0.5" upper="1.5"/>', "prismatic")
    np.testing.assert_allclose(scale_strips(slide, 1.0)[0], [[0, 0, -0.5], [0, 0, 1.5]])


def _placed(axis, rpy, lower, upper, kind="revolute"):
    origin, turn, along = (" ".join(map(repr, each)) for each in ((0.1, -0.2, 0.3), rpy, axis))
    [joint] = _joint(
        f'<origin xyz="{origin}" rpy="{turn}"/><axis xyz="{along}"/>'
        f'<limit lower="{lower!r}" upper="{upper!r}"/>',
        kind,
    )
    return joint


_direction = st.tuples(*[st.sampled_from([-1.0, -0.5, 0.0, 0.3, 1.0])] * 3).filter(any)
_angle = st.floats(-3.0, 3.0)


def _moved(joint, points, position):
    """Points of the child's frame in the parent's, with the joint at ``position`` (REP-103)."""
    if joint.kind == "revolute":
        points = points @ rotation_matrix(position, joint.axis)[:3, :3].T
    else:
        points = points + position * np.array(joint.axis)
    return points @ euler_matrix(*joint.origin.rpy)[:3, :3].T + np.array(joint.origin.xyz)


@settings(max_examples=50)
@given(
    axis=_direction,
    rpy=st.tuples(_angle, _angle, _angle),
    lower=_angle,
    span=st.floats(0.01, 3.0),
    share=st.floats(0.0, 1.0),
)
def test_the_hand_points_to_the_arc_at_every_position(axis, rpy, lower, span, share):
    """From one end of the arc to the other, about any axis, at its own radius."""
    joint = _placed(axis, rpy, lower, lower + span)
    arc, first, last = scale_strips(joint, 0.5)
    [needle] = needle_strips(joint, 0.5)
    np.testing.assert_allclose(arc[0], _moved(joint, needle, joint.lower)[0], atol=1e-6)
    np.testing.assert_allclose(arc[-1], _moved(joint, needle, joint.upper)[0], atol=1e-6)
    between = _moved(joint, needle, joint.lower + share * (joint.upper - joint.lower))[0]
    longest = np.linalg.norm(np.diff(arc, axis=0), axis=1).max()
    assert np.linalg.norm(arc - between, axis=1).min() <= longest
    assert longest <= 0.5 * math.radians(5.0) + 1e-9 and len(arc) <= math.degrees(span) / 5 + 3
    for end, tick in ((arc[0], first), (arc[-1], last)):
        np.testing.assert_allclose(tick.mean(axis=0), end, atol=1e-9)
        assert np.linalg.norm(tick[1] - tick[0]) == pytest.approx(0.1)


@settings(max_examples=30)
@given(axis=_direction, rpy=st.tuples(_angle, _angle, _angle), lower=_angle)
def test_a_bar_leads_from_end_to_end_with_a_tick_at_each(axis, rpy, lower):
    """The needle is a tick, too, and slides along the bar."""
    joint = _placed(axis, rpy, lower, lower + 0.5, "prismatic")
    bar, *ticks = scale_strips(joint, 0.5)
    [needle] = needle_strips(joint, 0.5)
    assert len(bar) == 2 and len(ticks) == 2
    for end, tick, position in zip(bar, ticks, (joint.lower, joint.upper), strict=True):
        at = _moved(joint, needle, position)
        np.testing.assert_allclose(at.mean(axis=0), end, atol=1e-9)
        np.testing.assert_allclose((at - end) * 2, (tick - end) * 3, atol=1e-9)
        assert np.linalg.norm(tick[1] - tick[0]) == pytest.approx(0.2)
        assert (tick[1] - tick[0]) @ (bar[1] - bar[0]) == pytest.approx(0.0, abs=1e-9)


def test_marks_are_drawn_anew_only_when_they_change(tmp_path):
    """A scale in the parent's frame, a hand in the child's; both go home when they are gone."""
    shown = Shown(tmp_path, robots=[RobotToShow(frame_prefix="left/")])
    live = shown.view
    shorter = TURNING.replace('upper="2"', 'upper="1"')
    visible = ", radius: 0.5, visible: true"
    for number, (urdf, ranges) in enumerate(
        [
            (TURNING, visible),  # no colour yet: not drawn
            (TURNING, visible),
            (TURNING, visible),
            (TURNING, ", radius: 0.6, visible: true"),
            (shorter, ", radius: 0.6, visible: true"),
            (shorter, ""),
            (shorter, visible),
        ]
    ):
        describe(live, urdf)
        live.set_view(parse_view(f"joint_ranges: {{{ranges[2:]}}}"))
        live.tick(START_NS + number * 10**9)
        take_joints(live, START_NS + number, ("slide",), (0.5,))
        live.tick(START_NS + number * 10**9 + 5 * 10**8)
    file = shown.end()
    marks = [
        [frame for [frame] in column(file, f"/joint_ranges/slide/{part}", FRAME)]
        for part in ("range", "hand")
    ]
    assert sorted(marks[0]) == ["left/base"] * 5
    assert sorted(marks[1]) == ["left/base", *["left/tip"] * 4]


def test_limits_are_level_lines_under_the_joint_s_own_name_and_colour(tmp_path):
    """They come with every position; a joint without limits has none, nor have velocities."""
    shown = Shown(tmp_path, "joint_plot: {limits: true}")
    shown.tick()
    for i in range(3):
        take_joints(shown.view, START_NS + i, ("free", "slide"), (9.0, 0.1 * i), (0.0, 0.0))
    file, entity = shown.end(), "/joints/position/0"
    assert column(file, entity, "SeriesLines:names") == [["free", "slide", "slide", "slide"]]
    [shades] = column(file, entity, "SeriesLines:colors")
    assert shades[1] == shades[2] == shades[3] != shades[0]
    rows = column(file, entity, "Scalars:scalars")
    np.testing.assert_allclose(rows, [[9.0, 0.1 * i, 0.0, 2.0] for i in range(3)])
    assert column(file, "/joints/velocity/0", "SeriesLines:names") == [["free", "slide"]]
    np.testing.assert_allclose(column(file, "/joints/velocity/0", "Scalars:scalars"), 0.0)


def test_a_new_description_has_its_own_limits_at_once(tmp_path):
    """The plot's lines move, and go where a joint has lost its limits."""
    wider = TURNING.replace('upper="2"', 'upper="3"')
    free = TURNING.replace('type="revolute"', 'type="continuous"')
    shown = Shown(tmp_path, "joint_plot: {limits: true}")
    for number, urdf in enumerate((TURNING, wider, free)):
        describe(shown.view, urdf)
        shown.tick(START_NS + number * 10**9)
        take_joints(shown.view, START_NS + number, ("slide",), (0.5,))
        shown.tick(START_NS + number * 10**9 + 5 * 10**8)
    file = shown.end()
    rows = [column(file, f"/joints/position/{number}", "Scalars:scalars") for number in range(3)]
    assert rows == [[[0.5, 0, 2]], [[0.5, 0, 3]], [[0.5]]]
