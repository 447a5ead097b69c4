"""Inertial measurements from two states of a rigid body, and its orientation."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.poses import Quaternion
from onebot_description.description.description import Imu, Noise
from onebot_description.model import quaternions

Floats = NDArray[np.float64]


class Motion(NamedTuple):
    """How a body moves."""

    linear: Floats  # (3,), velocity of its origin in its own axes, m/s
    angular: Floats  # (3,), likewise, rad/s
    rotation: Floats  # (3, 3), of the body in the world


def noises(sensor: Imu) -> tuple[Noise, ...]:
    """Return the noise of each value that ``measure`` returns."""
    return (*sensor.angular_velocity, *sensor.linear_acceleration)


def measure(
    before: Motion | None,
    now: Motion,
    period: float,
    mount: tuple[Floats, Floats],
    gravity: float,
) -> tuple[Floats, Floats]:
    """Return angular velocity (3,), rad/s, and linear acceleration (3,), m/s^2, in a sensor's axes.

    An accelerometer measures the reaction to gravity, too: R^T (a - g). The acceleration is the
    mean of a period: by velocities v in the body's axes dv/dt + w x v, exact in a steady turn.

    Args:
        before: motion a period (s) ago; None if it is not known, which counts as unchanged.
        now: present motion.
        period: s.
        mount: rotation (3, 3) and position (3,) of the sensor in the body.
        gravity: downwards, m/s^2.
    """
    turn, arm = mount
    spin = now.angular
    if before is None:
        before = now
    else:
        # What it has turned, which is not by the mean of both velocities where they change.
        turned = before.rotation.T @ now.rotation
        skew = (turned - turned.T) / (2.0 * period)
        spin = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    first, last = (motion.linear + np.cross(motion.angular, arm) for motion in (before, now))
    acceleration = (last - first) / period + np.cross(spin, (first + last) / 2.0)
    return turn.T @ now.angular, turn.T @ (acceleration + gravity * now.rotation[2])


def orientation(sensor: Imu, rotation: Floats, start: Quaternion) -> Floats | None:
    """Return the orientation (4,), x y z w, in the axes of the sensor; None if it measures none.

    ``rotation`` (3, 3) is the sensor's in the world, ``start`` the root link's when all began.
    """
    if sensor.reference is None:
        return None
    axes = quaternions.to_matrix(quaternions.from_rpy(sensor.reference.rpy))
    if sensor.reference.at_start:
        axes = quaternions.to_matrix(start) @ axes
    return quaternions.from_matrix(axes.T @ rotation)
