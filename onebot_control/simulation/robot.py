"""One robot of a PyBullet world: the targets of its motors, and its state as plain arrays."""

import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from onebot_control.poses import Transform, conjugate, cross, rotate
from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import LoadedRobot
from onebot_control.simulation.rest_pose import link_pose, place
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean

Floats = NDArray[np.float64]


class JointStates(NamedTuple):
    """State of all joints that move, in the description's order."""

    positions: Floats  # (M,), rad (never wrapped), m for prismatic joints
    velocities: Floats  # (M,), rad/s or m/s
    efforts: Floats  # (M,), mean motor effort during the last ``step``, Nm or N; 0 without a motor


class Pose(NamedTuple):
    """Pose of the root link's frame (not of its centre of mass) in the world."""

    translation: Floats  # (3,), m
    rotation: Floats  # (4,), unit quaternion x y z w


class Twist(NamedTuple):
    """Velocity of the root link's frame in its own axes, as in nav_msgs/Odometry."""

    linear: Floats  # (3,), of the frame's origin, m/s
    angular: Floats  # (3,), rad/s


class Motors:
    """Velocity motors, limited by the effort and velocity of the joints' ``<limit>``."""

    def __init__(self, description: Description, driven: Sequence[str]) -> None:
        """Find the driven joints.

        Raises:
            OneBotError: there are none, or one is unknown, named twice or without effort.
        """
        joints = {joint.name: joint for joint in description.moving_joints}
        source = description.source
        if not driven:
            raise OneBotError(f"{source}: the simulation has no driven joints")
        self.driven = tuple(driven)
        self._efforts = []
        for name in self.driven:
            if name not in joints:
                known = did_you_mean(name, joints, "joints that move")
                raise OneBotError(f'{source}: there is no joint "{name}" to drive{known}')
            if self.driven.count(name) > 1:
                raise OneBotError(f'{source}: driven joint "{name}" is named twice')
            effort = joints[name].effort
            if not effort:
                raise OneBotError(
                    f'{source}: driven joint "{name}" needs <limit effort="..." velocity="...">; '
                    "the effort (Nm, or N) of its motor must be above 0"
                )
            self._efforts.append(effort)
        speeds = [joints[name].velocity for name in self.driven]
        # Not infinity, so that every value that is not finite is out of range.
        self._fastest = [sys.float_info.max if speed is None else speed for speed in speeds]
        self._names = frozenset(self.driven)

    def targets(self, velocities: Mapping[str, float] | ArrayLike) -> list[float]:
        """Return the velocities in the order of ``driven``, within the joints' limits.

        Raises:
            ValueError: one is missing, unknown or not finite.
        """
        if isinstance(velocities, Mapping):
            if velocities.keys() != self._names:
                raise ValueError(
                    f"velocities must be of exactly {', '.join(self.driven)}, "
                    f"not of {', '.join(map(str, velocities)) or 'nothing'}"
                )
            # Plain floats: for a few numbers arrays would be slower than the rest.
            values = [float(velocities[name]) for name in self.driven]
        else:
            wanted = np.asarray(velocities, float)
            if wanted.shape != (len(self.driven),):
                raise ValueError(
                    f"velocities must be {len(self.driven)} numbers, not {velocities!r}"
                )
            values = wanted.tolist()
        for row, fastest in enumerate(self._fastest):
            if not -fastest <= values[row] <= fastest:
                values[row] = self._limited(values[row], fastest)
        return values

    def _limited(self, value: float, fastest: float) -> float:
        """``value`` limited to ``fastest``."""
        if not math.isfinite(value):
            # A single NaN would make the whole world NaN permanently.
            raise ValueError(f"velocities must be finite, not {value}")
        return math.copysign(fastest, value)

    def drive(
        self, client: int, body: int, indices: Sequence[int], targets: Sequence[float]
    ) -> None:
        """Set the target velocities of the motors.

        Args:
            client: PyBullet's index of the world.
            body: PyBullet's index of the robot.
            indices: PyBullet's indices of the joints, in the order of ``driven``.
            targets: rad/s or m/s, in the same order.
        """
        engine.setJointMotorControlArray(
            body,
            indices,
            engine.VELOCITY_CONTROL,
            targetVelocities=targets,
            forces=self._efforts,
            physicsClientId=client,
        )


# Columns of getJointStates.
_POSITION, _VELOCITY, _EFFORT = 0, 1, 3


class RobotBody:
    """One robot of a world."""

    joints: tuple[str, ...]  # the moving joints, in the description's order
    driven: tuple[str, ...]  # the joints with a motor, in the given order
    finite: bool  # whether the last state was finite
    parts: LoadedRobot
    _efforts: list[float]  # of the motors, by row of ``joints``

    def __init__(self, description: Description, driven: Sequence[str]) -> None:
        """Find the joints; ``enter`` adds the robot to a world.

        Raises:
            OneBotError: a driven joint is invalid.
        """
        self.joints = tuple(joint.name for joint in description.moving_joints)
        self.driven = tuple(driven)
        self.finite = True
        self._source = description.source
        self._motors = Motors(description, self.driven)
        self._driven_rows = [self.joints.index(name) for name in self.driven]

    def enter(self, client: int, parts: LoadedRobot) -> None:
        """Control a loaded robot, with target velocities of 0."""
        self._client, self.parts = client, parts
        self._indices = [parts.joints[name] for name in self.joints]
        self._driven_indices = [parts.joints[name] for name in self.driven]
        body = parts.body
        self._read_joints = partial(engine.getJointStates, body, self._indices, client)
        self._read_driven = partial(engine.getJointStates, body, self._driven_indices, client)
        self._read_velocity = partial(engine.getBaseVelocity, body, client)
        self._stop_motors()

    def check(self) -> None:
        """Raise OneBotError if the last state was not finite."""
        if not self.finite:
            raise OneBotError(
                f"{self._source}: the simulation diverged: its state is no longer finite; reset it"
            )

    def targets(self, velocities: Mapping[str, float] | ArrayLike) -> list[float]:
        """Return the targets for ``turn``; see ``Motors.targets``."""
        return self._motors.targets(velocities)

    def turn(self, targets: list[float]) -> None:
        """Set the target velocities of the motors."""
        # PyBullet keeps the targets, and setting them takes as long as reading the joints.
        if targets != self._targets:
            self._drive(targets)

    def begin(self) -> None:
        """Prepare for physics steps: ``record_efforts`` after all but the last, then ``read``."""
        self._recorded: list[float] = []

    def record_efforts(self) -> None:
        """Record the efforts of the motors in a physics step."""
        # Floats only: whole states of 100 robots would not fit into the processor's caches.
        for state in self._read_driven():
            self._recorded.append(state[_EFFORT])

    def read(self, steps: int) -> None:
        """Read the state after the last of ``steps`` physics steps since ``begin``."""
        states = self._read_joints()
        for number, row in enumerate(self._driven_rows):
            total = 0.0
            # Not sum(), which rounds differently from Python 3.12 on.
            for effort in self._recorded[number :: len(self._driven_rows)]:
                total += effort
            self._efforts[row] = (total + states[row][_EFFORT]) / steps
        self._update(states)

    def joint_states(self) -> JointStates:
        """Return positions, velocities and motor efforts, in the order of ``joints``."""
        return JointStates(
            np.array(self._positions), np.array(self._velocities), np.array(self._efforts)
        )

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        position, rotation = self.pose
        return Pose(np.array(position), np.array(rotation))

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        back = conjugate(self.pose[1])
        linear, angular = self._velocity
        x, y, z = rotate(back, linear)
        turning = rotate(back, angular)
        # PyBullet returns the velocity of the centre of mass.
        a, b, c = cross(turning, self.parts.mass_frame[0])
        return Twist(np.array((x - a, y - b, z - c)), np.array(turning))

    def stand(self, pose: Transform, start: bool) -> None:
        """Place the robot at rest.

        Args:
            pose: of the root link's frame.
            start: set the joints to 0; else keep their positions.
        """
        positions = [0.0] * len(self.joints) if start else self._positions
        place(self._client, self.parts, pose)
        self._set_joints(positions)

    def assume(self, other: "RobotBody") -> None:
        """Move as ``other`` does, the same robot in another world."""
        client, body = self._client, self.parts.body
        place(client, self.parts, other.pose)
        engine.resetBaseVelocity(body, *other._velocity, physicsClientId=client)
        states = zip(self._indices, other._positions, other._velocities, strict=True)
        for index, position, velocity in states:
            engine.resetJointState(body, index, position, velocity, client)
        self._drive(other._targets)
        self._efforts = other._efforts
        self._update(self._read_joints())

    def brake(self) -> None:
        """Stop at once: all velocities are exactly 0, positions do not change."""
        place(self._client, self.parts, self.pose)
        self._set_joints(self._positions)

    def _set_joints(self, positions: Sequence[float]) -> None:
        body, client = self.parts.body, self._client
        for index, position in zip(self._indices, positions, strict=True):
            engine.resetJointState(body, index, position, 0.0, client)
        # A saved state contains neither targets nor efforts of motors.
        self._stop_motors()
        self._efforts = [0.0] * len(self.joints)
        self._update(self._read_joints())

    def _stop_motors(self) -> None:
        self._drive([0.0] * len(self.driven))

    def _drive(self, targets: list[float]) -> None:
        self._targets = targets
        self._motors.drive(self._client, self.parts.body, self._driven_indices, targets)

    def _update(self, states: Sequence[Sequence[float]]) -> None:
        """Store the joints' state, read the base's, and check that all values are finite."""
        self._positions = [state[_POSITION] for state in states]
        self._velocities = [state[_VELOCITY] for state in states]
        self.pose = link_pose(self._client, self.parts)
        self._velocity = self._read_velocity()
        (x, y, z), (a, b, c, d) = self.pose
        (vx, vy, vz), (wx, wy, wz) = self._velocity
        total = x + y + z + a + b + c + d + vx + vy + vz + wx + wy + wz
        total += sum(self._positions) + sum(self._velocities) + sum(self._efforts)
        self.finite = math.isfinite(total)
