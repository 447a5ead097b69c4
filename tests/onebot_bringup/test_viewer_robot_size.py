"""The box around a robot's visuals, and the eye that sees all of it."""

import numpy as np
import pytest

from onebot_bringup.viewer.robot_size import (
    axes_lengths,
    corners,
    fitting_eye,
    fitting_length,
    robot_bounds,
)
from onebot_description.description import parse_description
from tests.onebot_bringup.viewer_support import ARM


def test_bounds_enclose_every_visual_but_no_collision_and_the_eye_lies_outside():
    """The box around the robot follows the links' poses."""
    robot = parse_description(ARM, "robot_description")
    tip = np.eye(4)
    tip[:3, 3] = (0, 1, 0)
    bounds = robot_bounds(robot, {"base": np.eye(4), "tip": tip})
    np.testing.assert_allclose(bounds, [[-0.3, -0.3, -0.3], [0.3, 1.3, 0.4]])
    eye, target = fitting_eye(bounds)
    np.testing.assert_allclose(target, bounds.mean(axis=0))
    assert np.linalg.norm(np.subtract(eye, target)) > np.linalg.norm(bounds[1] - bounds[0])
    assert robot_bounds(robot, {}) is None


def test_corners_turn_with_the_origin():
    """A long box turned by a quarter about z is long in y."""
    robot = parse_description(
        '<robot name="r"><link name="a"><visual><origin rpy="0 0 1.5707963267948966"/>'
        '<geometry><box size="4 2 2"/></geometry></visual></link></robot>',
        "robot_description",
    )
    points = corners(robot.links[0].visuals[0])
    np.testing.assert_allclose(np.ptp(points, axis=0), [2, 4, 2], atol=1e-12)


def test_axes_are_in_proportion_to_links_and_robot():
    """Those of a link without shapes are as its parent's; a hundred links have some, too."""
    sizes = {"root": "", "hand": "0.3 1e-9 0.4", "finger": "0.03 0.04 1e-9", "tip": ""}
    links = "".join(
        f'<link name="{name}">{_VISUAL.format(size) if size else ""}</link>'
        for name, size in sizes.items()
    )
    joints = "".join(
        f'<joint name="{child}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        "</joint>"
        for parent, child in (("root", "hand"), ("hand", "finger"), ("finger", "tip"))
    )
    robot = parse_description(f'<robot name="r">{links}{joints}</robot>')
    assert axes_lengths(robot) == pytest.approx({"hand": 0.375, "finger": 0.038, "tip": 0.038})
    assert fitting_length(2.0, 0) == 0.0
    assert fitting_length(2.0, 2) > fitting_length(2.0, 20) > fitting_length(2.0, 100) == 0.1


_VISUAL = '<visual><geometry><box size="{}"/></geometry></visual>'
