"""What sensors measure, against formulas and a ray caster of ten lines; no ROS."""

import itertools
import math
import threading
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
import trimesh
from PIL import Image

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.drive_kinds import ControlConfig
from onebot_control.fleet import Fleet
from onebot_control.physics.robot_body import JointStates, MassVelocity
from onebot_control.prepared_robot import Member
from onebot_control.runtime.sensing import Channel, Sensing, SensingThread
from onebot_control.sensing import camera, imu, instrument, lidar, noise, painter, rays
from onebot_control.sensing.rays import cast
from onebot_control.sensing.sensors import INSTRUMENTS, Sensors
from onebot_control.sensing.surroundings import (
    Placed,
    SensedRobot,
    VisibleSurfaces,
)
from onebot_description.description import load_description, parse_description
from onebot_description.description.loading import load_world
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.imu import Imu, Reference
from onebot_description.description.sensors.kind_table import BY_TYPE
from onebot_description.description.sensors.lidar import Fan, Lidar
from onebot_description.description.sensors.noise import Noise
from onebot_description.elements.sensor import Sensor, SensorModel
from onebot_description.geometry import quaternions
from onebot_description.geometry.poses import Origin, Transform
from tests.onebot_control.control_support import WHEELS, robot
from tests.support import wait_for

LENS = Camera(1.0472, 33, 25, 0.1, 50.0, 0.1, 10.0)
HERE = np.eye(3), np.zeros(3)
STILL = (((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),)


def link(name: str, *visuals: str, kind: str = "fixed") -> str:
    """A link of a world, at its origin."""
    shapes = "".join(f"<visual>{each}</visual>" for each in visuals)
    return (
        f'<link name="{name}">{shapes}</link><joint name="to_{name}" type="{kind}">'
        f'<parent link="world"/><child link="{name}"/></joint>'
    )


def shape(inside: str, xyz: str = "0 0 0", rpy: str = "0 0 0", color: str = "") -> str:
    material = f'<material name="{color}"><color rgba="{color}"/></material>' if color else ""
    return f'<origin xyz="{xyz}" rpy="{rpy}"/><geometry>{inside}</geometry>{material}'


def still(tick: int, positions: Sequence[float], speeds: Sequence[float] = ()) -> Snapshot:
    """A robot whose base rests 2 m above the ground, while its joints may move."""
    zero = (0.0, 0.0, 0.0)
    joints = JointStates(tuple(positions), tuple(speeds) or (0.0,) * len(positions), ())
    pose, velocity = Transform((1.0, 2.0, 2.0), (*zero, 1.0)), MassVelocity(zero, zero, zero)
    return Snapshot(tick, joints, pose, velocity, 1.0, None)


def world(*links: str):
    return parse_description(f'<robot name="w"><link name="world"/>{"".join(links)}</robot>')


# The ray caster: o + t d at the ground, a box, a cylinder about z and a sphere in their own frames.


def to_ground(o, d):
    return np.where(d[:, 2] < 0, -o[:, 2] / d[:, 2], np.inf)


def to_box(o, d, half):
    with np.errstate(divide="ignore"):
        ends = np.sort([(-half - o) / d, (half - o) / d], axis=0)
    start, end = ends[0].max(axis=1), ends[1].min(axis=1)
    return np.where((start <= end) & (end > 0), np.where(start > 0, start, end), np.inf)


def to_round(o, d, radius, half=np.inf):
    flat = np.array([1, 1, half == np.inf])
    a, b, c = (flat * d * d).sum(1), (flat * o * d).sum(1), (flat * o * o).sum(1) - radius**2
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.stack([(-b + sign * np.sqrt(b * b - a * c)) / a for sign in (-1, 1)])
        inside = np.abs(o[:, 2] + t * d[:, 2]) <= half
        caps = np.stack([(end - o[:, 2]) / d[:, 2] for end in (-half, half)])
        on = ((o[None, :, :2] + caps[..., None] * d[:, :2]) ** 2).sum(-1) <= radius**2
        found = np.concatenate([np.where(inside, t, np.inf), np.where(on, caps, np.inf)])
        return np.where(found > 0, found, np.inf).min(axis=0)


def test_ranges_to_planes_cylinders_and_spheres_are_right_to_1_mm():
    """Over 1,000 random poses; each shape once standing still and once as a body that moves."""
    rng = np.random.default_rng(20)
    kinds = {
        '<box size="0.6 0.4 1.0"/>': lambda o, d: to_box(o, d, np.array([0.3, 0.2, 0.5])),
        '<cylinder radius="0.4" length="1.2"/>': lambda o, d: to_round(o, d, 0.4, 0.6),
        '<sphere radius="0.5"/>': lambda o, d: to_round(o, d, 0.5),
    }
    origins = np.array([(2.0, 0.3, 0.5), (-1.5, 1.8, 0.4), (0.0, -2.0, 0.6)])
    angles = np.array([(0.1, 0.2, 0.3), (0.4, 0.0, 1.0), (0.0, -2.0, 0.6)])
    stands = [
        link(
            f"still{n}", shape(text, " ".join(map(str, origins[n])), " ".join(map(str, angles[n])))
        )
        for n, text in enumerate(kinds)
    ]
    moves = [link(f"moving{n}", shape(text), kind="floating") for n, text in enumerate(kinds)]
    scene = VisibleSurfaces(world(*stands, *moves), [])
    sensor = Lidar(Fan(36, -math.pi, 3.0), Fan(), 0.0, 30.0)
    fan = lidar.lidar_rays(sensor)
    places = rng.uniform((-4, -4, 0.2), (4, 4, 1.5), (1000, 3, 3))
    turns = quaternions.from_rpy(rng.uniform(-1, 1, places.shape))
    positions = rng.uniform((-5, -5, 0.1), (5, 5, 2), (1000, 3))
    tilts = rng.uniform(-0.5, 0.5, (1000, 3)) * (1, 1, 6)
    rotations = quaternions.to_matrix(quaternions.from_rpy(tilts))
    scans = []
    for place, turn, position, rotation in zip(places, turns, positions, rotations, strict=True):
        boxes = [*zip(map(tuple, place), map(tuple, turn), strict=True)]
        hits = cast(fan, rotation, position, scene.still, Placed(scene, boxes, []).targets, 30.0)
        scans.append(lidar.ranges(sensor, hits))
    d = fan.singles.astype(float) @ rotations.transpose(0, 2, 1)
    o = np.broadcast_to(positions[:, None], d.shape)
    true = to_ground(o.reshape(-1, 3), d.reshape(-1, 3))
    still_turns = quaternions.from_rpy(angles)
    for n, caster in enumerate(kinds.values()):
        for at, turn in ((origins[n], still_turns[n]), (places[:, n, None], turns[:, n])):
            frame = quaternions.to_matrix(turn)
            rays = ((o - at) @ frame).reshape(-1, 3), (d @ frame).reshape(-1, 3)
            true = np.minimum(true, caster(*rays))
    true[true > 30.0] = np.inf
    measured = np.concatenate(scans)
    assert np.isfinite(true).sum() > 15_000
    np.testing.assert_allclose(measured, true, rtol=0.0, atol=1e-3)


def test_a_lidar_reports_what_is_out_of_range_and_clamps_its_noise():
    wall = world(link("wall", shape('<box size="1 8 2"/>', "2.5 0 1")))
    scene = VisibleSurfaces(wall, [])
    sensor = Lidar(Fan(3, -0.5, 0.5), Fan(4, -0.2, 0.2), 0.5, 10.0, Noise(stddev=0.1))
    fan = lidar.lidar_rays(sensor)

    def measured(x: float, generator=None):
        at = np.array([x, 0.0, 1.0])
        hits = cast(fan, np.eye(3), at, scene.still, Placed(scene, [], []).targets, 10.1)
        return lidar.ranges(sensor, hits, 0.0, generator)

    up, across = (
        each.ravel()
        for each in np.meshgrid([-0.2, -0.2 / 3, 0.2 / 3, 0.2], [-0.5, 0, 0.5], indexing="ij")
    )
    np.testing.assert_allclose(measured(0.0), 2 / np.cos(across) / np.cos(up), atol=1e-5)
    assert (measured(1.7)[across == 0] == -np.inf).all()  # nearer than the least range
    assert (measured(4.0)[up > 0] == np.inf).all()  # nothing ahead, and the ground behind
    noisy = measured(0.0, noise.noise_generator("a", 3))
    assert 0.02 < np.abs(noisy - measured(0.0)).mean() < 0.3
    assert (measured(1.4999, noise.noise_generator("a", 3)) >= 0.5).all()
    points = lidar.cloud(sensor, fan, measured(0.0), HERE)
    assert points.shape == (4, 3) and points.dtype.itemsize == 32
    np.testing.assert_allclose(points["x"], 2.0, atol=1e-5)
    assert points["ring"][:, 0].tolist() == [0, 1, 2, 3]
    assert np.isinf(lidar.cloud(sensor, fan, measured(4.0), HERE)["z"][-1]).all()


@pytest.mark.parametrize("kind", ["fixed", "continuous"])
@pytest.mark.parametrize("model", [Lidar(Fan(90, -3.0, 3.0), Fan(), 0.1, 9.0), LENS])
def test_a_sensor_sees_out_of_the_housing_that_it_is_fixed_in(model: SensorModel, kind: str):
    """It has no shape itself; a bar in front is seen, and so is a link that turns around it."""
    size, bar = '<box size="0.08 0.08 0.06"/>', shape('<box size="0.05 4 1"/>', "0.5 0 0")
    case = shape(size, color="1 0 0 1")
    joints = "".join(
        f'<joint name="{child}" type="{of}"><parent link="base"/><child link="{child}"/></joint>'
        for child, of in (("case", kind), ("eye", "fixed"))
    )
    text = (
        f'<robot name="r"><link name="base"><visual>{bar}</visual></link><link name="eye"/>'
        f'<link name="case"><visual>{case}</visual></link>{joints}</robot>'
    )
    robot = SensedRobot(parse_description(text), ("case",) if kind == "continuous" else (), {})
    sensors = Sensors(None, 100.0, 9.81)
    sensors.enter(0, robot)
    positions = (0.0,) * len(robot.joints)
    world = sensors.world(sensors.frame(0, [still(0, positions)], ()))
    found = Sensor("eye", "eye", Origin(), 10.0, {"depth": "", "scan": ""}, "eye", model)
    instrument = INSTRUMENTS[type(model)](found, 0, "/", 100.0, noisy=False)
    output = "scan" if isinstance(model, Lidar) else "depth"
    middle = instrument.measure(world, {output})[output].ravel()
    ahead = middle[len(middle) // 2]
    assert ahead == (pytest.approx(0.475, abs=0.01) if kind == "fixed" else -math.inf)


def test_pybullet_casts_the_rays_where_there_is_no_embree(monkeypatch: pytest.MonkeyPatch):
    shapes = [
        shape('<cylinder radius="0.5" length="2"/>', "3 0 1"),
        shape('<box size="1 1 1"/>', "0 3 0"),
    ]
    sensor = Lidar(Fan(360, -3.0, 3.0), Fan(), 0.1, 20.0)
    fan, at = lidar.lidar_rays(sensor), np.array([0.0, 0.0, 0.4])

    def distances():
        scene = VisibleSurfaces(
            world(link("still", *shapes), link("box", shapes[1], kind="floating")), []
        )
        placed = Placed(scene, [((-2.0, -2.0, 0.0), (0.0, 0.0, 0.3, 0.95))], [])
        return cast(fan, np.eye(3), at, scene.still, placed.targets, 20.0).distances

    exact = distances()
    monkeypatch.setattr(rays, "HAS_EMBREE", False)
    near = exact < 20
    assert 40 < near.sum() < 360
    assert (np.abs(distances() - exact) < 0.02).mean() > 0.98


def seen(scene, sensor, at, boxes=()):
    """What the rays of a camera there meet, and its picture."""
    pixels, targets = camera.camera_rays(sensor), Placed(scene, boxes, []).targets
    hits = cast(pixels, np.eye(3), at, scene.still, targets, camera.reach(sensor))
    return hits, painter.Painter(scene.still).picture(sensor, pixels, at, hits, targets)


def test_a_picture_shows_a_box_where_it_is_with_its_color_and_depth():
    """Its corners are within a pixel, its depth within 2 mm, and the cloud is the depth."""
    scene = VisibleSurfaces(
        world(link("box", shape('<box size="1 1 1"/>', "3 0 1.5", color="0 0 1 1"))), []
    )
    sensor = Camera(1.0472, 320, 240, 0.1, 50.0, 0.1, 10.0)
    pixels, at = camera.camera_rays(sensor), np.array([0.0, 0.2, 1.3])
    focal = camera.focal_length(sensor)
    assert focal == pytest.approx(320 / (2 * math.tan(1.0472 / 2)))
    hits, picture = seen(scene, sensor, at)
    found = camera.depths(sensor, hits)
    blue = (picture[..., 2] > 60) & (picture[..., :2] < 5).all(axis=-1)
    rows, columns = np.nonzero(blue)
    # The front face is 2.5 m away; u = cx - f y / x, v = cy - f z / x.
    sides = [160 - focal * (y - 0.2) / 2.5 for y in (0.5, -0.5)]
    ends = [120 - focal * (z - 1.3) / 2.5 for z in (2.0, 1.0)]
    assert [columns.min(), columns.max()] == pytest.approx(sides, abs=1)
    assert [rows.min(), rows.max()] == pytest.approx(ends, abs=1)
    np.testing.assert_allclose(found[blue], 2.5, atol=2e-3)
    assert (found[:20][~blue[:20]] == np.inf).all()
    below = found[239, 160]  # the ground: f h / (v - cy)
    assert below == pytest.approx(focal * 1.3 / (239 - 120), abs=2e-3)
    sky, ground = picture[2, 160].astype(int), picture[239, 160].astype(int)
    assert sky[2] > sky[0] + 30 and np.ptp(ground) < 15
    optical = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    points = camera.cloud(pixels, found, picture, (optical, np.zeros(3)))
    v, u = 120, 170
    place = [points[name][v, u] for name in "xyz"]
    assert place == pytest.approx([(u - 160) / focal * 2.5, (v - 120) / focal * 2.5, 2.5], abs=1e-3)
    red, green, blueness = picture[v, u]
    assert points["rgb"][v, u] == red << 16 | green << 8 | blueness
    near = Camera(1.0472, 320, 240, 0.1, 50.0, 2.6, 10.0)
    assert camera.depths(near, hits)[v, u] == -np.inf


def test_a_texture_of_a_mesh_is_seen(tmp_path: Path):
    """A square of 1 m, 2 m ahead, its picture red above and green below."""
    colors = np.zeros((2, 1, 3), np.uint8)
    colors[0, 0], colors[1, 0] = (255, 0, 0), (0, 255, 0)
    Image.fromarray(colors).save(tmp_path / "flag.png")
    (tmp_path / "flag.mtl").write_text("newmtl flag\nmap_Kd flag.png\n")
    (tmp_path / "flag.obj").write_text(
        "mtllib flag.mtl\nusemtl flag\nv 0 -0.5 0\nv 0 0.5 0\nv 0 0.5 1\nv 0 -0.5 1\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    flag = f'<mesh filename="file://{tmp_path}/flag.obj"/>'
    for kind, boxes in (("fixed", ()), ("floating", STILL)):
        scene = VisibleSurfaces(world(link("flag", shape(flag, "2 0 0"), kind=kind)), [])
        sensor = Camera(0.6, 40, 40, 0.1, 9.0, 0.1, 9.0)
        _, picture = seen(scene, sensor, np.array([0.0, 0.0, 0.5]), boxes)
        above, below = picture[10, 20].astype(int), picture[30, 20].astype(int)
        assert above[0] > 60 and above[1] == 0 and below[1] > 60 and below[0] == 0, kind


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
def test_a_mirrored_mesh_is_lit_from_outside(tmp_path: Path, scale: tuple[float, ...]):
    """By the sign of its scale's product its triangles are wound as before or the other way."""
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "box.stl")
    scales = " ".join(map(str, scale))
    mirrored = f'<mesh filename="file://{tmp_path}/box.stl" scale="{scales}"/>'
    sensor = Camera(0.6, 40, 40, 0.1, 9.0, 0.1, 9.0)
    pictures = []
    for text in (mirrored, '<box size="1 1 1"/>'):
        scene = VisibleSurfaces(world(link("box", shape(text, "2 0 0.5"))), [])
        outwards = scene.still.normals * scene.still.solid.corners[scene.still.solid.faces[:, 0]]
        assert ((outwards - scene.still.normals * (2, 0, 0.5)).sum(axis=1) > 0.4).all()
        pictures.append(seen(scene, sensor, np.array([0.0, 0.0, 1.2]))[1])
    np.testing.assert_array_equal(*pictures)


def test_onebot_pushed_against_a_wall_looks_at_it_from_outside():
    """Its camera stands 6 mm out of its base, and stops with it."""
    onebot = load_description(
        "package://onebot_description/urdf/onebot.urdf.xacro", {"sensors_enabled": "true"}
    )
    size = '<geometry><box size="0.2 8 3"/></geometry>'
    scene = parse_description(
        f'<robot name="w"><link name="world"/><link name="wall"><visual>{size}</visual>'
        f'<collision>{size}</collision></link><joint name="j" type="fixed"><parent link="world"/>'
        '<child link="wall"/><origin xyz="2.1 0 1.5"/></joint></robot>'
    )
    config = ControlConfig.from_parameters({"x": 1.7, "yaw": 0.02, "cmd_vel_timeout": 9.0})
    with Fleet.from_members([Member(onebot, config)], scene=scene) as fleet:
        fleet.robots[0].accept(0.3, 0.0)
        state = [fleet.cycle()[0] for _ in range(300)][-1]
        plant, held = fleet.robots[0].body, fleet.robots[0].held
    around = VisibleSurfaces(scene, [SensedRobot(onebot, plant.joints, held)])
    placed = Placed(around, (), [(state.pose, state.joints.positions)])
    camera_link = placed.link(0, "camera_link")
    assert camera_link is not None
    corners = np.array([*itertools.product((-0.003, 0.003), (-0.025, 0.025), (-0.007, 0.007))])
    x = (corners @ camera_link.rotation.T + camera_link.position)[:, 0].max()
    assert 1.995 < x < 2.0005, x  # the wall's face is at 2
    model = next(each.model for each in onebot.sensors if each.name == "camera")
    pixels = camera.camera_rays(model)
    own = around.target(0, "camera_link")
    hits = cast(pixels, *camera_link, around.still, placed.targets, 8.0, [own])
    assert (hits.surfaces == 0).all() and hits.distances.max() < 0.02


def test_noise_depends_on_sensor_and_time_only():
    given = np.full(100_000, 3.0, np.float32)
    model = Noise(0.5, 0.2)

    def drawn(name: str, tick: int, model: Noise = model):
        return noise.add_noise(given, model, 0.0, noise.noise_generator(name, tick))

    first = drawn("a", 7)
    assert first.tobytes() == drawn("a", 7).tobytes()
    assert first.tobytes() not in (drawn("a", 8).tobytes(), drawn("b", 7).tobytes())
    assert first.mean() == pytest.approx(3.5, abs=5 * 0.2 / math.sqrt(1e5))
    assert first.std() == pytest.approx(0.2, rel=0.02)
    steps = drawn("a", 7, Noise(0.0, 0.2, precision=0.25)) / 0.25
    np.testing.assert_array_equal(steps, np.round(steps))
    offsets = [
        noise.bias(Noise(0, 0, 1.0, 0.1), noise.noise_generator(str(n), -1)) for n in range(400)
    ]
    assert np.abs(offsets).mean() == pytest.approx(1.0, abs=0.03)
    assert 0.4 < (np.array(offsets) > 0).mean() < 0.6


# Inertial measurements, of the real simulation too ------------------------------------------------


def test_an_imu_measures_the_derivatives_of_any_motion():
    """Against differences of positions: p(t), R(t) of a spiral, at ten times the precision."""

    def pose(t: float):
        yaw = 0.8 * t + 0.1 * t * t
        turn = quaternions.to_matrix(quaternions.from_rpy((0.05 * math.sin(t), 0.1, yaw)))
        return turn, np.array([math.cos(t), 0.5 * t, 0.02 * t * t])

    def motion(t: float, h: float = 1e-5):
        turns, places = map(np.array, zip(*map(pose, (t - h, t, t + h)), strict=True))
        return imu.ImuMotion.through(turns, places, h)

    def sensor(t: float):
        return pose(t)[1]

    t, dt, h = 2.0, 0.01, 1e-4
    angular, linear = imu.measure(motion(t - dt), motion(t), dt, 9.81)
    middle = t - dt / 2  # a period's mean acceleration is that in its middle
    acceleration = (sensor(middle + h) - 2 * sensor(middle) + sensor(middle - h)) / h**2
    true = pose(middle)[0].T @ acceleration + pose(t)[0].T @ (0, 0, 9.81)
    np.testing.assert_allclose(linear, true, atol=1e-3)
    skew = pose(t)[0].T @ (pose(t + h)[0] - pose(t - h)[0]) / (2 * h)
    np.testing.assert_allclose(angular, [skew[2, 1], skew[0, 2], skew[1, 0]], atol=1e-4)
    resting = imu.ImuMotion(*pose(t), np.zeros(3), np.zeros(3))
    angular, linear = imu.measure(resting, resting, dt, 9.81)
    assert not angular.any()
    np.testing.assert_allclose(linear, pose(t)[0].T @ (0, 0, 9.81), atol=1e-12)


MOUNT = Origin((0.1, 0.0, 0.2), (0.0, 0.0, math.pi / 2))
AXES_OF_MOUNT = quaternions.to_matrix(quaternions.from_rpy(MOUNT.rpy))


def sensed(driven: ControlledRobot) -> SensedRobot:
    return SensedRobot(driven.description, driven.joints, driven.held)


def inertia(robot: SensedRobot, snapshots: Sequence[Snapshot], link: str):
    """What an IMU on a link measures in each snapshot but the first, in the link's axes."""
    sensors = Sensors(None, 100.0, 9.81)
    sensors.enter(0, robot)
    sensor = Sensor("imu", link, MOUNT, 100.0, {"imu": "imu"}, link, Imu())
    instrument = imu.ImuInstrument(sensor, 0, "/", 100.0, noisy=False)
    for before, now in itertools.pairwise(snapshots):
        sensors.last = [before]
        world = sensors.world(sensors.frame(0, [now], ()))
        yield [AXES_OF_MOUNT @ each for each in instrument.measure(world, {"imu"})["imu"][1:]]


ONEBOT = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
GRAVITY = np.array([0.0, 0.0, 9.81])
SLOPE = math.radians(5)


@pytest.mark.parametrize(
    ("scene", "command", "expected"),
    [
        ("", (0.0, 0.0), GRAVITY),
        ("ramp", (0.0, 0.0), (9.81 * math.sin(SLOPE), 0.0, 9.81 * math.cos(SLOPE))),
        ("", (0.5, 1.0), (-0.1, 0.5, 9.81)),  # x is -w^2 r, y is v w
    ],
    ids=["at rest", "on a ramp", "in a turn"],
)
def test_an_imu_measures_a_simulated_robot(scene, command, expected):
    """Where its motion is steady."""
    config = ControlConfig.from_parameters({"x": 1.0, "cmd_vel_timeout": 9.0})
    around = load_world(scene) if scene else None
    with Fleet.from_members([Member(ONEBOT, config)], scene=around) as fleet:
        [driven] = fleet.robots
        driven.accept(*command)
        snapshots = [fleet.cycle()[0] for _ in range(220)][200:]
    for angular, linear in inertia(sensed(driven), snapshots, "base_link"):
        np.testing.assert_allclose(angular, [0.0, 0.0, command[1]], atol=0.02)
        np.testing.assert_allclose(linear, expected, atol=0.05)


def test_an_imu_feels_no_cycle_that_comes_late():
    """It changes how long a second of the clock is, but not how the robot moves."""
    config = ControlConfig.from_parameters({"cmd_vel_timeout": 9.0})
    with Fleet.from_members([Member(ONEBOT, config)]) as fleet:
        [driven] = fleet.robots
        driven.accept(0.5, 1.0)
        snapshots = [fleet.cycle()[0] for _ in range(200)]
        driven.wait(fleet.period, stalled=True)
        snapshots.append(fleet.cycle()[0])
    [(angular, linear)] = inertia(sensed(driven), snapshots[-2:], "base_link")
    assert snapshots[-1].pace == pytest.approx(10 / 11)
    np.testing.assert_allclose(angular, [0.0, 0.0, 10 / 11], atol=0.02)  # as in the odometry
    np.testing.assert_allclose(linear, (-0.1, 0.5, 9.81), atol=0.05)


def test_an_imu_on_a_link_that_moves_measures_that_motion_too():
    """Its arm turns at 2 rad/s on a base at rest; it is 0.1 m away from the axis."""
    arm = parse_description(
        '<robot name="r"><link name="base"/><link name="arm"/>'
        '<joint name="pan" type="continuous"><parent link="base"/><child link="arm"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    snapshots = [still(tick, (0.02 * tick,), (2.0,)) for tick in range(3)]
    for angular, linear in inertia(SensedRobot(arm, ("pan",), {}), snapshots, "arm"):
        np.testing.assert_allclose(angular, [0.0, 0.0, 2.0], atol=1e-6)
        np.testing.assert_allclose(linear, (-0.4, 0.0, 9.81), atol=1e-3)


@pytest.mark.parametrize(
    ("reference", "forward"),
    [
        (Reference(), (math.cos(0.7), math.sin(0.7), 0.0)),  # east, north, up
        (Reference((math.pi, 0.0, math.pi / 2)), (math.sin(0.7), math.cos(0.7), 0.0)),  # NED
        (Reference((0.0, 0.0, math.pi / 2)), (math.sin(0.7), -math.cos(0.7), 0.0)),  # NWU
        (Reference(at_start=True), (math.cos(0.5), math.sin(0.5), 0.0)),  # has turned by 0.5
        (Reference((0.0, 0.0, 0.5), at_start=True), (1.0, 0.0, 0.0)),
    ],
)
def test_an_orientation_is_in_the_axes_that_the_imu_names(reference, forward):
    """Where the robot's x, which faces 0.7 rad to the left of east, points in these axes."""
    rotation = quaternions.to_matrix(quaternions.from_rpy((0.0, 0.0, 0.7)))
    start = quaternions.from_rpy((0.0, 0.0, 0.2)).tolist()
    turn = imu.orientation(Imu(reference=reference), rotation, start)
    assert turn is not None
    assert quaternions.rotate(turn, np.array([1.0, 0.0, 0.0])) == pytest.approx(forward, abs=1e-9)
    up = quaternions.rotate(turn, np.array([0.0, 0.0, 1.0]))
    assert up[2] == pytest.approx(-1.0 if reference.rpy[0] else 1.0)
    assert imu.orientation(Imu(reference=None), rotation, start) is None


def test_each_kind_of_sensor_has_an_instrument() -> None:
    models = {get_type_hints(kind.read)["return"] for kind in BY_TYPE.values()}
    assert models == INSTRUMENTS.keys()


# The thread -------------------------------------------------------------------------------------


class Subscriber:
    """Takes measurements of the outputs that it wants, one at a time."""

    def __init__(self, *wanted: str, waiting: bool = False) -> None:
        self.outputs = frozenset(wanted)
        self.stamps: list[int] = []
        self.published: list[frozenset[str]] = []
        self.go = threading.Semaphore(0) if waiting else None

    @property
    def topics(self) -> dict[str, str]:
        return {output: f"/{output}" for output in self.outputs}

    def wanted(self) -> frozenset[str]:
        return self.outputs

    def publish(self, stamp: int, outputs: Mapping[str, object]) -> None:
        if self.go:
            self.go.acquire()
        self.last = outputs
        self.stamps.append(stamp)
        self.published.append(frozenset(outputs))


@pytest.mark.parametrize("joints", [("pan",), ("pan", "tilt")])
def test_an_imu_feels_no_motion_from_a_robot_to_the_one_that_replaces_it(joints: tuple[str, ...]):
    """Whose joints may be others, and stand still where the old ones turned."""

    def arm(*names: str) -> SensedRobot:
        links = "".join(
            f'<link name="{name}"/><joint name="{name}" type="continuous"><parent link="base"/>'
            f'<child link="{name}"/><axis xyz="0 0 1"/></joint>'
            for name in names
        )
        text = f'<robot name="r"><link name="base"/>{links}</robot>'
        return SensedRobot(parse_description(text), names, {})

    outlet, sensing = Subscriber("imu"), Sensing(Sensors(None, 100.0, 9.81))
    sensor = Sensor("imu", "pan", MOUNT, 100.0, {"imu": "imu"}, "pan", Imu())
    instrument = imu.ImuInstrument(sensor, 0, "/", 100.0, noisy=False)
    channel = Channel(instrument, outlet, 100.0)
    for tick, names, speed in ((0, ("pan",), 2.0), (1, joints, 0.0)):
        sensing.enter(0, arm(*names), [channel])
        snapshot = still(tick, (0.0,) * len(names), (speed,) * len(names))
        assert sensing.due(tick) == {0}
        sensing.take(tick, [snapshot], ())
    np.testing.assert_allclose(outlet.last["imu"][2], GRAVITY, atol=1e-9)


@contextmanager
def sensing_of(*sensors: Sensor, patient: bool = False, **subscribers: Subscriber):
    """Drive one robot; gives what does cycles, the channels, and warnings."""
    warnings: list[str] = []
    failures: list[BaseException] = []
    description = robot()
    with Fleet.from_members([Member(description, ControlConfig.from_parameters(WHEELS))]) as fleet:
        driven = fleet.robots[0]
        sensing = SensingThread(
            Sensors(None, 100.0, 9.81), warnings.append, failures.append, lambda: patient
        )
        found = [
            Channel(
                INSTRUMENTS[type(each.model)](each, 0, "/", 100.0), subscribers[each.name], 100.0
            )
            for each in sensors
        ]
        sensing.enter(0, SensedRobot(description, driven.body.joints, driven.held), found)

        def cycle() -> frozenset[int]:
            """Do a cycle, publish it twice, as while paused; return whose sensor was due."""
            snapshots = fleet.cycle()
            tick = snapshots[0].tick
            due = sensing.due(tick)
            sensing.take(tick, snapshots, ())
            assert sensing.due(tick) == set()
            return due

        sensing.start()
        try:
            yield cycle, found, warnings
        finally:
            sensing.stop()
    assert not failures


FAN = Lidar(Fan(3, -1.0, 1.0), Fan(), 0.1, 9.0)
SLOW = Sensor("slow", "base_link", Origin(), 50.0, {"scan": "scan"}, "base_link", FAN)
EYE = Camera(1.0, 8, 6, 0.1, 9.0, 0.1, 9.0)


def test_what_is_too_slow_is_dropped_the_newest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop never waits; what the sensor reaches is a warning."""
    monkeypatch.setattr("onebot_control.runtime.sensing._WINDOW", 16)
    outlet = Subscriber("scan", waiting=True)
    with sensing_of(SLOW, slow=outlet) as (cycle, (channel,), warnings):
        for tick in range(40):
            assert cycle() == ({0} if tick % 2 == 0 else set())
        asked = channel.given
        assert channel.dropped == 20 - asked and 4 <= asked <= 6
        outlet.go.release(asked)
        wait_for(lambda: channel.done == asked, "what was waiting")
    assert outlet.stamps == [2 * each for each in range(asked)]
    assert any('sensor "slow" reaches' in text and "of 50 Hz" in text for text in warnings)


def test_a_patient_thread_is_waited_for() -> None:
    """Faster than real time, and in steps: nothing is left out."""
    outlet = Subscriber("scan", waiting=True)
    with sensing_of(SLOW, patient=True, slow=outlet) as (cycle, (channel,), warnings):
        slow = threading.Timer(0.3, lambda: outlet.go.release(20))
        slow.start()
        for _ in range(40):
            cycle()
        wait_for(lambda: channel.done == 20, "the measurements")
        slow.join()
    assert outlet.stamps == [2 * each for each in range(20)]
    assert channel.dropped == 0 and not warnings


def test_nothing_is_measured_that_nobody_subscribes_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """No ray of a camera is cast before; then only what is wanted is made of them."""
    casts: list[object] = []
    monkeypatch.setattr(
        instrument, "cast", lambda rays, *others: casts.append(rays) or cast(rays, *others)
    )
    topics = {output: output for output in ("image", "depth", "camera_info", "points")}
    camera_block = Sensor("eye", "base_link", Origin(), 100.0, topics, "base_link", EYE)
    outlet = Subscriber()
    with sensing_of(camera_block, eye=outlet) as (cycle, (channel,), warnings):

        def measured(*wanted: str) -> frozenset[str]:
            """What is published in a cycle while somebody subscribes to these."""
            outlet.outputs, before = frozenset(wanted), len(outlet.published)
            assert cycle() == {0}
            wait_for(lambda: len(outlet.published) > before, "the measurement")
            return outlet.published[-1]

        for _ in range(20):
            assert cycle() == set()  # nor are transforms published for it
        assert (channel.given, channel.dropped) == (0, 0)
        assert measured("camera_info") == {"camera_info"} and not casts
        assert measured("depth") == {"camera_info", "depth"} and len(casts) == 1
        assert measured("points") == topics.keys()
        assert len(outlet.published) == 3 and not warnings


def test_a_sensor_that_keeps_up_but_for_a_moment_is_not_reported() -> None:
    """It would be "15 of 15 Hz"."""
    found = Sensor("eye", "base_link", Origin(), 15.0, {"image": "image"}, "base_link", EYE)
    channel = Channel(INSTRUMENTS[Camera](found, 0, "/", 100.0), Subscriber(), 100.0)
    for done, dropped, warning in (
        (99, 0, ""),
        (95, 5, ""),
        (95 + 66, 5 + 34, 'sensor "eye" reaches 9.9 of 15 Hz'),
        (95 + 66 + 100, 5 + 34, ""),
    ):
        channel.done, channel.dropped = done, dropped
        assert channel.warning().partition(":")[0] == warning
