"""Computes inertial measurements from two states of a rigid body, and its orientation."""

from typing import NamedTuple

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.description.description import Imu, Noise
from onebot_description.geometry import quaternions
from onebot_description.geometry.poses import Quaternion


class Motion(NamedTuple):
    """Velocity and orientation of a rigid body."""

    linear: Floats  # (3,), velocity of its origin in its own axes, m/s
    angular: Floats  # (3,), angular velocity in its own axes, rad/s
    rotation: Floats  # (3, 3), of the body in the world


def noises(sensor: Imu) -> tuple[Noise, ...]:
    """Return the noise of each of the six values that ``measure`` returns."""
    return (*sensor.angular_velocity, *sensor.linear_acceleration)


def measure(
    before: Motion | None,
    now: Motion,
    period: float,
    mount: tuple[Floats, Floats],
    gravity: float,
) -> tuple[Floats, Floats]:
    """Return angular velocity (3,), rad/s, and linear acceleration (3,), m/s^2, in a sensor's axes.

    An accelerometer also measures the reaction to gravity (REP-145): R^T (a - g). The acceleration
    is the mean over a period, dv/dt + w x v with velocities v in the body's axes, which is exact in
    a steady turn.

    Args:
        before: motion one period ago; None if unknown, which counts as unchanged.
        now: current motion.
        period: between both, s.
        mount: rotation (3, 3) and position (3,) of the sensor in the body.
        gravity: downwards, m/s^2.
    """
    turn, arm = mount
    spin = now.angular
    if before is None:
        before = now
    else:
        # Mean angular velocity from the actual rotation; the mean of both velocities is not exact.
        turned = before.rotation.T @ now.rotation
        skew = (turned - turned.T) / (2.0 * period)
        spin = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    first, last = (motion.linear + np.cross(motion.angular, arm) for motion in (before, now))
    acceleration = (last - first) / period + np.cross(spin, (first + last) / 2.0)
    return turn.T @ now.angular, turn.T @ (acceleration + gravity * now.rotation[2])


def orientation(sensor: Imu, rotation: Floats, start: Quaternion) -> Floats | None:
    """Return the orientation (4,), x y z w, relative to the IMU's reference axes.

    Args:
        sensor: the IMU.
        rotation: (3, 3) of the sensor in the world.
        start: rotation of the root link in the first cycle, x y z w.

    Returns:
        None if the IMU measures no orientation.
    """
    if sensor.reference is None:
        return None
    axes = quaternions.to_matrix(quaternions.from_rpy(sensor.reference.rpy))
    if sensor.reference.at_start:
        axes = quaternions.to_matrix(start) @ axes
    return quaternions.from_matrix(axes.T @ rotation)
