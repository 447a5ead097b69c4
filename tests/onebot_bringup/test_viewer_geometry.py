"""The shapes of a robot that somebody has published, and the box around them."""

import numpy as np
import pytest

from onebot_bringup.viewer.blueprint import corners, fitting_eye, robot_bounds
from onebot_description.description import Description, read_description
from onebot_description.description.description import Box, Capsule, Cylinder, Mesh, Sphere
from onebot_description.errors import DescriptionError
from tests.onebot_bringup.viewer_support import ARM


def _read(urdf: str) -> Description:
    return read_description(urdf, "robot_description")


def _robot(inner: str) -> Description:
    return _read(f'<robot name="r"><link name="a">{inner}</link></robot>')


def test_every_visual_and_collision_is_read_with_its_colour():
    """Shapes, kinds and colours (inline or by name) come out as the URDF says."""
    robot = _read(ARM)
    assert (robot.robot_name, robot.root_link, robot.warnings) == ("arm", "base", ())
    base, tip = robot.links
    [body], [hand] = base.visuals, tip.visuals
    assert (base.name, body.shape, body.color) == ("base", Box((0.6, 0.6, 0.6)), (0.1, 0.3, 0.9, 1))
    assert (tip.name, hand.shape, hand.color) == ("tip", Cylinder(0.3, 0.6), (1.0, 0.42, 0.04, 1))
    assert hand.origin.xyz == (0, 0, 0.1)
    assert [part.shape for part in base.collisions] == [Box((0.8, 0.8, 0.8))]
    assert [(part.shape, part.color) for part in tip.collisions] == [(Sphere(0.5), None)]


def test_a_material_is_found_wherever_it_is_defined():
    """A name given a colour in another link, or later, still means that colour."""
    urdf = """<robot name="r"><link name="a"><visual><geometry><sphere radius="1"/></geometry>
      <material name="m"/></visual></link><link name="b"><visual><geometry><sphere radius="1"/>
      </geometry><material name="m"><color rgba="0 1 0 .5"/></material></visual></link>
      <joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>"""
    colors = [visual.color for link in _read(urdf).links for visual in link.visuals]
    assert colors == [(0.0, 1.0, 0.0, 0.5)] * 2


def test_capsules_and_scaled_meshes_are_read():
    """The less usual shapes keep their numbers."""
    robot = _robot(
        '<visual><geometry><capsule radius=".2" length="1"/></geometry></visual>'
        '<visual><geometry><mesh filename="x.stl" scale="1 2 -3"/></geometry></visual>'
    )
    shapes = [visual.shape for visual in robot.links[0].visuals]
    assert shapes == [Capsule(0.2, 1.0), Mesh("x.stl", (1.0, 2.0, -3.0))]


@pytest.mark.parametrize(
    ("inner", "words"),
    [
        ("<visual/>", "has no <geometry>"),
        ("<visual><geometry><torus/></geometry></visual>", "unknown shape"),
        ('<visual><geometry><box size="1 2"/></geometry></visual>', "it takes 3 numbers"),
        ('<visual><geometry><sphere radius="1e999"/></geometry></visual>', "too large"),
        ('<visual><geometry><sphere radius="x"/></geometry></visual>', '"x" is not a number'),
        ("<visual><geometry><mesh/></geometry></visual>", "names no file"),
    ],
)
def test_a_bad_shape_is_left_out_with_a_warning(inner, words):
    """One wrong element does not hide the robot; it is named."""
    robot = _robot(inner)
    assert robot.links[0].visuals == ()
    [warning] = robot.warnings
    assert words in warning and 'link "a" <visual>' in warning


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "is not XML"),
        ("<sdf/>", "starts with <sdf>, not <robot>"),
        ("<robot/>", "no root link"),
    ],
)
def test_what_is_no_urdf_is_refused(text, words):
    """Text that is no robot raises an error that says so."""
    with pytest.raises(DescriptionError, match="robot_description") as caught:
        _read(text)
    assert words in str(caught.value)


def test_bounds_enclose_every_visual_but_no_collision_and_the_eye_lies_outside():
    """The box around the robot follows the links' poses."""
    robot = _read(ARM)
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
    robot = _robot(
        '<visual><origin rpy="0 0 1.5707963267948966"/>'
        '<geometry><box size="4 2 2"/></geometry></visual>'
    )
    points = corners(robot.links[0].visuals[0])
    np.testing.assert_allclose(np.ptp(points, axis=0), [2, 4, 2], atol=1e-12)
