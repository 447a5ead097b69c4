"""A robot that is driven: simulation and controller, one control cycle at a time. No ROS here.

robot = DrivenRobot.of(description, ControlConfig.from_parameters({...}))
robot.accept(0.2, 0.0)
for _ in range(500):
    snapshot = robot.cycle()
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_control.diff_drive import DiffDriveController, DriveCommand, WheelStates
from onebot_control.drift import DriftCheck
from onebot_control.odometry import PoseCovariance
from onebot_control.parameters import BROADCASTER, INTERFACES, BroadcasterConfig, ControlConfig
from onebot_control.poses import PlanarPose, yaw_of
from onebot_control.simulation import (
    JointStates,
    Pose,
    SceneBodies,
    Settings,
    Simulation,
    Twist,
)
from onebot_control.simulation.drivable import drivable
from onebot_control.wheels.geometry import WheelGeometry, Wheels
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters.reader import ConfigError, Problem

Floats = NDArray[np.float64]

_DRIFT_PERIOD = 0.1  # s between comparisons of odometry and truth


class Plant(Protocol):
    """What a controller drives; ``onebot_control.simulation.Simulation`` is one."""

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that move."""

    @property
    def scene(self) -> SceneBodies | None:
        """What stands around it."""

    @property
    def obstructed(self) -> bool:
        """Whether something other than the ground touches it."""

    def turn(self, velocities: Mapping[str, float]) -> None:
        """Have the wheels turn with these velocities, rad/s, from the next step on."""

    def step(self, velocities: Mapping[str, float], duration: float) -> None:
        """Turn the wheels with these velocities for ``duration`` seconds."""

    def joint_states(self) -> JointStates:
        """State of ``joints``, in that order."""

    def base_pose(self) -> Pose:
        """Pose of the root link in the world."""

    def base_twist(self) -> Twist:
        """Velocity of the root link in its own frame."""

    def reset(self) -> None:
        """Go back to the beginning."""

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Put the robot elsewhere."""

    def close(self) -> None:
        """Free what it holds."""


class Snapshot(NamedTuple):
    """The robot at one control cycle.

    Velocities are by the clock that the durations given to it are of: where the simulation is too
    slow for it, lower than those in the simulation's own time.
    """

    tick: int  # cycles done before this one
    joints: JointStates  # of all joints that move
    odometry: PlanarPose  # by the wheels, in the odometry's frame
    covariance: PoseCovariance  # of that pose
    twist: tuple[float, float]  # linear and angular velocity by the wheels, m/s and rad/s
    pose: Pose  # the true one in the world
    velocity: Twist  # the true one, in the base's frame
    command: DriveCommand  # of the wheels


class JointStateBroadcaster:
    """Chooses the joints and interfaces that a JointState message holds, as ros2_control's does.

    Attributes:
        names: of the joints in the message.
        frame_id: of its header.
    """

    def __init__(
        self,
        config: BroadcasterConfig,
        joints: Sequence[str],
        held: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Choose among ``joints``, those that there are, and ``held``.

        Args:
            config: of ros2_control.
            joints: those whose states ``values`` gets.
            held: further ones, to the positions at which they are held still.

        Raises:
            ConfigError: a joint named is not among them.
        """
        joints = (*joints, *held)
        chosen = config.joints or joints
        problems = [
            Problem(f"{BROADCASTER}.joints", f'no joint "{name}"{did_you_mean(name, joints)}')
            for name in chosen
            if name not in joints
        ]
        if problems:
            raise ConfigError(problems)
        extra = tuple(name for name in config.extra_joints if name not in chosen)
        self.names = (*chosen, *extra)
        self.frame_id = config.frame_id
        self._rows = [joints.index(name) for name in chosen]
        self._held = [list(held.values()), [0.0] * len(held), [0.0] * len(held)]
        self._extra = [0.0] * len(extra)
        self._hidden = [math.nan] * len(chosen) + self._extra
        self._shown = [
            not config.interfaces or interface in config.interfaces for interface in INTERFACES
        ]

    def values(self, states: JointStates) -> list[list[float]]:
        """Return positions, velocities and efforts of ``names``; NaN where not asked for."""
        # For a handful of joints lists are quicker than arrays.
        return [
            self._chosen(field.tolist() + held) if shown else self._hidden
            for field, held, shown in zip(states, self._held, self._shown, strict=True)
        ]

    def _chosen(self, field: list[float]) -> list[float]:
        return [field[row] for row in self._rows] + self._extra


class Side:
    """The wheels of one side, as one wheel whose positive velocity drives forward."""

    def __init__(
        self, names: Sequence[str], directions: Mapping[str, float], joints: Sequence[str]
    ) -> None:
        self._directions = [(name, directions[name]) for name in names]
        self._rows = [(joints.index(name), directions[name]) for name in names]

    def mean(self, values: Floats) -> float:
        """Return the mean of the wheels' positions or velocities."""
        # For a few wheels a loop is quicker than arrays.
        total = 0.0
        for row, direction in self._rows:
            total += direction * values.item(row)
        return total / len(self._rows)

    def velocities(self, speed: float) -> dict[str, float]:
        """Return the velocity of each joint for this ``speed`` of the wheels."""
        return {name: direction * speed for name, direction in self._directions}


class DrivenRobot:
    """A robot and its controller.

    Attributes:
        wheels: those that drive it.
        config: the parameters in force.
        geometry: of the wheels, before multipliers.
        description: of the robot.
        broadcaster: chooses what joint_states holds.
        plant: what is driven.
        held: joints that the plant has not, to their positions.
        ticks: control cycles done.
        drift: compares odometry and truth.
    """

    def __init__(
        self,
        wheels: Wheels,
        config: ControlConfig,
        plant: Plant,
        held: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Stand still, with odometry at zero.

        Args:
            wheels: of the robot.
            config: of its controller.
            plant: what is driven.
            held: joints that the plant has not, to the positions at which they are held still.

        Raises:
            OneBotError: config and description do not suit each other.
        """
        self.wheels, self.plant, self.held = wheels, plant, held
        self.description = wheels.description
        self.geometry = self.measured(config)
        self.controller = DiffDriveController(config, config.kinematics(self.geometry))
        self.config = config
        self.broadcaster = self.broadcasting(config)
        self.ticks = 0
        self._left, self._right = (
            Side(names, wheels.directions, plant.joints) for names in (wheels.left, wheels.right)
        )
        self._command = DriveCommand(0.0, 0.0, 0.0, 0.0)
        self.drift = DriftCheck(skids=len(wheels.names) > 2)
        self._read_state()
        self.place_odometry(PlanarPose())

    @classmethod
    def of(cls, description: Description, config: ControlConfig) -> "DrivenRobot":
        """Return a robot in a simulation of its own.

        Raises:
            OneBotError: config and description do not suit each other, or cannot be simulated.
        """
        wheels = wheels_of(description, config)
        wheels.geometry(config.wheel_separation, config.wheel_radius)
        settings = Settings().fitted(config.update_rate)
        simulated, held = drivable(wheels)
        driven, x, y, yaw = wheels.names, config.x, config.y, config.yaw
        plant = Simulation(simulated, driven=driven, x=x, y=y, yaw=yaw, settings=settings)
        try:
            return cls(wheels, config, plant, held)
        except OneBotError:
            plant.close()
            raise

    @property
    def period(self) -> float:
        """Seconds of a control cycle."""
        return 1.0 / self.config.update_rate

    @property
    def true_pose(self) -> PlanarPose:
        """Where the robot is in the world, seen from above."""
        (x, y, _), rotation = self._pose.translation.tolist(), self._pose.rotation.tolist()
        return PlanarPose(x, y, yaw_of(*rotation))

    def configure(self, config: ControlConfig) -> None:
        """Apply other parameters, from the next cycle on.

        Raises:
            OneBotError: they do not suit the robot; then nothing has changed.
        """
        geometry = self.measured(config)
        broadcaster = self.broadcasting(config)
        self.controller.configure(config, config.kinematics(geometry))
        self.config, self.geometry, self.broadcaster = config, geometry, broadcaster

    def measured(self, config: ControlConfig) -> WheelGeometry:
        """Return the wheels' geometry: that of ``config``, or where it is 0 the description's.

        Raises:
            OneBotError: the description does not determine it, or it cannot be driven by.
        """
        geometry = self.wheels.geometry(config.wheel_separation, config.wheel_radius)
        try:
            config.kinematics(geometry)
        except ValueError as error:
            raise OneBotError(f"wheels, with their multipliers: {error}") from None
        return geometry

    def broadcasting(self, config: ControlConfig) -> JointStateBroadcaster:
        """Return what chooses the joint states to publish by ``config``.

        Raises:
            ConfigError: a joint named is not among the robot's.
        """
        return JointStateBroadcaster(config.broadcaster, self.plant.joints, self.held)

    def accept(self, linear: float, angular: float, age: float | None = None) -> str | None:
        """Command a velocity; see ``DiffDriveController.accept``."""
        return self.controller.accept(linear, angular, age)

    def wait(self, seconds: float) -> None:
        """Let time pass without a cycle; see ``DiffDriveController.wait``."""
        self.controller.wait(seconds)

    def stalled(self, seconds: float) -> None:
        """Let time pass in which this process did not run; see ``DiffDriveController.stalled``."""
        self.controller.stalled(seconds)

    def cycle(self) -> Snapshot:
        """Do a whole control cycle; return the robot as it was at its beginning."""
        snapshot = self.begin()
        self.finish()
        return snapshot

    def begin(self) -> Snapshot:
        """Read the robot's state and update the controller with it."""
        self._read_state()
        positions, velocities = self._joints.positions, self._joints.velocities
        wheels = WheelStates(
            self._left.mean(positions),
            self._right.mean(positions),
            self._left.mean(velocities),
            self._right.mean(velocities),
        )
        self._command = self.controller.update(wheels, self.period)
        snapshot = self.snapshot()
        if self.ticks % math.ceil(_DRIFT_PERIOD * self.config.update_rate) == 0:
            self.drift.update(snapshot.odometry, self.true_pose, lambda: self.plant.obstructed)
        return snapshot

    def finish(self) -> None:
        """Turn the wheels for a control period."""
        self.plant.step(self._wheel_velocities(), self.period)
        self.ticks += 1

    def turn(self) -> None:
        """Set the velocities of the wheels for a control period of the world."""
        self.plant.turn(self._wheel_velocities())
        self.ticks += 1

    def _wheel_velocities(self) -> dict[str, float]:
        """The velocity of each driven joint, rad/s, as ``begin`` has decided."""
        velocities = self._left.velocities(self._command.left)
        velocities.update(self._right.velocities(self._command.right))
        return velocities

    def snapshot(self) -> Snapshot:
        """Return the robot as its state was last read."""
        odometry = self.controller.odometry
        pose = PlanarPose(odometry.x, odometry.y, odometry.heading)
        covariance, pace = odometry.uncertainty.covariance, self.controller.pace
        joints, velocity = self._joints, self._twist
        if pace != 1.0:
            joints = joints._replace(velocities=joints.velocities * pace)
            velocity = Twist(velocity.linear * pace, velocity.angular * pace)
        return Snapshot(
            self.ticks,
            joints,
            pose,
            covariance,
            (odometry.linear * pace, odometry.angular * pace),
            self._pose,
            velocity,
            self._command,
        )

    def reset(self) -> None:
        """Put everything back to the beginning, except time and parameters."""
        self.plant.reset()
        self.controller.halt()
        self._read_state()
        self.controller.odometry.reset()
        self.place_odometry(PlanarPose())

    def teleport(self, pose: PlanarPose) -> None:
        """Put the robot elsewhere in the world, at rest; its odometry stays as it is."""
        self.plant.teleport(*pose)
        self.controller.halt()
        self.controller.odometry.forget_wheels()
        self.drift.restart()
        self._read_state()

    def place_odometry(self, pose: PlanarPose) -> None:
        """Set the odometry to ``pose`` here and now; its covariance is zero."""
        self.controller.odometry.set_pose(*pose)
        self._odom_placed = self.true_pose.compose(pose.inverse())
        self.drift.restart()

    @property
    def odom_in_world(self) -> PlanarPose:
        """Pose of the odometry frame in the world.

        It changes with what sets the odometry; in a scene, where wheels slip, all the time.
        """
        if self.plant.scene is None:
            return self._odom_placed
        return self.true_pose.compose(self.snapshot().odometry.inverse())

    @property
    def world_frame(self) -> str:
        """The frame of the truth; "" if that is the odometry's."""
        return self.config.world_frame(in_scene=self.plant.scene is not None)

    def continue_from(self, other: "DrivenRobot") -> None:
        """Continue another robot's odometry and count of cycles, where that one is."""
        self.controller.odometry.set_pose(*other.snapshot().odometry)
        self.controller.odometry.uncertainty = other.controller.odometry.uncertainty
        self._odom_placed, self.ticks = other._odom_placed, other.ticks
        self.drift.restart()

    def _read_state(self) -> None:
        self._joints = self.plant.joint_states()
        self._pose, self._twist = self.plant.base_pose(), self.plant.base_twist()


def wheels_of(description: Description, config: ControlConfig) -> Wheels:
    """Return the driven wheels: those that the parameters name, or else those that are found.

    Raises:
        OneBotError: one is missing, or none are found.
    """
    return Wheels(description, config.left_wheel_names, config.right_wheel_names)
