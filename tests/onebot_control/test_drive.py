"""What every drive is, by a drive that no robot here has: it drives sideways, too, and steers."""

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from onebot_control.drive.drive import Drive
from onebot_control.drive.kinematics import DriveCommand, Kinematics, Share
from onebot_control.drive.odometry import Odometry
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_control.drive.wheels.geometry import Wheels
from onebot_description.description import Description
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity, Triple

RADIUS, LEVER = 0.1, 0.5  # m
SIGNS = np.array([(1, -1, -1), (1, 1, 1), (1, -1, 1), (1, 1, -1)]) * (1.0, 1.0, LEVER)


class Mecanum(Kinematics):
    """Four wheels with rollers at 45 degrees; a steering joint follows the direction of travel."""

    shares = tuple(Share(x / 4.0, y / 4.0, 4.0 * LEVER**2 / yaw) for x, y, yaw in SIGNS.tolist())

    def command(
        self, twist: Triple, steering: Sequence[float], dt: float = math.inf
    ) -> DriveCommand:
        angle = math.atan2(twist[1], twist[0])
        return DriveCommand(*twist, (SIGNS @ twist / RADIUS).tolist(), (angle,))

    def body_motion(self, turned: Sequence[float], steering: Sequence[float]) -> Triple:
        forward, left, turn = np.linalg.pinv(SIGNS) @ turned * RADIUS
        return float(forward), float(left), float(turn)

    def paths(self, motion: Triple) -> Sequence[float]:
        return cast(Sequence[float], (SIGNS @ motion).tolist())


@dataclass(frozen=True)
class Parameters(DriveParameters[None]):
    """Those that every drive has, and a limit of each axis."""

    @property
    def limits(self) -> Mapping[str, SpeedLimits]:
        names = ("linear.x", "linear.y", "angular.z")
        return {name: SpeedLimits(max_velocity=1.0 + row) for row, name in enumerate(names)}

    def noise(self, paths: int) -> Sequence[float]:
        return 0.01, 0.02, 0.03, 0.04

    def wheels(self, description: Description) -> Wheels:
        raise NotImplementedError

    def geometry(self, wheels: Any) -> None:
        return None

    def kinematics(self, geometry: None) -> Mecanum:
        return Mecanum()


class FourWheels:
    """Joints of a mecanum drive: the second wheel consists of two joints, one of them mirrored."""

    groups = (("fl",), ("fr", "fr2"), ("rr",), ("rl",))
    steering = ("steer",)
    directions = {"fl": 1.0, "fr": 1.0, "fr2": -1.0, "rr": 1.0, "rl": 1.0}  # noqa: RUF012
    axles = {"steer": SimpleNamespace(axis=(0.0, 0.0, 1.0))}  # noqa: RUF012
    skids = False


JOINTS = ("rl", "steer", "fr2", "rr", "fr", "fl")
UNEVEN = dict.fromkeys(JOINTS, 1.0) | {"fr": 1.5, "fr2": 0.5}  # the mean of a wheel's joints counts


@pytest.mark.parametrize("by_position", [True, False])
@pytest.mark.parametrize("wanted", [(0.5, 0.0, 0.0), (0.0, 0.6, 0.0), (0.3, -0.2, 0.7)])
def test_each_axis_is_driven_and_measured(by_position: bool, wanted: Triple) -> None:
    """By the wheels it is where constant velocities in its own axes lead, along an arc."""
    drive = Drive(cast(Wheels, FourWheels()), JOINTS, Parameters(position_feedback=by_position))
    dt, positions, velocities = 0.01, dict.fromkeys(JOINTS, 0.0), dict.fromkeys(JOINTS, 0.0)
    for cycle in range(301):
        drive.observe(*([UNEVEN[n] * at[n] for n in JOINTS] for at in (positions, velocities)), dt)
        if not cycle and not by_position:  # the wheels stand in the first cycle
            drive.odometry.forget_wheels()
        linear, lateral, angular = wanted
        assert drive.accept(linear, angular, lateral=lateral) is None
        command = drive.decide(dt)
        assert command[:3] == wanted
        names = [name for group in FourWheels.groups for name in group]
        velocities.update(zip(names, drive.velocities, strict=True))
        for name in names:
            positions[name] += velocities[name] * dt
        assert velocities["fr2"] == -velocities["fr"]
        assert drive.state(0.5).command.steering == (math.atan2(lateral, linear),)
    yaw = 3.0 * wanted[2]
    mean = (cmath.exp(1j * yaw) - 1.0) / (1j * yaw) if yaw else 1.0  # of the heading's unit vector
    end = 3.0 * complex(*wanted[:2]) * mean
    assert drive.odometry.pose == pytest.approx((end.real, end.imag, yaw), abs=1e-9)
    half = [component / 2.0 for component in wanted]
    assert drive.state(0.5).twist == pytest.approx(half)


def test_each_axis_has_its_limit() -> None:
    """A drive without the axis, such as a differential one, has no such velocity at all."""
    drive = Drive(cast(Wheels, FourWheels()), JOINTS, Parameters())
    drive.accept(9.0, -9.0, lateral=9.0)
    assert drive.decide(0.01)[:3] == (1.0, 2.0, -3.0)
    assert "linear.y nan" in str(drive.accept(0.1, 0.0, lateral=math.nan))
    drive.halt()
    assert drive.velocities == [0.0] * 5


def test_the_covariance_is_that_of_errors_of_the_wheels() -> None:
    """To first order, the pose at the end is off by the derivative times each wheel's error."""
    motion, noise = (0.04, -0.03, 0.08), (0.01, 0.02, 0.03, 0.04)
    kinematics = Mecanum()
    start = PlanarPose(0.0, 0.0, 0.3)

    def end(paths: Sequence[float]) -> "np.ndarray[Any, Any]":
        odometry = Odometry(kinematics)
        odometry.set_pose(*start)
        turned = [path / RADIUS for path in paths]
        odometry.update_open_loop(PlanarVelocity(*kinematics.body_motion(turned, ())), 1.0)
        return np.array(odometry.pose)

    paths, step = np.array(kinematics.paths(motion)), 1e-6
    columns = [(end(paths + e) - end(paths - e)) / (2.0 * step) for e in step * np.eye(4)]
    expected = sum(
        variance * abs(path) * np.outer(column, column)
        for column, variance, path in zip(columns, noise, paths, strict=True)
    )
    odometry = Odometry(kinematics, noise=noise)
    odometry.set_pose(*start)
    odometry.update_open_loop(PlanarVelocity(*motion), 1.0)
    xx, xy, yy, xt, yt, tt = odometry.covariance
    found = np.array([(xx, xy, xt), (xy, yy, yt), (xt, yt, tt)])
    assert found == pytest.approx(expected, rel=5e-3, abs=1e-7)
    assert found[2, 2] == pytest.approx(expected[2, 2], rel=1e-6)
