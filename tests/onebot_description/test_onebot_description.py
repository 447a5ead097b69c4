"""OneBot's description: every combination of its arguments, and every reader of ours."""

import functools
import io
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import rerun as rr
import yaml
import yourdfpy

from onebot_bringup.viewer.core.glb import load_mesh
from onebot_bringup.viewer.core.robot_shapes import RobotShapes, file_state
from onebot_description.description import Description, load_description, parse_description
from onebot_description.elements.packages import package_share
from onebot_description.elements.urdf import Cylinder, Mesh, Sphere
from onebot_description.model.robot_model import RobotModel

SHARE = package_share("onebot_description")
FILE = SHARE / "urdf/onebot.urdf.xacro"
DIMENSIONS = yaml.safe_load((SHARE / "config/dimensions.yaml").read_text())
RADIUS = DIMENSIONS["wheel"]["radius"]

LINKS = ("base_link", "left_wheel", "right_wheel", "caster_base2", "caswheel")
JOINTS = ("left_wheel_joint", "right_wheel_joint", "caster_swivel_joint", "caster_wheel_joint")
# Argument values, and what they put before every name.
NAMESPACES = {None: "", "": "", "robot1": "robot1_", "/fleet/robot1/": "fleet_robot1_"}
MESHES = (None, "true", "1", "0", "True", "False")
COMBINATIONS = [
    *((mesh, None, None) for mesh in MESHES),
    *(("false", name, prefix) for name, prefix in zip(NAMESPACES, 2 * ("", "left_"), strict=True)),
]
READ = pytest.mark.parametrize(
    "combination", [("true", "", "left_"), ("false", "/fleet/robot1/", "")], ids=["mesh", "plain"]
)


@functools.cache
def _load(mesh=None, namespace=None, prefix=None) -> Description:
    given = {"mesh_enabled": mesh, "robot_namespace": namespace, "prefix": prefix}
    return load_description(FILE, {key: value for key, value in given.items() if value is not None})


@pytest.mark.parametrize("combination", COMBINATIONS)
def test_every_combination_is_clean(combination):
    mesh, namespace, prefix = combination
    description = _load(*combination)
    assert description.notices == ()
    before = NAMESPACES[namespace] + (prefix or "")
    assert sorted(description.link_names) == sorted(before + name for name in LINKS)
    assert [joint.name for joint in description.joints] == [before + name for name in JOINTS]
    assert description.root_link == before + "base_link"
    shapes = {type(visual.shape) for link in description.links for visual in link.visuals}
    assert (Mesh in shapes) == (mesh in (None, "true", "1", "True")), shapes


@pytest.mark.checkout  # whose meshes have paths, not package:// addresses
@READ
def test_yourdfpy_reads_the_robot(combination):
    description = _load(*combination)
    robot = yourdfpy.URDF.load(io.BytesIO(description.urdf.encode()), load_meshes=True)
    assert robot.validate(), robot.errors
    assert set(robot.link_map) == set(description.link_names)
    assert len(robot.actuated_joints) == 4
    low, high = robot.scene.bounds
    np.testing.assert_allclose((low[2], high[0] - low[0]), (-RADIUS, 0.425), atol=1e-3)


@READ
def test_rerun_shows_the_robot_without_complaint(combination):
    """The viewer finds nothing that it cannot draw, and every mesh in colors of its own."""
    robot = parse_description(_load(*combination).urdf, "robot_description")
    assert robot.notices == ()
    assert RobotShapes(rr.RecordingStream("onebot_test")).set_robot(robot) == []
    for visual in (visual for link in robot.links for visual in link.visuals):
        assert visual.color is not None
        if isinstance(visual.shape, Mesh):
            assert load_mesh(visual.shape, file_state(visual.shape)).colored


@pytest.mark.checkout
def test_primitives_have_the_size_of_the_meshes():
    meshes, primitives = _sizes(_load("true")), _sizes(_load("false"))
    assert meshes.keys() == primitives.keys() == set(LINKS)
    for link, bounds in meshes.items():
        np.testing.assert_allclose(primitives[link], bounds, atol=3e-4, err_msg=link)


def _sizes(description: Description) -> dict[str, np.ndarray]:
    """Return the bounds, (2, 3), of what is seen of each link, in its own frame."""
    sizes = {}
    for link in description.link_names:
        robot = ET.fromstring(description.urdf)
        for element in list(robot):
            if element.tag == "joint" or (element.tag == "link" and element.get("name") != link):
                robot.remove(element)
        text = io.BytesIO(ET.tostring(robot))
        sizes[link] = np.array(yourdfpy.URDF.load(text, load_meshes=True).scene.bounds)
    return sizes


def test_the_drive_is_as_the_dimensions_say():
    joints = {joint.name: joint for joint in _load().joints}
    wheel = DIMENSIONS["wheel"]
    for name, side in (("left_wheel_joint", 1), ("right_wheel_joint", -1)):
        joint = joints[name]
        assert joint.kind == "continuous"
        assert joint.origin.xyz == (0.0, side * wheel["separation"] / 2, 0.0)
        assert joint.origin.rpy == (0.0, 0.0, 0.0)
        assert joint.axis == (0.0, 1.0, 0.0)
        assert (joint.effort, joint.velocity) == (wheel["effort"], wheel["velocity"])
    assert joints["caster_swivel_joint"].axis == (0.0, 0.0, 1.0)
    assert joints["caster_wheel_joint"].axis == (0.0, 1.0, 0.0)


def test_all_three_wheels_stand_on_one_plane():
    description = _load()
    model = RobotModel.from_description(description)
    radii = {
        link.name: collision.shape.radius
        for link in description.links
        for collision in link.collisions
        if link.name != "base_link" and isinstance(collision.shape, Cylinder | Sphere)
    }
    assert radii.keys() == {"left_wheel", "right_wheel", "caswheel"}
    for angle in np.linspace(-np.pi, np.pi, 7):
        poses = model.link_poses({"caster_swivel_joint": angle})
        heights = dict(zip(model.links, poses[:, 2], strict=True))
        for link, radius in radii.items():
            assert heights[link] - radius == pytest.approx(-RADIUS, abs=1e-9), (link, angle)


def test_the_right_wheel_is_the_left_ones_mirror_image():
    links = {link.name: link for link in _load().links}
    left, right = links["left_wheel"], links["right_wheel"]
    x, y, z = left.inertial.origin.xyz
    np.testing.assert_allclose(right.inertial.origin.xyz, (-x, -y, z))
    assert left.visuals[0].origin.rpy == (0, 0, 0)
    np.testing.assert_allclose(right.visuals[0].origin.rpy, (0, 0, np.pi), atol=1e-12)
