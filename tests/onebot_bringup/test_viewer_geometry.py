import numpy as np
import pytest

from onebot_bringup.viewer.blueprint import corners, fitting_eye, robot_bounds
from onebot_description.description.description import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Sphere,
    read_robot,
)
from onebot_description.errors import DescriptionError
from tests.onebot_bringup.viewer_support import ARM, BLUE, ORANGE


def _robot(inner: str) -> str:
    return f'<robot name="r"><link name="a">{inner}</link></robot>'


def test_every_visual_and_collision_is_read_with_its_colour():
    """Shapes, kinds and colours (inline or by name, as bytes) come out as the URDF says."""
    robot = read_robot(ARM)
    assert (robot.name, robot.root, robot.links, robot.moves) == (
        "arm",
        "base",
        ("base", "tip"),
        True,
    )
    found = [(g.link, g.kind, g.shape, g.color) for g in robot.geometries]
    assert found == [
        ("base", "visual", Box((0.6, 0.6, 0.6)), (*BLUE, 255)),
        ("base", "collision", Box((0.8, 0.8, 0.8)), None),
        ("tip", "visual", Cylinder(0.3, 0.6), (*ORANGE, 255)),
        ("tip", "collision", Sphere(0.5), None),
    ]
    assert robot.geometries[2].translation == (0, 0, 0.1)


def test_a_material_is_found_wherever_it_is_defined():
    """A name given a colour in another link, or later, still means that colour."""
    urdf = """<robot name="r"><link name="a"><visual><geometry><sphere radius="1"/></geometry>
      <material name="m"/></visual></link><link name="b"><visual><geometry><sphere radius="1"/>
      </geometry><material name="m"><color rgba="0 1 0 .5"/></material></visual></link></robot>"""
    assert [g.color for g in read_robot(urdf).geometries] == [(0, 255, 0, 128)] * 2


def test_capsules_and_scaled_meshes_are_read():
    """The less usual shapes keep their numbers."""
    urdf = _robot(
        '<visual><geometry><capsule radius=".2" length="1"/></geometry></visual>'
        '<visual><geometry><mesh filename="x.stl" scale="1 2 -3"/></geometry></visual>'
    )
    shapes = [g.shape for g in read_robot(urdf).geometries]
    assert shapes == [Capsule(0.2, 1.0), Mesh("x.stl", (1.0, 2.0, -3.0))]


@pytest.mark.parametrize(
    ("inner", "said"),
    [
        ("<visual/>", "no <geometry>"),
        ("<visual><geometry><torus/></geometry></visual>", "<torus> is no shape (box, cylinder"),
        ('<visual><geometry><box size="1 2"/></geometry></visual>', '"1 2" is not three numbers'),
        ('<visual><geometry><sphere radius="1e999"/></geometry></visual>', "not finite"),
        ('<visual><geometry><sphere radius="x"/></geometry></visual>', '"x" is no number'),
        ("<visual><geometry><mesh/></geometry></visual>", "without a filename"),
    ],
)
def test_a_bad_shape_is_left_out_with_a_warning(inner, said):
    """One wrong element does not hide the robot; it is named."""
    robot = read_robot(_robot(inner))
    assert robot.geometries == ()
    [warning] = robot.warnings
    assert said in warning and 'link "a", <visual> 1' in warning


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("nonsense", "not XML"),
        ("<sdf/>", "starts with <sdf>, not <robot>"),
        ("<robot/>", "no root link"),
    ],
)
def test_what_is_no_urdf_is_refused(text, said):
    """Text that is no robot raises an error that says so."""
    with pytest.raises(DescriptionError, match="robot_description") as caught:
        read_robot(text)
    assert said in str(caught.value)


def test_bounds_enclose_every_visual_but_no_collision_and_the_eye_lies_outside():
    """The box around the robot follows the links' poses."""
    robot = read_robot(ARM)
    tip = np.eye(4)
    tip[:3, 3] = (0, 1, 0)
    bounds = robot_bounds(robot.geometries, {"base": np.eye(4), "tip": tip})
    np.testing.assert_allclose(bounds, [[-0.3, -0.3, -0.3], [0.3, 1.3, 0.4]])
    eye, target = fitting_eye(bounds)
    np.testing.assert_allclose(target, bounds.mean(axis=0))
    assert np.linalg.norm(np.subtract(eye, target)) > np.linalg.norm(bounds[1] - bounds[0])
    assert robot_bounds(robot.geometries, {}) is None


def test_corners_turn_with_the_origin():
    """A long box turned by a quarter about z is long in y."""
    urdf = _robot(
        '<visual><origin rpy="0 0 1.5707963267948966"/>'
        '<geometry><box size="4 2 2"/></geometry></visual>'
    )
    points = corners(read_robot(urdf).geometries[0])
    np.testing.assert_allclose(np.ptp(points, axis=0), [2, 4, 2], atol=1e-12)
