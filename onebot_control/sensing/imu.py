"""Inertial measurements from two states of a rigid body."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Imu, Noise

Floats = NDArray[np.float64]


class Motion(NamedTuple):
    """How a body moves, in its own axes."""

    linear: Floats  # (3,), velocity of its origin, m/s
    angular: Floats  # (3,), rad/s


def noises(sensor: Imu) -> tuple[Noise, ...]:
    """Return the noise of each value that ``measure`` returns."""
    return (*sensor.angular_velocity, *sensor.linear_acceleration)


def measure(
    before: Motion | None,
    now: Motion,
    period: float,
    body: Floats,
    mount: tuple[Floats, Floats],
    gravity: float,
) -> tuple[Floats, Floats]:
    """Return angular velocity (3,), rad/s, and linear acceleration (3,), m/s^2, in a sensor's axes.

    An accelerometer measures the reaction to gravity, too: R^T (a - g). The acceleration is the
    mean of a period: by velocities v in the body's axes dv/dt + w x v, exact in a steady turn.

    Args:
        before: motion a period ago; None if it is not known, which counts as unchanged.
        now: motion.
        period: s.
        body: rotation (3, 3) of the body in the world.
        mount: rotation (3, 3) and position (3,) of the sensor in the body.
        gravity: downwards, m/s^2.
    """
    turn, arm = mount
    before = before or now
    first, last = (each.linear + np.cross(each.angular, arm) for each in (before, now))
    spin = (before.angular + now.angular) / 2.0
    acceleration = (last - first) / period + np.cross(spin, (first + last) / 2.0)
    return turn.T @ now.angular, turn.T @ (acceleration + gravity * body[2])
