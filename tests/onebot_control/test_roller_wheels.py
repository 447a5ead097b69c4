"""Wheels with rollers drive by forces: robots with mecanum and omni wheels."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest

from onebot_control.drive.holonomic import HolonomicKinematics
from onebot_control.drive.wheels.rolling_shapes import Tyre
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.roller_wheels import with_rollers
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_description.description import Description, parse_description
from onebot_description.geometry.poses import PlanarPose, Triple
from onebot_description.model import RobotModel
from onebot_description.model.rigid_bodies import Body
from tests.onebot_control.drive_models import (
    CIRCLE,
    CORNERS,
    LENGTH,
    RADIUS,
    WIDTH,
    mecanum,
    omni,
    wheel,
)
from tests.onebot_control.drive_models import robot as on_wheels
from tests.onebot_control.simulation_support import bits, planar, robot
from tests.onebot_control.test_scene import part, scene

MASS, WHEEL_MASS, GRAVITY = 10.0, 0.5, 9.81
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


def _rolling(description: Description, rollers: dict[str, float], kinematics: Any) -> Rolling:
    """The robot with the angles of the rollers of its wheels; its base slides."""
    slides = '<link name="base"><contact><lateral_friction value="0.01"/></contact>'
    urdf = description.urdf.replace('<link name="base">', slides)
    tyres = {name: (TYRE, angle) for name, angle in rollers.items()}
    return Rolling(with_rollers(parse_description(urdf), tyres), tuple(rollers), kinematics)


MECANUM = _rolling(
    mecanum(),
    {f"mecanum_{name}_joint": -x * y * SLANT for name, (x, y) in CORNERS.items()},
    HolonomicKinematics.mecanum(RADIUS, LENGTH + WIDTH),
)
OMNI = _rolling(
    omni(),
    {f"w{row}_joint": 0.0 for row in range(3)},
    HolonomicKinematics.omni(RADIUS, CIRCLE, 3, 0.3),
)
both = pytest.mark.parametrize("model", [MECANUM, OMNI], ids=["mecanum", "omni"])


def _drive(model: Rolling, world: World, *legs: tuple[Triple, float]) -> None:
    """Drive by these twists for so many seconds each, within limits of acceleration."""
    now, most = np.zeros(3), FASTEST * PERIOD
    for twist, seconds in legs:
        for _ in range(round(seconds / PERIOD)):
            now += np.clip(np.array(twist) - now, -most, most)
            model.turn(world.robots[0], now)
            world.step(PERIOD)


@both
def test_it_drives_as_commanded(model: Rolling) -> None:
    """In the directions of the command, not only as its wheels say."""
    with World([model.spawn()]) as world:
        _drive(model, world, ((0.3, 0.2, 0.0), 3.0), ((0.0, 0.0, 0.0), 1.0))
        x, y, yaw = planar(world.robots[0])
    assert (x, y, yaw) == pytest.approx((0.9, 0.6, 0.0), abs=1e-3)


@both
def test_lifted_off_the_ground_it_does_not_move(model: Rolling) -> None:
    stand = scene(part("stand", "0.2 0.1 0.2", "0 0 0.1"))
    with World([model.spawn()], scene=stand, at_start=False) as world:
        (body,) = world.robots
        body.put(((0.0, 0.0, 0.1205), (0.0, 0.0, 0.0, 1.0)))
        world.step(0.5)
        before = planar(body)
        model.turn(body, (0.5, 0.4, 0.5))
        world.step(2.0)
        states, *_ = body.state()
        assert max(map(abs, states.velocities)) > 5.0
        assert planar(body) == pytest.approx(before, abs=1e-5)


@pytest.mark.parametrize("speed", [0.2, 2.0])
def test_mecanum_wheels_push_a_wall_with_their_friction(speed: float) -> None:
    wall = scene(part("wall", "0.1 4 1", "0.5 0 0.5"))
    with World([MECANUM.spawn()], scene=wall) as world:
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


@both
@pytest.mark.parametrize("yaw", [0.0, 0.9, math.pi / 2.0])
def test_it_drives_and_holds_on_a_ramp(model: Rolling, yaw: float) -> None:
    """Up, across and down a slope of 10 degrees, it follows its wheels, and stays when it rests."""
    ramp = scene(part("ramp", "6 6 0.2", "0 0 1", f"0 {-math.radians(10.0)} 0"))
    with World([model.spawn(yaw=yaw)], scene=ramp) as world:
        (body,) = world.robots
        body.turn([0.0] * len(model.joints))
        world.step(0.5)
        start = np.array(body.state()[1].translation)
        world.step(1.0)
        assert np.array(body.state()[1].translation) == pytest.approx(start, abs=1e-4)
        before = body.positions
        _drive(model, world, ((0.3, 0.2, 0.0), 2.0), ((0.0, 0.0, 0.0), 1.0))
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

    written = on_wheels(wheel("fl", (LENGTH, WIDTH, RADIUS)), name="one")
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
