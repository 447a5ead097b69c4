"""Any robot loads faithfully or is refused by one clear error; nothing reaches stdout."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from onebot_control.physics.engine import PhysicsSettings, engine
from onebot_control.physics.physics_urdf import rigid_bodies
from onebot_control.physics.spawning import converted_meshes
from onebot_description.description import (
    DescriptionError,
    load_description,
    parse_description,
)
from onebot_description.errors import OneBotError
from tests.onebot_control import arm_models
from tests.onebot_control.arm_models import arm, joint, link, mimic
from tests.onebot_control.simulation_support import ROBOTS, robot, simulate

_SHELL = r"<collision>\s*<origin xyz=.-0.1 0 0.03.*?</collision>"
_CASTER = r"<collision>\s*<geometry><sphere.*?</collision>"
_SPHERE = '<sphere radius="0.025"/>'


@pytest.fixture(autouse=True)
def silence(capfd):
    """Nothing any of these tests does is printed."""
    yield
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""


@pytest.mark.parametrize(
    ("pattern", "replacement", "words"),
    [
        ("<collision>.*?</collision>", "", ["no link has a <collision>"]),
        (
            'izz="0.030"',
            'izz="0"',
            ["base_link", "-8.28e-05, 0.0121, 0.024", "all must be above 0"],
        ),
        (f"{_SHELL}|{_CASTER}", "", ["topples over"]),
    ],
)
def test_robots_that_cannot_be_simulated_are_refused(pattern, replacement, words):
    with pytest.raises(OneBotError) as caught:
        simulate(robot(pattern, replacement))
    message = str(caught.value)
    assert "diff_drive.urdf" in message
    assert all(word in message for word in words), message


def test_a_missing_collision_mesh_is_named_and_a_visual_one_is_not_needed():
    lost = '<mesh filename="package://no_such_package/{}.stl"/>'
    with pytest.raises(
        OneBotError,
        match=r'diff_drive.urdf:\d+: link "caster_wheel": collision mesh no ROS package "no_such_',
    ):
        simulate(robot(_SPHERE, lost.format("a")))
    visual = f"<visual><geometry>{lost.format('c')}</geometry></visual>"
    shown = robot().urdf.replace("<collision>", f"{visual}<collision>", 1)
    with simulate(parse_description(shown)) as simulation:
        assert simulation.base_pose().translation[2] > 0


def test_a_missing_mesh_of_a_finger_is_named_with_its_link():
    """Fingers are searched for hollow meshes before the robot is loaded."""
    lost = '<collision><geometry><mesh filename="package://no_such_package/a.stl"/></geometry>'
    fingers = (
        link("left", 0.1),
        joint("left_joint", "world", "left"),
        link("right", 0.1, shape=f"{lost}</collision>"),
        joint("right_joint", "world", "right", more=mimic("left_joint")),
    )
    with pytest.raises(OneBotError, match='link "right": collision mesh no ROS package "no_such_'):
        arm_models.simulate(arm(*fingers))


@pytest.mark.parametrize("mesh", ["cube.dae", "cube.glb", "cube.obj", "cube.stl", "ascii.stl"])
def test_every_kind_of_mesh_is_solid(mesh):
    """A cube of 0.1 m scaled to the caster's height carries the robot as the caster does."""
    shape = f'<mesh filename="meshes/{mesh}" scale="0.5 0.5 0.5"/>'
    with simulate(robot(_SPHERE, shape)) as simulation:
        assert simulation.base_pose().translation[2] == pytest.approx(0.06, abs=1e-3)
        assert simulation.base_pose().rotation == pytest.approx([0, 0, 0, 1], abs=1e-2)


@pytest.mark.parametrize(("flat", "most"), [(False, 8), (True, 81)])
def test_pybullet_gets_only_the_hull_of_a_mesh(tmp_path, flat, most):
    """It makes one of all the corners, which would take minutes."""
    mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    for _ in range(3):
        mesh = mesh.subdivide()
    if flat:
        mesh.update_faces(mesh.face_normals[:, 2] > 0.9)
        mesh.remove_unreferenced_vertices()
    mesh.export(tmp_path / "fine.obj")
    bodies = rigid_bodies(robot(_SPHERE, f'<mesh filename="{tmp_path}/fine.obj"/>'))
    with converted_meshes(bodies.values()) as files:
        [text] = [Path(file).read_text() for file in files.values()]
    assert 4 <= sum(line.startswith("v ") for line in text.splitlines()) <= most


def test_a_mesh_of_one_triangle_has_no_hull(tmp_path):
    """Its description may come from anywhere, and must not end a node."""
    mesh = trimesh.Trimesh([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)], [(0, 1, 2)])
    mesh.export(tmp_path / "one.obj")
    bodies = rigid_bodies(robot(_SPHERE, f'<mesh filename="{tmp_path}/one.obj"/>'))
    with converted_meshes(bodies.values()) as files:
        assert len(files) == 1


def test_a_changed_mesh_is_read_again(tmp_path):
    mesh, sizes = tmp_path / "part.obj", []
    for size in (0.04, 0.08):
        trimesh.creation.box((size, size, size)).export(mesh)
        with simulate(robot(_SPHERE, f'<mesh filename="{mesh}"/>')) as one:
            low, high = one.bullet.getAABB(1, 3)
            sizes.append(high[0] - low[0])
    assert sizes[1] > 1.5 * sizes[0]


def test_masses_and_inertias_are_those_written():
    """PyBullet ends up with every body's mass, and with its inertia in the link's axes."""
    with simulate() as simulation:
        info = [simulation.bullet.getDynamicsInfo(1, index) for index in range(-1, 4)]
    assert [row[0] for row in info] == pytest.approx([3.4, 0.25, 0.25, 0.05, 0.05])
    assert info[0][3] == pytest.approx((-0.108, 0.0, -0.026))
    turn = np.array(engine.getMatrixFromQuaternion(info[0][4])).reshape(3, 3)
    written = np.array([[0.012, 0.0, 0.001], [0.0, 0.024, 0.0], [0.001, 0.0, 0.030]])
    assert turn @ np.diag(info[0][2]) @ turn.T == pytest.approx(written, abs=1e-9)


def test_a_fixed_link_collides_where_it_is():
    fixed = (
        '<link name="lidar"><collision><origin xyz="0 0.1 0"/>'
        '<geometry><sphere radius="0.02"/></geometry></collision></link>'
    )
    text = robot('<link name="lidar"/>', fixed).urdf
    text = text.replace('xyz="0.02 0 0.12"', 'xyz="-0.2 0 0.06" rpy="-1.5707963267948966 0 0"')
    # Below it the axle is 0.06 m above the ground: 0.06 - 0.1 - 0.02 is where the sphere ends.
    with simulate(parse_description(text)) as simulation:
        assert simulation.base_pose().translation[2] == pytest.approx(0.06, abs=1e-4)


@pytest.mark.parametrize("mesh", ["left_wheel", "Rad links", "røue", "r" * 9000])
def test_names_are_free(mesh):
    """Blanks, letters beyond ASCII and very long names reach PyBullet and come back."""
    description = robot("left_wheel_joint", mesh)
    with simulate(description, driven=(mesh, "right_wheel_joint")) as simulation:
        simulation.step([1.0, 1.0], 0.1)
        assert simulation.joints[0] == mesh


def test_robots_of_the_description_tests_load_or_are_refused():
    """Every well-formed robot in the folder, driven by its first joint, gives no crash."""
    for file in sorted(ROBOTS.glob("*.urdf")):
        try:
            description = load_description(file)
        except DescriptionError:
            continue
        moving = [joint.name for joint in description.joints if joint.kind != "fixed"]
        try:
            simulate(description, moving[:1], PhysicsSettings(settling=0.1)).close()
        except OneBotError as error:
            assert file.name in str(error) or "mesh" in str(error), error
