"""The limits of joints, in the plot."""

import numpy as np
import pytest

from onebot_bringup.viewer.displays.joint_plot import limited_joints
from onebot_description.description import parse_description
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    Shown,
    describe,
    take_joints,
)

TURNING = ARM.replace('type="prismatic"', 'type="revolute"').replace('"0 1 0"', '"0 0 1"')


@pytest.mark.parametrize("lower", ["1", "x", "-inf"])
def test_a_joint_without_a_range_has_none(lower):
    """Nothing strange is drawn of odd limits."""
    odd = TURNING.replace('lower="0" upper="2"', f'lower="{lower}" upper="1"')
    assert odd != TURNING and limited_joints(parse_description(odd)) == ()


def test_limits_are_level_lines_under_the_joint_s_own_name_and_color(tmp_path):
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
