"""Measures with IMUs: from two states of a rigid body, and its orientation."""

import math
from collections.abc import Sequence, Set
from typing import Any, NamedTuple

import numpy as np

from onebot_control.controlled_robot import Snapshot
from onebot_control.sensing.instrument import Instrument, SensedWorld
from onebot_control.sensing.noise import add_noise
from onebot_description.arrays import Floats
from onebot_description.description.sensors.imu import Imu
from onebot_description.description.sensors.noise import Noise
from onebot_description.geometry import quaternions
from onebot_description.geometry.poses import Quaternion

_LEAP = 0.01  # m; a robot that has moved this much farther than by its speed was teleported


class Motion(NamedTuple):
    """Velocity and orientation of a rigid body."""

    linear: Floats  # (3,), velocity of its origin in its own axes, m/s
    angular: Floats  # (3,), angular velocity in its own axes, rad/s
    rotation: Floats  # (3, 3), of the body in the world

    @classmethod
    def of_root(cls, snapshot: Snapshot) -> "Motion":
        """Return the motion of a robot's root link."""
        linear, angular = map(np.array, snapshot.velocity)
        return cls(linear, angular, quaternions.to_matrix(snapshot.pose.rotation))


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


class ImuInstrument(Instrument[Imu]):
    """Measures with an IMU."""

    waiting = 50

    @property
    def noises(self) -> Sequence[Noise]:
        return [*self.model.angular_velocity, *self.model.linear_acceleration]

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        frame, pose = world.frame, self.pose(world.placed)
        now = frame.snapshots[self.row]
        last_snapshot = frame.before[self.row] if frame.before else None
        if last_snapshot and _was_put(last_snapshot, now, world.period):
            last_snapshot = None
        previous, motion = last_snapshot and Motion.of_root(last_snapshot), Motion.of_root(now)
        back = motion.rotation.T
        mount = back @ pose.rotation, back @ (pose.position - np.array(now.pose.translation))
        values = np.concatenate(measure(previous, motion, world.period, mount, world.gravity))
        if generator := self.generator(frame):
            for axis, noise in enumerate(self.noises):
                part = values[axis : axis + 1]
                part[:] = add_noise(part, noise, self.offsets[axis], generator)
        turn = orientation(self.model, pose.rotation, frame.starts[self.row])
        return {"imu": (turn, values[:3], values[3:])}


def _was_put(before: Snapshot, now: Snapshot, period: float) -> bool:
    """Return whether a robot was teleported between two cycles, which its IMU does not feel."""
    shift = math.dist(now.pose.translation, before.pose.translation)
    speed = max(math.hypot(*snapshot.velocity.linear) for snapshot in (before, now))
    return shift > 2.0 * speed * period + _LEAP
