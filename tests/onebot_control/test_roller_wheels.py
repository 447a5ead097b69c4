"""Wheels with rollers drive by forces: robots with mecanum and omni wheels."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest

from onebot_control.drive.holonomic import HolonomicKinematics
from onebot_control.drive.odometry import Odometry
from onebot_control.drive.wheels.rolling_shapes import Tyre
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.roller_wheels import with_rollers
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.description import Description, parse_description
from onebot_description.geometry.poses import PlanarPose, Triple, yaw_of
from onebot_description.model import RobotModel
from onebot_description.model.rigid_bodies import Body
from tests.onebot_control.simulation_support import bits, planar, robot

RADIUS, MASS, WHEEL_MASS, GRAVITY = 0.05, 10.0, 0.5, 9.81
LENGTH, WIDTH, CIRCLE = 0.15, 0.14, 0.18  # m, of wheels from the middle
SLANT, TYRE = math.pi / 4.0, Tyre(RADIUS, 0.0)
PERIOD = 0.01
FASTEST = np.array([0.5, 0.5, 1.0])  # m/s^2 and rad/s^2


class Rolling(NamedTuple):
    """A robot with rollers."""

    description: Description
    joints: tuple[str, ...]
    kinematics: HolonomicKinematics

    @property
    def weight(self) -> float:
        return (MASS + WHEEL_MASS * len(self.joints)) * GRAVITY

    def spawn(self, **place: float) -> RobotSpawn:
        return RobotSpawn(self.description, self.joints, PlanarPose(**place))

    def turn(self, body: RobotBody, twist: Sequence[float]) -> None:
        x, y, turn = map(float, twist)
        body.turn(self.kinematics.command((x, y, turn)).wheels)


def _wheel(name: str, x: float, y: float, yaw: float) -> str:
    """A wheel whose axle points to the left of ``yaw``."""
    moment = WHEEL_MASS * RADIUS**2
    return (
        f'<link name="{name}"><inertial><mass value="{WHEEL_MASS}"/><inertia ixx="{0.3 * moment}" '
        f'iyy="{0.3 * moment}" izz="{0.5 * moment}" ixy="0" ixz="0" iyz="0"/></inertial><collision>'
        f'<geometry><cylinder radius="{RADIUS}" length="0.04"/></geometry></collision></link>'
        f'<joint name="{name}_joint" type="continuous"><parent link="base"/><child link="{name}"/>'
        f'<origin xyz="{x} {y} {RADIUS}" rpy="{-math.pi / 2.0} 0 {yaw}"/><axis xyz="0 0 1"/>'
        '<limit effort="20" velocity="60"/></joint>'
    )


def _robot(*wheels: str) -> Description:
    return parse_description(
        '<robot name="rolling"><link name="base">'
        '<contact><lateral_friction value="0.01"/></contact>'
        f'<inertial><origin xyz="0 0 0.08"/><mass value="{MASS}"/><inertia ixx="0.1" iyy="0.15" '
        'izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 0.13"/>'
        f'<geometry><box size="0.48 0.25 0.1"/></geometry></collision></link>'
        f"{''.join(wheels)}</robot>",
        "rolling.urdf",
    )


def _mecanum() -> Rolling:
    places = {"fl": (1, 1), "fr": (1, -1), "rr": (-1, -1), "rl": (-1, 1)}
    wheels = [_wheel(name, LENGTH * x, WIDTH * y, 0.0) for name, (x, y) in places.items()]
    rollers = {f"{name}_joint": (TYRE, -x * y * SLANT) for name, (x, y) in places.items()}
    kinematics = HolonomicKinematics.mecanum(RADIUS, LENGTH + WIDTH)
    return Rolling(with_rollers(_robot(*wheels), rollers), tuple(rollers), kinematics)


def _omni(count: int = 3) -> Rolling:
    angles = [0.3 + 2.0 * math.pi * row / count for row in range(count)]
    wheels = [
        _wheel(f"w{row}", CIRCLE * math.cos(angle), CIRCLE * math.sin(angle), angle - math.pi / 2.0)
        for row, angle in enumerate(angles)
    ]
    rollers = {f"w{row}_joint": (TYRE, 0.0) for row in range(count)}
    kinematics = HolonomicKinematics.omni(RADIUS, CIRCLE, count, 0.3)
    return Rolling(with_rollers(_robot(*wheels), rollers), tuple(rollers), kinematics)


MECANUM, OMNI = _mecanum(), _omni()
both = pytest.mark.parametrize("model", [MECANUM, OMNI], ids=["mecanum", "omni"])


class Driver:
    """Drives a robot within limits of acceleration, with odometry by its wheels."""

    def __init__(self, model: Rolling, world: World) -> None:
        self.model, self.world, (self.body,) = model, world, world.robots
        self._odometry = Odometry(model.kinematics)
        self._odometry.set_pose(*planar(self.body))
        self.driven = self.turned = 0.0
        self._twist = np.zeros(3)

    def drive(self, twist: Sequence[float], seconds: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            most = FASTEST * PERIOD
            self._twist += np.clip(np.array(twist) - self._twist, -most, most)
            self.model.turn(self.body, self._twist)
            before = self._wheels()
            self.world.step(PERIOD)
            angles = [now - then for now, then in zip(self._wheels(), before, strict=True)]
            motion = self.model.kinematics.body_motion(angles)
            self._odometry.update_from_positions(self._wheels(), PERIOD)
            self.driven += math.hypot(*motion[:2])
            self.turned += abs(motion[2])

    def _wheels(self) -> list[float]:
        rows = [self.body.joints.index(name) for name in self.model.joints]
        return [self.body.positions[row] for row in rows]

    def errors(self) -> tuple[float, float]:
        """How far odometry is from the true pose, as shares of what was driven and turned."""
        (x, y, _), rotation = self.body.pose
        yaw = yaw_of(*rotation)
        off = (
            math.dist((x, y), self._odometry.pose[:2]),
            math.remainder(yaw - self._odometry.heading, math.tau),
        )
        return off[0] / max(self.driven, 0.1), abs(off[1]) / max(self.turned, 0.1)


_ROUND = math.pi / 0.4  # s, of half a circle of 0.5 m radius at 0.2 m/s
PATHS: dict[str, list[tuple[Triple, float]]] = {
    "straight": [((0.5, 0.0, 0.0), 4.0)],
    "strafe": [((0.0, 0.5, 0.0), 4.0)],
    "diagonal": [((0.4, -0.3, 0.0), 4.0)],
    "turn": [((0.0, 0.0, 1.0), 2.0 * math.pi)],
    "half an eight": [((0.2, 0.0, 0.4), _ROUND), ((0.2, 0.0, -0.4), _ROUND)],
    "half an eight sideways": [((0.0, 0.2, 0.4), _ROUND), ((0.0, 0.2, -0.4), _ROUND)],
}


@both
@pytest.mark.parametrize("path", PATHS)
def test_odometry_is_within_a_two_thousandth_of_the_truth(model: Rolling, path: str) -> None:
    with World([model.spawn(yaw=0.2)]) as world:
        driver = Driver(model, world)
        for twist, seconds in PATHS[path]:
            driver.drive(twist, seconds)
        driver.drive((0.0, 0.0, 0.0), 1.5)
    assert max(driver.driven, driver.turned) > 1.9
    assert max(driver.errors()) <= 0.0005


@both
def test_it_drives_as_commanded(model: Rolling) -> None:
    """In the directions of the command, not only as its wheels say."""
    with World([model.spawn()]) as world:
        driver = Driver(model, world)
        driver.drive((0.3, 0.2, 0.0), 3.0)
        driver.drive((0.0, 0.0, 0.0), 1.0)
        x, y, yaw = planar(driver.body)
    assert (x, y, yaw) == pytest.approx((0.9, 0.6, 0.0), abs=1e-3)


STAND = parse_description(
    '<robot name="stand"><link name="world"/><link name="box"><collision><geometry>'
    '<box size="0.2 0.1 0.2"/></geometry></collision></link><joint name="fixed" type="fixed">'
    '<parent link="world"/><child link="box"/><origin xyz="0 0 0.1"/></joint></robot>',
    "stand.urdf",
)


@both
def test_lifted_off_the_ground_it_does_not_move(model: Rolling) -> None:
    with World([model.spawn()], scene=STAND, at_start=False) as world:
        (body,) = world.robots
        body.put(((0.0, 0.0, 0.1205), (0.0, 0.0, 0.0, 1.0)))
        world.step(0.5)
        before = planar(body)
        model.turn(body, (0.5, 0.4, 0.5))
        world.step(2.0)
        states, *_ = body.state()
        assert max(map(abs, states.velocities)) > 5.0
        assert planar(body) == pytest.approx(before, abs=1e-5)


WALL = parse_description(
    '<robot name="wall"><link name="world"/><link name="box"><collision><geometry>'
    '<box size="0.1 4 1"/></geometry></collision></link><joint name="fixed" type="fixed">'
    '<parent link="world"/><child link="box"/><origin xyz="0.5 0 0.5"/></joint></robot>',
    "wall.urdf",
)


@pytest.mark.parametrize("speed", [0.2, 2.0])
def test_mecanum_wheels_push_a_wall_with_their_friction(speed: float) -> None:
    with World([MECANUM.spawn()], scene=WALL) as world:
        (body,) = world.robots
        MECANUM.turn(body, (speed, 0.0, 0.0))
        world.step(2.0)
        points = world.bullet.getContactPoints(body.parts.body)
        loads = sum(point[9] for point in points if point[2] == body.parts.bullet.ground)
        push = sum(abs(point[9] * point[7][0]) for point in points)
    assert loads == pytest.approx(MECANUM.weight, rel=0.02)
    assert push == pytest.approx(loads * math.cos(SLANT), rel=0.01)


def _resistance(model: Rolling, heading: float, direction: float) -> float:
    """The friction of locked wheels when the robot is pushed hard, as a share of their load."""
    with World([model.spawn(yaw=heading)]) as world:
        (body,) = world.robots
        body.turn([0.0] * len(model.joints))
        world.step(0.1)
        angle = heading + direction
        along = np.array([math.cos(angle), math.sin(angle), 0.0])
        world.push(body, "base", np.zeros(3), 1.3 * model.weight * along, 1.0)
        world.step(0.15)
        _, _, velocity = body.state()
        assert np.array(velocity.linear) @ along > 0.1
        points = np.array(
            [
                [point[9], *(point[10] * np.array(point[11]) + point[12] * np.array(point[13]))]
                for point in world.bullet.getContactPoints(body.parts.body, world.bullet.ground)
                if point[9] > 0.0
            ]
        )
    return abs(float(points[:, 1:].sum(axis=0) @ along)) / float(points[:, 0].sum())


@both
@pytest.mark.parametrize("direction", [0.0, math.pi / 2.0])
def test_wheels_slip_at_the_same_force_at_all_headings(model: Rolling, direction: float) -> None:
    """Friction is limited by the load, whatever the direction of the world's axes."""
    limits = [_resistance(model, math.pi * row / 8.0 + 0.01, direction) for row in range(5)]
    assert max(limits) == pytest.approx(min(limits), rel=3e-3)
    if model is MECANUM:
        assert limits[0] == pytest.approx(math.cos(SLANT), rel=1e-3)


def _ramp(slope: float) -> Description:
    return parse_description(
        '<robot name="ramp"><link name="world"/><link name="box"><collision><geometry>'
        '<box size="6 6 0.2"/></geometry></collision></link><joint name="fixed" type="fixed">'
        '<parent link="world"/><child link="box"/>'
        f'<origin xyz="0 0 1" rpy="0 {-slope} 0"/></joint></robot>',
        "ramp.urdf",
    )


@both
@pytest.mark.parametrize("yaw", [0.0, 0.9, math.pi / 2.0])
def test_it_drives_and_holds_on_a_ramp(model: Rolling, yaw: float) -> None:
    """Up, across and down a slope of 10 degrees, it follows its wheels, and stays when it rests."""
    with World([model.spawn(yaw=yaw)], scene=_ramp(math.radians(10.0))) as world:
        (body,) = world.robots
        body.turn([0.0] * len(model.joints))
        world.step(0.5)
        start = np.array(body.state()[1].translation)
        world.step(1.0)
        assert np.array(body.state()[1].translation) == pytest.approx(start, abs=1e-4)
        before = body.positions
        driver = Driver(model, world)
        driver.drive((0.3, 0.2, 0.0), 2.0)
        driver.drive((0.0, 0.0, 0.0), 1.0)
        _, pose, _ = body.state()
        rows = [body.joints.index(name) for name in model.joints]
        way = model.kinematics.body_motion([body.positions[row] - before[row] for row in rows])
        gone = math.dist(pose.translation, start)
        assert gone == pytest.approx(math.hypot(*way[:2]), rel=1e-3)
        assert gone == pytest.approx(0.2 * math.sqrt(13.0), rel=0.01)


def _weave(model: Rolling, world: World) -> bytes:
    (body,) = world.robots
    for row in range(200):
        wave = row / 25.0
        model.turn(body, (0.3 * math.sin(wave), 0.3 * math.cos(1.3 * wave) - 0.3, math.sin(wave)))
        world.step(PERIOD)
    return bits(body)


@both
def test_runs_are_bit_identical(model: Rolling) -> None:
    with World([model.spawn()]) as world:
        first = _weave(model, world)
        world.reset()
        assert _weave(model, world) == first
        world.restart()
        assert _weave(model, world) == first
        saved = world.bullet.saveState()
        (body,) = world.robots
        after = _weave(model, world)
        world.bullet.restoreState(saved)
        body.read_again()
        assert _weave(model, world) == after
    with World([model.spawn()]) as world:
        assert _weave(model, world) == first


@both
def test_it_stands_still(model: Rolling) -> None:
    with World([model.spawn(yaw=0.4)]) as world:
        (body,) = world.robots
        start = planar(body)
        body.turn([0.0] * len(model.joints))
        world.step(10.0)
        assert planar(body) == pytest.approx(start, abs=2e-6)


def test_the_mass_of_a_wheel_stays_where_it_is() -> None:
    """What is simulated has the mass of the robot, and its center."""

    def whole(description: Description) -> Body:
        body, places = Body("base"), RobotModel.from_description(description).link_matrices({})
        for link in description.links:
            body.add(link, places[link.name])
        return body

    written = _robot(_wheel("fl", LENGTH, WIDTH, 0.0))
    simulated = with_rollers(written, {"fl_joint": (TYRE, -SLANT)})
    before, now = whole(written), whole(simulated)
    assert now.mass == pytest.approx(before.mass)
    assert now.center == pytest.approx(before.center, abs=1e-3)
    assert now.inertia == pytest.approx(before.inertia, abs=1e-3)


def test_a_robot_beside_it_drives_as_alone() -> None:
    """Plain wheels do what they do alone, to a micrometer, also where they slip."""

    def last(*spawns: RobotSpawn) -> Triple:
        with World(spawns) as world:
            world.robots[0].turn([3.0, 4.0])
            world.step(2.0)
            return planar(world.robots[0])

    plain = RobotSpawn(robot(), ("left_wheel_joint", "right_wheel_joint"))
    assert last(plain, MECANUM.spawn(x=5.0)) == pytest.approx(last(plain), abs=1e-6)
