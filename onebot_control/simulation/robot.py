"""A robot's body in a PyBullet world: what its motors are told, and what there is to see of it."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.frames import conjugate, cross, rotate
from onebot_control.simulation.loading import Robot
from onebot_control.simulation.motors import Motors
from onebot_control.simulation.settling import Stance, link_pose, place
from onebot_control.simulation.states import JointStates, Pose, Twist
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.model.robot_model import RobotModel

# Farther out, rounding is no longer small against the micrometres that a wheel's contact gives.
FARTHEST = 10_000.0


class RobotBody:
    """One robot among those of a world.

    Attributes:
        joints: names of all joints that move, in the description's order.
        driven: names of the joints that have a motor, in the order given.
        finite: whether all of its state was finite when it was last read.
        parts: what PyBullet calls its parts.
    """

    parts: Robot

    def __init__(self, description: Description, driven: Sequence[str]) -> None:
        """Look the joints up; ``enter`` puts the robot into a world.

        Raises:
            OneBotError: a driven joint is none.
        """
        self.joints = RobotModel.from_description(description).joints
        self.driven = tuple(driven)
        self.finite = True
        self._motors = Motors(description, self.driven)
        self._driven_rows = [self.joints.index(name) for name in self.driven]

    def enter(self, client: int, parts: Robot) -> None:
        """Take over a loaded robot, its motors holding still."""
        self._client, self.parts = client, parts
        self._indices = [parts.joints[name] for name in self.joints]
        self._driven_indices = [parts.joints[name] for name in self.driven]
        self._motors.drive(client, parts, [0.0] * len(self.driven))

    def targets(self, velocities: Mapping[str, float] | ArrayLike) -> list[float]:
        """Return what ``turn`` takes; see ``Motors.targets``."""
        return self._motors.targets(velocities)

    def turn(self, targets: Sequence[float]) -> None:
        """Have the motors keep up ``targets`` from now on."""
        self._motors.drive(self._client, self.parts, targets)
        self._totals = [0.0] * len(targets)

    def watch(self) -> None:
        """Add up what the motors applied; call it after each physics step."""
        body, indices = self.parts.body, self._driven_indices
        states = engine.getJointStates(body, indices, physicsClientId=self._client)
        self._totals = [total + state[3] for total, state in zip(self._totals, states, strict=True)]

    def read(self, steps: int) -> None:
        """Fetch the state after ``steps`` physics steps since ``turn``; see ``finite``."""
        for row, total in zip(self._driven_rows, self._totals, strict=True):
            self._efforts[row] = total / steps
        self._read()

    def joint_states(self) -> JointStates:
        """Return position, speed and motor effort of all joints, in the order of ``joints``."""
        positions, velocities, *_ = zip(*self._states, strict=True)
        return JointStates(np.array(positions), np.array(velocities), np.array(self._efforts))

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        position, rotation = self.pose
        return Pose(np.array(position), np.array(rotation))

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        back = conjugate(self.pose[1])
        linear, angular = (rotate(back, value) for value in self._velocity)
        # PyBullet tells the velocity of the centre of mass.
        from_turning = cross(angular, self.parts.mass_frame[0])
        return Twist(np.array(linear) - np.array(from_turning), np.array(angular))

    def stand(self, stance: Stance, where: tuple[float, float, float], start: bool) -> None:
        """Set the robot down at x, y, yaw (m and rad), all of it still.

        Args:
            stance: how it stands.
            where: of the root link's frame.
            start: joints go to 0; else they stay where they are.
        """
        positions = [0.0] * len(self.joints) if start else [state[0] for state in self._states]
        place(self._client, self.parts, stance.at(*where))
        self._set_joints(positions)

    def brake(self) -> None:
        """Stop everything at once: all speeds are exactly 0, nothing changes its place."""
        place(self._client, self.parts, self.pose)
        self._set_joints([state[0] for state in self._states])

    def _set_joints(self, positions: Sequence[float]) -> None:
        for index, position in zip(self._indices, positions, strict=True):
            engine.resetJointState(
                self.parts.body, index, position, 0.0, physicsClientId=self._client
            )
        # A saved state holds no targets of motors, nor what they did last.
        self._motors.drive(self._client, self.parts, [0.0] * len(self.driven))
        self._efforts = [0.0] * len(self.joints)
        self._read()

    def _read(self) -> None:
        """Fetch the state."""
        body, client = self.parts.body, self._client
        self._states = engine.getJointStates(body, self._indices, physicsClientId=client)
        self.pose = link_pose(client, self.parts)
        self._velocity = engine.getBaseVelocity(body, physicsClientId=client)
        total = sum(map(sum, (*self.pose, *self._velocity)))
        total += sum([state[0] + state[1] for state in self._states]) + sum(self._efforts)
        self.finite = math.isfinite(total)


def checked_place(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """Return a place to stand at.

    Raises:
        ValueError: a value is not finite.
        OneBotError: it is too far away to be exact there.
    """
    if not all(map(math.isfinite, (x, y, yaw))):
        raise ValueError(f"x, y and yaw must be finite, not {x}, {y}, {yaw}")
    if max(abs(x), abs(y)) > FARTHEST:
        raise OneBotError(
            f"x {x:g} m, y {y:g} m: the simulation is exact up to {FARTHEST:g} m from the origin"
        )
    return float(x), float(y), float(yaw)
