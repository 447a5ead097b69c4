"""Measures with IMUs, from two motions of the sensor and its orientation."""

from collections.abc import Sequence, Set
from typing import Any, NamedTuple

import numpy as np

from onebot_control.controlled_robot import Snapshot
from onebot_control.sensing.instrument import Instrument, SensedWorld
from onebot_control.sensing.noise import add_noise
from onebot_control.sensing.surroundings import RobotState
from onebot_description.arrays import Floats
from onebot_description.description.sensors.imu import Imu
from onebot_description.description.sensors.noise import Noise
from onebot_description.geometry import quaternions
from onebot_description.geometry.poses import Quaternion, Transform, multiply, rotate, scaled

_STEP = 1e-5  # s, time between the poses for numerical differentiation


class ImuMotion(NamedTuple):
    """Pose and velocity of a sensor in simulated time."""

    rotation: Floats  # (3, 3), of the sensor in the world
    position: Floats  # (3,), in the world, m
    linear: Floats  # (3,), velocity of its origin in its own axes, m/s
    angular: Floats  # (3,), angular velocity in its own axes, rad/s

    @classmethod
    def through(cls, rotations: Floats, positions: Floats, step: float) -> "ImuMotion":
        """Return the motion at the middle one of three poses, which are ``step`` seconds apart.

        Args:
            rotations: (3, 3, 3), of the sensor in the world.
            positions: (3, 3), in the world, m.
            step: s.
        """
        (first, middle, last), (start, position, end) = rotations, positions
        linear = middle.T @ (end - start) / (2.0 * step)
        return cls(middle, position, linear, _spin(middle.T @ (last - first), 2.0 * step))


def _spin(turned: Floats, seconds: float) -> Floats:
    """Return the angular velocity (3,), rad/s, of a small rotation (3, 3) within ``seconds``."""
    x, y, z = turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]
    return np.array([x, y, z]) / (2.0 * seconds)


def measure(
    before: ImuMotion, now: ImuMotion, period: float, gravity: float
) -> tuple[Floats, Floats]:
    """Return angular velocity (3,), rad/s, and linear acceleration (3,), m/s^2, in a sensor's axes.

    An accelerometer also measures the reaction to gravity (REP-145): R^T (a - g). The acceleration
    is the mean over a period, dv/dt + w x v with velocities v in the sensor's axes, which is exact
    in a steady turn. A teleported robot stops: this deceleration is measured, the jump is not.

    Args:
        before: motion one period ago; ``now`` if it is unknown.
        now: current motion.
        period: time between both, s.
        gravity: downwards, m/s^2.
    """
    spin = (before.angular + now.angular) / 2.0
    acceleration = (now.linear - before.linear) / period
    acceleration += np.cross(spin, (before.linear + now.linear) / 2.0)
    return now.angular, acceleration + gravity * now.rotation[2]


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
        frame, row = world.frame, self.row
        snapshot = frame.snapshots[row]
        last_snapshot = frame.before[row] if frame.before else snapshot
        last_motion, now = self._motions(world, [last_snapshot, snapshot])
        angular, linear = measure(last_motion, now, world.period, world.gravity)
        # Like all velocities, it is scaled to the clock's time; the acceleration is not scaled.
        values = np.concatenate([angular * snapshot.pace, linear])
        if generator := self.generator(frame):
            for axis, noise in enumerate(self.noises):
                part = values[axis : axis + 1]
                part[:] = add_noise(part, noise, self.offsets[axis], generator)
        turn = orientation(self.model, now.rotation, frame.starts[self.row])
        return {"imu": (turn, values[:3], values[3:])}

    def _motions(self, world: SensedWorld, snapshots: Sequence[Snapshot]) -> list[ImuMotion]:
        """Return the sensor's motions, including those of its link relative to the base."""
        states = [state for snapshot in snapshots for state in _around(snapshot)]
        link = world.placed.surroundings.link(self.row, self.sensor.link, states)
        assert link is not None
        rotations, positions = self.mounted(link)
        parts = [slice(start, start + 3) for start in range(0, len(states), 3)]
        return [ImuMotion.through(rotations[part], positions[part], _STEP) for part in parts]


def _around(snapshot: Snapshot) -> list[RobotState]:
    """Return the states of a robot ``_STEP`` before a snapshot, at it, and ``_STEP`` after it."""
    ((x, y, z), rotation), joints = snapshot.pose, snapshot.joints
    vx, vy, vz = rotate(rotation, snapshot.mass_velocity.twist(rotation).linear)
    turning = snapshot.mass_velocity.angular
    return [
        (
            Transform(
                (x + dt * vx, y + dt * vy, z + dt * vz),
                multiply((*scaled(turning, dt / 2.0), 1.0), rotation),
            ),
            [at + dt * speed for at, speed in zip(*joints[:2], strict=True)],
        )
        for dt in (-_STEP, 0.0, _STEP)
    ]
