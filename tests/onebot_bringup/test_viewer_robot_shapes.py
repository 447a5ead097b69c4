"""The shapes of a robot in a recording, the box around them, and warnings of missing ones."""

from itertools import pairwise

import numpy as np
import pytest

from onebot_bringup.viewer.blueprint import fitting_eye
from onebot_bringup.viewer.core.robot_shapes import RobotShapes, axes_lengths, robot_bounds
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.display_server import open_recording
from onebot_description.description import parse_description
from tests.onebot_bringup.drive_support import chunks, column
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    Shown,
    describe,
    take_tf,
    transforms,
)


def test_a_new_description_replaces_the_robot(tmp_path):
    """A shape of a link that is gone is emptied, in a frame that exists; others are drawn."""
    shown = Shown(tmp_path)
    shown.tick()
    describe(shown.view, ARM.replace('"tip"', '"hand"'))
    take_tf(shown.view, transforms("base", "hand", 1.0, START_NS + 1))
    shown.tick(START_NS + 10**9)
    file = shown.end()
    for link, homes in (("tip", ["base", "tip"]), ("hand", ["hand"]), ("base", ["base"])):
        entity = f"/robot/visual/{link}/0"
        assert sorted(home for [home] in column(file, entity, "CoordinateFrame:frame")) == homes
        shape = "Boxes3D:half_sizes" if link == "base" else "Cylinders3D:lengths"
        assert sum(map(bool, column(file, entity, shape))) == 1
        # A server that reaches its memory limit keeps what is static.
        assert all(chunk.is_static for chunk in chunks(file, entity))


def test_a_bad_description_keeps_the_last_good_robot(tmp_path):
    """A typing error while editing does not empty the view."""
    shown = Shown(tmp_path)
    shown.tick()
    describe(shown.view, ARM[:-5])
    shown.tick()
    [(_, error)] = shown.bad
    assert "malformed XML" in str(error)
    assert shown.view.robot is not None and shown.view.robot.robot_name == "arm"


def test_what_cannot_be_drawn_is_named_once_and_marked(tmp_path):
    """One reason is one sentence for all the links; a wireframe box shows where each would be."""
    lost = '<mesh filename="package://no_such_package/x.stl"/>'
    urdf = ARM.replace('<box size=".6 .6 .6"/>', lost).replace(
        '<cylinder radius=".3" length=".6"/>', lost.replace("x.stl", "y.stl")
    )
    recording = open_recording(save=tmp_path / "x.rrd")
    shapes = RobotShapes(recording.stream)
    [problem] = shapes.set_robot(parse_description(urdf))
    assert problem.startswith("link base, tip: not drawn but marked with a box: mesh no ROS")
    assert shapes.visual_of("base") == "robot/visual/base/0/missing"
    assert shapes.visual_of("tip") == "robot/visual/tip/0/missing"
    # Found again, it takes the place of its mark.
    assert shapes.set_robot(parse_description(ARM)) == []
    assert shapes.visual_of("base") == "robot/visual/base/0"
    recording.close()


def test_the_fixed_frame_is_the_top_one_or_the_one_asked_for(tmp_path):
    """With "" everything is shown in odom once that is heard; a wrong one is complained about."""
    live = Shown(tmp_path).view
    live.tick(START_NS)
    assert live.stage.fixed_frame == "base"
    take_tf(live, transforms("odom", "base", 0.0))
    live.tick(START_NS)
    assert live.stage.fixed_frame == "odom"

    now = [0.0]
    live = Shown(tmp_path, "fixed_frame: odm", clock=lambda: now[0]).view
    take_tf(live, transforms("odom", "base", 0.0))
    assert live.tick(START_NS) == []
    now[0] = 4.0
    [message] = live.tick(START_NS)
    assert '"odm" is not on /tf' in message and 'did you mean "odom"' in message
    assert 'shown in "odom"' in message and live.stage.fixed_frame == "odom"
    assert live.tick(START_NS) == [], "said once"


def test_the_fixed_frame_is_found_under_the_prefix(tmp_path):
    """A view for odom serves a robot whose frames carry a prefix."""
    live = Shown(tmp_path, "fixed_frame: odom", robots=[RobotToShow("", "r1/")]).view
    for parent, child, fixed in (
        ("r1/odom", "r1/base", "r1/odom"),
        ("odom", "base", "r1/odom"),  # the other robot's is no frame of this one
        ("odom", "r1/odom", "odom"),
    ):
        take_tf(live, transforms(parent, child, 1.0))
        live.tick(START_NS)
        assert live.stage.fixed_frame == fixed


def test_waiting_and_missing_frames_are_said(tmp_path):
    """It says that it waits for the description, then which link has no transform."""
    now = [0.0]
    live = Shown(tmp_path, robot=False, clock=lambda: now[0], live=True).view
    assert live.tick(START_NS) == []
    now[0] = 3.5
    [message] = live.tick(START_NS)
    assert "waiting for the robot's description on robot_description" in message
    describe(live, ARM)
    assert live.tick(START_NS) == []
    now[0] = 7.0
    [message] = live.tick(START_NS)
    assert 'no transform yet from "base" to tip' in message


def test_bounds_enclose_every_visual_but_no_collision_and_the_eye_lies_outside():
    """The box follows the links' poses, and the origins of their shapes."""
    turned = '<origin rpy="0 0 1.5707963267948966"/><geometry><box size=".4 .6 .6"/>'
    robot = parse_description(ARM.replace('<geometry><box size=".6 .6 .6"/>', turned))
    tip = np.eye(4)
    tip[:3, 3] = (0, 1, 0)
    bounds = robot_bounds(robot, {"base": np.eye(4), "tip": tip})
    np.testing.assert_allclose(bounds, [[-0.3, -0.2, -0.3], [0.3, 1.3, 0.4]])
    eye, target = fitting_eye(bounds)
    np.testing.assert_allclose(target, bounds.mean(axis=0), atol=1e-4)
    assert np.linalg.norm(np.subtract(eye, target)) > np.linalg.norm(bounds[1] - bounds[0])
    assert robot_bounds(robot, {}) is None


_LINK = '<link name="{}"><visual><geometry><box size="{}"/></geometry></visual></link>'
_JOINT = '<joint name="{1}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'


def test_axes_are_in_proportion_to_links_and_robot():
    """Those of a link without shapes are as its parent's; a hundred links have some, too."""
    links = '<link name="root"/><link name="tip"/>'
    links += _LINK.format("hand", "0.3 1e-9 0.4") + _LINK.format("finger", "0.03 0.04 1e-9")
    names = ("root", "hand", "finger", "tip")
    joints = "".join(_JOINT.format(*pair) for pair in pairwise(names))
    robot = parse_description(f'<robot name="r">{links}{joints}</robot>')
    found = axes_lengths(robot, 10.0)
    longest = round(5.5 / 4**0.7, 3)
    assert found == pytest.approx({"root": longest, "hand": 0.375, "finger": 0.038, "tip": 0.038})
    assert axes_lengths(robot, 0.5)["hand"] == pytest.approx(longest / 20, abs=1e-3)
