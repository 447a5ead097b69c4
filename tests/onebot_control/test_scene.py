"""Robots among walls, ramps and boxes: what stops them, what they push, where they can start."""

import math
import re

import numpy as np
import pytest
import trimesh

from onebot_control import Simulation
from onebot_control.physics.scene import load_scene
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.description import parse_description
from onebot_description.description.loading import load_world
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.simulation_support import DRIVEN, bits, planar, robot, simulate

_INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
_FRONT = 0.06  # m from the robot's root link to the foremost point: the wheels'
_SLOPE = math.radians(8)


def part(name, size="0.2 0.2 0.2", xyz="0 0 0", rpy="0 0 0", kind="fixed", mass=0.0, friction=None):
    """A box, and the joint that places it in the world."""
    inertial = f'<inertial><mass value="{mass}"/>{_INERTIA}</inertial>' if mass else ""
    contact = f'<contact><lateral_friction value="{friction}"/></contact>' if friction else ""
    return (
        f'<link name="{name}">{inertial}<collision><geometry><box size="{size}"/></geometry>'
        f'</collision>{contact}</link><joint name="to_{name}" type="{kind}">'
        f'<parent link="world"/><child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


def scene(*parts):
    return parse_description(
        f'<robot name="scene"><link name="world"/>{"".join(parts)}</robot>', "scene.urdf"
    )


WALL = part("wall", "0.1 4 0.4", "0.65 0 0.2")
_SECOND = part("second", xyz="0.37 0 0.1", kind="floating", mass=1.0)
BOX = part("box", xyz="0.5 0 0.1", kind="floating", mass=1.0, friction=0.5)


def ramp(*others, friction=None):
    """A ramp that begins 0.3 m before the robot; its surface goes through x = 0.3, z = 0."""
    x, z = math.cos(_SLOPE), math.sin(_SLOPE)
    below = 0.1 * np.array([z, -x])
    at = np.array([0.3, 0.0]) + np.array([x, z]) + below
    place = f"{at[0]} 0 {at[1]}", f"0 {-_SLOPE} 0"
    return scene(part("ramp", "2 2 0.2", *place, friction=friction), *others)


def among(description, **place):
    return simulate(scene=description, **place)


def pitch(simulation):
    """Of the nose, upwards, rad."""
    x, y, z, w = simulation.base_pose().rotation
    return -math.asin(2.0 * (w * y - z * x))


def go(simulation, speed, seconds):
    for _ in range(round(seconds / 0.01)):
        simulation.step([speed, speed], 0.01)


@pytest.mark.parametrize("yaw", [0.0, math.pi, 1.5])
def test_it_starts_at_rest_on_a_ramp(yaw):
    """Below a roof, not on it."""
    with among(ramp(part("roof", "2 2 0.1", "1.2 0 0.65")), x=1.2, yaw=yaw) as simulation:
        before = simulation.base_pose()
        assert before.translation[:2] == pytest.approx((1.2, 0.0), abs=0.03)
        assert pitch(simulation) == pytest.approx(_SLOPE * math.cos(yaw), abs=0.01)
        go(simulation, 0.0, 0.5)
        np.testing.assert_allclose(
            simulation.base_pose().translation, before.translation, atol=1e-4
        )


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ({"x": 0.65}, r"x 0\.65 m, y 0 m, yaw 0 rad: .* link wall of scene\.urdf"),
        ({"x": -0.5, "y": 0.8}, r"x -0\.5 m, y 0\.8 m: link box of scene\.urdf is there"),
    ],
)
def test_it_cannot_start_in_a_wall_or_a_box(place, text):
    box = part("box", xyz="-0.5 0.8 0.1", kind="floating", mass=1.0)
    with pytest.raises(OneBotError, match=text):
        among(scene(part("pillar", xyz="9 9 0.1"), WALL, box), **place)


def test_it_cannot_start_where_it_slides_away():
    with pytest.raises(OneBotError, match="cannot stand there, inside or on link ramp"):
        among(ramp(friction=0.01), x=0.6)


def test_teleport_into_a_wall_is_refused_and_onto_a_ramp_tilts():
    """Refused, nothing has changed, not by a bit; the boxes stay where they were pushed."""
    with among(scene(WALL, BOX.replace("0.5 0 0.1", "-2 0 0.1"))) as simulation:
        go(simulation, 2.0, 0.5)
        before = bits(simulation)
        with pytest.raises(OneBotError, match="link wall"):
            simulation.teleport(0.65, 0.0, 0.0)
        with pytest.raises(OneBotError, match="link box"):
            simulation.teleport(-2.0, 0.0, 0.0)
        assert bits(simulation) == before
        simulation.teleport(0.0, 1.0, 1.0)
        assert planar(simulation) == pytest.approx((0.0, 1.0, 1.0), abs=1e-9)
    with among(ramp()) as simulation:
        simulation.teleport(1.2, 0.0, 0.0)
        assert pitch(simulation) == pytest.approx(_SLOPE, abs=0.01)


def test_reset_puts_boxes_back_bit_for_bit():
    with among(scene(BOX)) as simulation:
        start, boxes = bits(simulation), simulation.scene.poses
        go(simulation, 4.0, 2.0)
        after, pushed = bits(simulation), simulation.scene.poses
        assert pushed != boxes
        simulation.reset()
        assert (bits(simulation), simulation.scene.poses) == (start, boxes)
        go(simulation, 4.0, 2.0)
        assert (bits(simulation), simulation.scene.poses) == (after, pushed)


def test_boxes_that_have_long_been_at_rest_move_again():
    """What touches one moves it, and one that goes back to where it began falls from there."""
    high = part("high", xyz="2 1 0.5", kind="floating", mass=1.0)
    with among(scene(BOX, high)) as simulation:
        go(simulation, 0.0, 4.0)
        poses = simulation.scene.poses
        assert poses[1][0][2] == pytest.approx(0.1, abs=1e-3)
        go(simulation, 0.0, 1.0)
        assert simulation.scene.poses == poses  # they sleep
        go(simulation, 4.0, 2.0)
        assert simulation.scene.poses[0][0][0] > 0.6
        for _ in range(2):
            simulation.reset()
            assert simulation.scene.poses[1][0][2] == pytest.approx(0.5)
            go(simulation, 0.0, 2.0)
            assert simulation.scene.poses[1][0][2] == pytest.approx(0.1, abs=1e-3)


def test_one_of_several_robots_puts_boxes_back_unless_a_robot_is_there():
    other = part("other", xyz="3 0 0.1", kind="floating", mass=1.0)
    spawns = [RobotSpawn(robot(), DRIVEN), RobotSpawn(robot(), DRIVEN, PlanarPose(0.0, 3.0))]
    with World(spawns, scene=scene(BOX, other)) as world:
        first, second = world.robots
        start = world.scene.poses
        pushed = [((1.0, 1.0, 0.1), (0.0, 0.0, 0.0, 1.0)), ((4.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0))]
        world.scene.put(pushed)
        second.teleport(3.0, 0.0, 0.0)
        assert world.scene.poses == pushed
        first.reset()
        assert world.scene.poses[0] == start[0]
        assert world.scene.poses[1] == pushed[1]


def test_a_scene_that_diverged_is_reported():
    with among(scene(BOX)) as simulation:
        simulation.scene.put([((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))])
        with pytest.raises(OneBotError, match="diverged"):
            simulation.step([0.0, 0.0], 0.01)


def test_what_is_fixed_to_a_box_moves_with_it():
    """Poses are of the first link, in the world, through all joints above it."""
    handle = part("handle", "0.05 0.05 0.05", "0 0 0.12").replace("world", "box")
    shelf = '<link name="shelf"/><joint name="s" type="fixed"><parent link="world"/>' + (
        '<child link="shelf"/><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint>'
    )
    description = scene(shelf, BOX.replace('parent link="world"', 'parent link="shelf"'), handle)
    with among(description) as simulation:
        [(at, (_, _, z, w))] = simulation.scene.poses
        assert at == pytest.approx((1.0, 0.5, 0.1))
        assert 2 * math.atan2(z, w) == pytest.approx(math.pi / 2)
        go(simulation, 0.0, 0.2)
        [(at, _)] = simulation.scene.poses
        assert at == pytest.approx((1.0, 0.5, 0.1), abs=1e-3)


def test_meshes_that_stand_still_are_not_filled(tmp_path):
    """A robot stands in a room that is one mesh; of a moving body the convex hull collides."""
    trimesh.creation.annulus(r_min=1.0, r_max=1.1, height=0.4).export(tmp_path / "room.stl")
    room = part("room").replace('box size="0.2 0.2 0.2"', f'mesh filename="{tmp_path}/room.stl"')
    with among(scene(room)) as simulation:
        go(simulation, 8.0, 4.0)
        assert planar(simulation)[0] == pytest.approx(1.0 - _FRONT, abs=0.02)


@pytest.mark.parametrize(
    ("parts", "texts"),
    [
        (
            [part("door", kind="continuous")],
            [r'joint "to_door" is continuous; .* type="fixed" .* type="floating"'],
        ),
        (
            [part("box", kind="floating")],
            ['link "box" cannot move without a mass above 0; .* an <inertial>'],
        ),
        (
            [part("box", kind="floating", mass=1.0).replace("collision", "visual")],
            ['"box" would fall through the ground: no link has a <collision>'],
        ),
        (
            [BOX.replace("0.5 0 0.1", "0.5 0 0")],
            ['"to_box": link "box" starts 0.1 m deep in the ground, .*; raise its <origin>'],
        ),
        (
            [WALL, BOX.replace("0.5 0 0.1", "0.52 0 0.1"), _SECOND],
            [
                '"to_box": link "box" starts 0.02 m deep in link "wall", .*; move its <origin>',
                '"to_second": link "second" starts 0.05 m deep in link "box", ',
            ],
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(parts, texts):
    with pytest.raises(OneBotError) as refused:
        among(scene(*parts))
    for text in texts:
        assert any(
            line.startswith("scene.urdf:") and re.search(text, line)
            for line in str(refused.value).splitlines()
        )


@pytest.mark.parametrize("deep", [0.0, 0.009])
def test_a_box_that_starts_a_little_in_something_is_pushed_out_of_it(deep):
    """Out of the ground, of a wall and of another box, by that and no more."""
    sunk = part("sunk", xyz=f"0 2 {0.1 - deep}", kind="floating", mass=1.0)
    second = part("second", xyz=f"0 2 {0.3 - deep}", kind="floating", mass=1.0)
    leaning = BOX.replace("0.5 0 0.1", f"{0.5 + deep} 0 0.1")
    with among(scene(WALL, leaning, sunk, second), x=-1.0) as simulation:
        go(simulation, 0.0, 1.0)
        places = [at for at, _ in simulation.scene.poses]
    for at, expected in zip(places, [(0.5, 0, 0.1), (0, 2, 0.1), (0, 2, 0.3)], strict=True):
        assert at == pytest.approx(expected, abs=1e-3)


def test_the_worlds_that_ship():
    """Read without a problem or a warning; a robot stands at 0, 0 and drives straight on."""
    for name in ("maze", "ramp"):
        description = load_world(name)
        assert not description.notices
        with among(description) as simulation:
            go(simulation, 4.0, 1.0)
            assert planar(simulation)[0] == pytest.approx(0.24, abs=0.02)


def test_a_world_is_named_or_a_path(tmp_path):
    """The error lists those that ship; one that cannot be simulated is refused when it is read."""
    with pytest.raises(OneBotError, match=r'no world "mase" \(did you mean "maze"\? .*ramp\); wri'):
        load_world("mase")
    with pytest.raises(OneBotError, match=r"mase\.urdf"):
        load_world(str(tmp_path / "mase.urdf"))
    package = "package://onebot_description/worlds/maze.urdf.xacro"
    assert load_world(package) == load_world("maze") == load_scene("maze")
    lost = part("lost").replace('box size="0.2 0.2 0.2"', 'mesh filename="no.stl"')
    for number, unfit in enumerate((BOX.replace("0.5 0 0.1", "0.5 0 0"), lost)):
        file = tmp_path / f"{number}.urdf"
        file.write_text(f'<robot name="scene"><link name="world"/>\n{unfit}</robot>')
        with pytest.raises(OneBotError, match=rf"^{file}:2: "):
            load_scene(str(file))


def test_a_capsule_is_one_for_physics_rays_and_wheels() -> None:
    """Of URDF 1.1: it rests on its side, rays meet its round end, and a wheel rolls on one."""
    capsule = '<geometry><capsule radius="0.1" length="0.4"/></geometry>'
    text = f"""<robot name="w" version="1.1"><link name="world"/><link name="pill">
      <visual>{capsule}</visual><collision>{capsule}</collision><inertial><mass value="1"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j" type="floating"><parent link="world"/><child link="pill"/>
      <origin xyz="2 0 0.15" rpy="0 1.5707963 0"/></joint></robot>"""
    world = parse_description(text)
    assert world.notices == ()
    wheel = '<capsule radius="0.06" length="0.004"/>'
    rolling = robot('<cylinder radius="0.06" length="0.004"/>', wheel).urdf
    description = parse_description(rolling.replace("<robot ", '<robot version="1.1" '))
    assert wheel[:-2] in rolling
    with Simulation(description, world=world) as simulation:
        simulation.run(1.0)
        assert simulation.boxes["pill"].z == pytest.approx(0.1, abs=1e-3)
        for y, length in ((0.0, 1.7), (0.06, 1.8 - 0.08)):
            assert simulation.ray((0.0, y, 0.1), (1, 0, 0)) == pytest.approx(length, abs=2e-3)
        assert simulation.ray((2.2, -1.0, 0.1), (0, 1, 0)) == pytest.approx(0.9, abs=2e-3)
        assert simulation.robot.wheel_radius == pytest.approx(0.06)
        simulation.robot.drive(-0.3)
        simulation.run(2.0)
        assert simulation.robot.pose.x == pytest.approx(simulation.robot.odometry.x, abs=1e-4)
        assert simulation.robot.pose.x < -0.3
