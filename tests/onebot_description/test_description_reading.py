"""Shapes and colours, and shapes that are left out."""

import pytest

from onebot_description.description import Description, parse_description
from onebot_description.description.description import Box, Capsule, Cylinder, Mesh, Sphere
from onebot_description.errors import DescriptionError

ARM = """<robot name="arm">
  <material name="blue"><color rgba=".1 .3 .9 1"/></material>
  <link name="base">
    <visual><geometry><box size=".6 .6 .6"/></geometry><material name="blue"/></visual>
    <collision><geometry><box size=".8 .8 .8"/></geometry></collision>
  </link>
  <link name="tip">
    <visual><origin xyz="0 0 .1"/><geometry><cylinder radius=".3" length=".6"/></geometry>
      <material name="orange"><color rgba="1 .42 .04 1"/></material></visual>
    <collision><geometry><sphere radius=".5"/></geometry></collision>
  </link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def _read(urdf: str) -> Description:
    return parse_description(urdf, "robot_description")


def _robot(inner: str) -> Description:
    return _read(f'<robot name="r"><link name="a">{inner}</link></robot>')


def test_every_visual_and_collision_is_read_with_its_colour():
    """Shapes, kinds and colours (inline or by name) come out as the URDF says."""
    robot = _read(ARM)
    assert (robot.robot_name, robot.root_link, robot.notices) == ("arm", "base", ())
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
    """The less usual shapes keep their numbers, whether or not a mesh is there."""
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
        (
            '<visual><origin xyz="0 nan 0"/><geometry><sphere radius="1"/></geometry></visual>',
            "nan is not a finite number",
        ),
    ],
)
def test_a_bad_shape_is_left_out(inner, words):
    """One wrong element does not hide the robot; it is named."""
    robot = _robot(inner)
    assert robot.links[0].visuals == ()
    [problem] = robot.problems
    assert words in problem and 'link "a" <visual>' in problem
    assert robot.links[0].left_out == (problem,)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "is not XML"),
        ("<sdf/>", "is a robot in SDF"),
        ("<robot/>", "has no links"),
    ],
)
def test_what_is_no_urdf_is_refused(text, words):
    """Text that is no robot raises an error that says so."""
    with pytest.raises(DescriptionError, match="robot_description") as caught:
        _read(text)
    assert words in str(caught.value)
