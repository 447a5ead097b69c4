"""A robot that is driven: its simulation and its controller in a control cycle. No ROS here."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from onebot_control.drive.diff_drive import DiffDriveController, DriveCommand, WheelStates
from onebot_control.drive.drift import DriftCheck
from onebot_control.drive.odometry import DiffDriveKinematics, PoseCovariance
from onebot_control.drive.wheels.geometry import WheelGeometry, Wheels
from onebot_control.joint_controllers import (
    JointController,
    JointFollower,
    TrajectoryController,
    named,
)
from onebot_control.parameters import (
    BROADCASTER,
    DEFAULT_JOINT_CONTROLLER,
    INTERFACES,
    BroadcasterConfig,
    ControlConfig,
)
from onebot_control.physics import (
    JointStates,
    MassVelocity,
    Pose,
    Robot,
    RobotSpawn,
    Twist,
)
from onebot_control.physics.drivable import Follower, commandable, drivable
from onebot_control.poses import PlanarPose, scaled, yaw_of
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.goal import FollowedJoint
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.ros.parameters.reader import ConfigError, Problem

_STANDING = WheelGeometry(1.0, 1.0)  # of a robot without wheels: its odometry stays at zero
_DRIFT_PERIOD = 0.1  # s between comparisons of odometry and truth


class Snapshot(NamedTuple):
    """The robot at one control cycle.

    Velocities are by the clock that stamps them: where the simulation is too slow for it, they are
    lower than those in the simulation's own time.
    """

    tick: int  # cycles done before this one
    joints: JointStates  # all joints that move
    odometry: PlanarPose  # the wheels' pose, in the odometry's frame
    covariance: PoseCovariance  # covariance of that pose
    twist: tuple[float, float]  # linear and angular velocity by the wheels, m/s and rad/s
    pose: Pose  # the true one in the world
    mass_velocity: MassVelocity  # the true one, in the simulation's own time
    pace: float  # seconds of that time a second
    command: DriveCommand  # the wheels' velocities

    @property
    def velocity(self) -> Twist:
        """The true velocity, in the base's frame."""
        linear, angular = self.mass_velocity.twist(self.pose.rotation)
        return Twist(scaled(linear, self.pace), scaled(angular, self.pace))


class JointStateBroadcaster:
    """Chooses the joints and interfaces that a JointState message holds, as ros2_control's does."""

    def __init__(
        self,
        config: BroadcasterConfig,
        joints: Sequence[str],
        held: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Choose among ``joints``, whose states ``values`` gets, and ``held``, with positions.

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
        extra = [name for name in config.extra_joints if name not in chosen]
        self.names = (*chosen, *extra)
        self.frame_id = config.frame_id
        self._rows = [joints.index(name) for name in chosen]
        self._held = [list(held.values()), [0.0] * len(held), [0.0] * len(held)]
        self._extra = [0.0] * len(extra)
        self._hidden = [math.nan] * len(chosen) + self._extra
        self._published = [
            not config.interfaces or interface in config.interfaces for interface in INTERFACES
        ]

    def values(self, states: JointStates) -> list[list[float]]:
        """Return positions, velocities and efforts of ``names``; NaN where not asked for."""
        return [
            self._chosen([*field, *held]) if published else self._hidden
            for field, held, published in zip(states, self._held, self._published, strict=True)
        ]

    def _chosen(self, field: list[float]) -> list[float]:
        return [field[row] for row in self._rows] + self._extra


class Side:
    """The wheels of one side, as one wheel whose positive velocity drives forward."""

    def __init__(
        self, names: Sequence[str], directions: Mapping[str, float], joints: Sequence[str]
    ) -> None:
        self._rows = [(joints.index(name), directions[name]) for name in names]

    def mean(self, joints: JointStates) -> tuple[float, float]:
        """Return the mean position and velocity of the wheels."""
        position = velocity = 0.0
        positions, velocities, _ = joints
        for row, direction in self._rows:
            position += direction * positions[row]
            velocity += direction * velocities[row]
        count = len(self._rows) or 1
        return position / count, velocity / count

    def velocities(self, speed: float) -> list[float]:
        """Return the velocity of each joint for this ``speed`` of the wheels."""
        return [direction * speed for _, direction in self._rows]


DEFAULT_CONTROLLER = TrajectoryController(DEFAULT_JOINT_CONTROLLER)
"""The controller of a robot whose control file names none."""


class DrivenSpawn(NamedTuple):
    """A robot, ready to enter a world."""

    wheels: Wheels | None  # None: its base stands still
    spawn: RobotSpawn
    held: Mapping[str, float]  # joints that do not move, to their positions
    followers: Sequence[Follower]  # joints that mimic wheels or casters
    controllers: Sequence[JointController[Any]]  # of its other joints
    controlled: Mapping[str, Sequence[str]]  # the joints of each controller, by its name

    @classmethod
    def of(
        cls,
        description: Description,
        config: ControlConfig,
        name: str = "",
        controllers: Sequence[JointController[Any]] = (),
        *,
        stands: bool = False,
    ) -> "DrivenSpawn":
        """Return the robot that ``config`` drives, at its start; ``name`` is for errors."""
        wheels = None if stands else wheels_of(description, config)
        if wheels:
            wheels.geometry(config.wheel_separation, config.wheel_radius)
        candidates = controllers or [DEFAULT_CONTROLLER]
        controlled = {each.name: joints_of(each, description, wheels) for each in candidates}
        controllers = [each for each in candidates if controlled[each.name]]
        _check_claims(description, wheels, controllers, controlled)
        commanded = tuple([joint for joints in controlled.values() for joint in joints])
        simulated, held, followers, gears, starts = drivable(
            description, wheels, commanded, config.initial_positions
        )
        if name:
            simulated = replace(simulated, source=f"{name}: {simulated.source}")
        spawn = RobotSpawn(
            simulated,
            wheels.names if wheels else (),
            config.x,
            config.y,
            config.yaw,
            name,
            commanded,
            gears,
            starts,
            fixed_base=stands,
        )
        return cls(wheels, spawn, held, followers, controllers, controlled)

    @property
    def converges_slowly(self) -> bool:
        """Whether it is an arm that stands still, or has a linkage.

        In a linkage, such as fingers, several joints that turn are geared to one.
        """
        kinds = {joint.name: joint.kind for joint in self.spawn.description.joints}
        leaders = [gear.leader for gear in self.spawn.gears if kinds[gear.name] != "prismatic"]
        has_linkage = len(leaders) > len({*leaders})
        return has_linkage or bool(self.spawn.fixed_base and self.spawn.commanded)


def joints_of(
    controller: JointController[Any], description: Description, wheels: Wheels | None
) -> Sequence[str]:
    """Return the joints that a controller commands."""
    return controller.joints or commandable(description, wheels)


def _check_claims(
    description: Description,
    wheels: Wheels | None,
    controllers: Sequence[JointController[Any]],
    controlled: Mapping[str, Sequence[str]],
) -> None:
    """Check the joints of controllers, which ``controlled`` has by their names.

    Raises:
        ConfigError: two controllers, or the wheels and one, have a joint in common, or a joint
            does not move.
    """
    owners = dict.fromkeys(wheels.names if wheels else (), "the wheels")
    moving = [joint.name for joint in description.moving_joints]
    problems = []
    for controller in controllers:
        key = f"{controller.name}.{controller.joints_parameter}"
        for joint in controlled[controller.name]:
            if joint in owners:
                text = f'"{joint}" is a joint of {owners[joint]}, too; each has one controller'
                problems.append(Problem(key, text))
            elif joint not in moving:
                text = f'joint "{joint}" does not move{did_you_mean(joint, moving)}'
                problems.append(Problem(key, text))
            owners[joint] = controller.name
    if problems:
        raise ConfigError(problems)


class DrivenRobot:
    """A robot and its controller.

    Attributes:
        config: the parameters in force.
        geometry: of the wheels, before multipliers.
        plant: the simulated robot.
        arms: what moves joints, by the names of their controllers.
        joints: that move: the plant's, and those that mimic them.
        held: joints that do not move, to the positions at which they are held still.
        finished: what has ended lately of the arms' goals; whoever wants to know empties it.
        ticks: control cycles done.
        period: seconds of one.
    """

    def __init__(
        self,
        part: DrivenSpawn,
        description: Description,
        config: ControlConfig,
        plant: Robot,
    ) -> None:
        """Stand still, with odometry at zero."""
        self.wheels, self.plant, self.held = part.wheels, plant, part.held
        self.joints = (*plant.joints, *(follower.name for follower in part.followers))
        self._followers = [(self.joints.index(each.leader), each) for each in part.followers]
        self.description, self._starts = description, part.spawn.starts
        self._left, self._right = (
            Side(names, self.wheels.directions if self.wheels else {}, plant.joints)
            for names in ((self.wheels.left, self.wheels.right) if self.wheels else ((), ()))
        )
        self.controllers = {controller.name: controller for controller in part.controllers}
        self._controlled = part.controlled
        self.arms: dict[str, JointFollower] = {}
        self.finished: list[tuple[str, Outcome]] = []
        self.start(config)

    def start(self, config: ControlConfig) -> None:
        """Begin with these parameters, at rest where the plant is, with odometry and time at zero.

        Raises:
            OneBotError: see ``fitted``.
        """
        self.geometry, kinematics, self.broadcaster = self.fitted(config)
        self.controller = DiffDriveController(config, kinematics)
        self._use(config)
        self.ticks, self._observed = 0, -1
        self._command = DriveCommand(0.0, 0.0, 0.0, 0.0)
        self.drift = DriftCheck(skids=self.wheels is not None and len(self.wheels.names) > 2)
        self._reset_arms()
        self.arms = {
            name: self._follower(controller) for name, controller in self.controllers.items()
        }
        self._arm_rows = {
            name: [self.plant.joints.index(joint) for joint in arm.names]
            for name, arm in self.arms.items()
        }
        self.plant.reference = self._reference
        self._read_state()
        self.place_odometry(PlanarPose())

    def _follower(self, controller: JointController[Any]) -> JointFollower:
        """Return what moves the joints of a controller, which are where they start."""
        moving = {joint.name: joint for joint in self.description.moving_joints}
        joints = [
            FollowedJoint(name, moving[name].kind == "continuous", *moving[name].range)
            for name in self._controlled[controller.name]
        ]
        with named(controller.name):
            starts = [self._starts[joint.name] for joint in joints]
            follower: JointFollower = controller.follower(joints, starts)
        return follower

    @property
    def true_pose(self) -> PlanarPose:
        """Where the robot is in the world, seen from above."""
        (x, y, _), rotation = self._pose
        return PlanarPose(x, y, yaw_of(*rotation))

    def fitted(
        self, config: ControlConfig
    ) -> tuple[WheelGeometry, DiffDriveKinematics, JointStateBroadcaster]:
        """Return what follows from ``config`` for this robot.

        The wheels' geometry is that of ``config``, or where it is 0 the description's.

        Raises:
            OneBotError: the description does not determine the geometry, it cannot be driven by, or
                a joint to publish is not among the robot's.
        """
        geometry = _STANDING
        if self.wheels:
            geometry = self.wheels.geometry(config.wheel_separation, config.wheel_radius)
        try:
            kinematics = config.kinematics(geometry)
        except ValueError as error:
            raise OneBotError(f"wheels, with their multipliers: {error}") from None
        broadcaster = JointStateBroadcaster(config.broadcaster, self.joints, self.held)
        return geometry, kinematics, broadcaster

    def configure(self, config: ControlConfig) -> None:
        """Apply other parameters, from the next cycle on.

        Raises:
            OneBotError: they do not suit the robot; then nothing has changed.
        """
        self.geometry, kinematics, self.broadcaster = self.fitted(config)
        self.controller.configure(config, kinematics)
        self._use(config)

    def _use(self, config: ControlConfig) -> None:
        self.config, self.period = config, 1.0 / config.update_rate
        self._drift_cycles = math.ceil(_DRIFT_PERIOD * config.update_rate)

    def accept(self, linear: float, angular: float, age: float | None = None) -> str | None:
        """Command a velocity; see ``DiffDriveController.accept``."""
        return self.controller.accept(linear, angular, age)

    def begin(self, stamp: int = 0) -> Snapshot:
        """Read the robot's state and update the controllers with it, at a ``stamp`` in ns."""
        self.observe()
        self._command = self.controller.decide(self.period)
        for name, arm in self.arms.items():
            positions, velocities, _ = self.states(name)
            motion = JointMotion(positions, velocities, ())
            self._finish(name, arm.update(motion, stamp, self.period))
        snapshot = self.snapshot()
        if self.wheels and self.ticks % self._drift_cycles == 0:
            self.drift.update(snapshot.odometry, self.true_pose, lambda: self.plant.obstructed)
        return snapshot

    def observe(self) -> None:
        """Read the robot's state and update the odometry, if that is not done in this cycle."""
        if self._observed == self.ticks:
            return
        self._observed = self.ticks
        self._read_state()
        left, left_velocity = self._left.mean(self._joints)
        right, right_velocity = self._right.mean(self._joints)
        wheels = WheelStates(left, right, left_velocity, right_velocity)
        self.controller.observe(wheels, self.period)

    def turn(self) -> None:
        """Set the wheels' velocities, as ``begin`` has decided, for the world's next step."""
        left, right = self._command.left, self._command.right
        # ``Wheels.names`` are the driven joints.
        self.plant.turn(self._left.velocities(left) + self._right.velocities(right))
        self.ticks += 1

    def _reset_arms(self) -> None:
        """Hold the joints of arms where they start; goals end."""
        for name, arm in self.arms.items():
            self._finish(name, [arm.reset([self._starts[joint] for joint in arm.names])])

    def hold_arms(self, text: str) -> None:
        """Abort what the arms do, and hold them where they are, for a reason."""
        for name, arm in self.arms.items():
            self._finish(name, [arm.abort(text)])

    def configure_arm(self, controller: JointController[Any]) -> None:
        """Apply other parameters of a controller of joints."""
        self.controllers[controller.name] = controller
        controller.configure(self.arms[controller.name])

    def _finish(self, arm: str, outcomes: Iterable[Outcome | None]) -> None:
        self.finished += [(arm, outcome) for outcome in outcomes if outcome is not None]

    def states(self, arm: str) -> JointStates:
        """Return what is measured of an arm's joints."""
        rows = self._arm_rows[arm]
        return JointStates(*(tuple([field[row] for row in rows]) for field in self._joints))

    def _reference(self, ahead: float) -> list[float]:
        """The positions of the commanded joints, ``ahead`` seconds after the cycle's beginning."""
        return [position for arm in self.arms.values() for position in arm.reference(ahead)]

    def snapshot(self) -> Snapshot:
        """Return the robot as its state was last read."""
        odometry, pace = self.controller.odometry, self.controller.pace
        joints = self._joints
        if pace != 1.0:
            joints = joints._replace(
                velocities=tuple([speed * pace for speed in joints.velocities])
            )
        return Snapshot(
            self.ticks,
            joints,
            odometry.pose,
            odometry.covariance,
            (odometry.linear * pace, odometry.angular * pace),
            self._pose,
            self._mass_velocity,
            pace,
            self._command,
        )

    def reset(self) -> None:
        """Put everything back to the beginning, except time and parameters."""
        self.plant.reset()
        self.controller.halt()
        self._reset_arms()
        self._read_state()
        self.controller.odometry.reset()
        self.place_odometry(PlanarPose())
        self._observed = -1

    def teleport(self, pose: PlanarPose) -> None:
        """Put the robot elsewhere in the world, at rest; its odometry stays as it is."""
        self.plant.teleport(*pose)
        self.controller.halt()
        self.controller.odometry.forget_wheels()
        self.drift.restart()
        self._read_state()
        self._observed = -1

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
        if self.plant.world.scene is None:
            return self._odom_placed
        return self.true_pose.compose(self.controller.odometry.pose.inverse())

    @property
    def world_frame(self) -> str:
        """The frame of the truth; "" if that is the odometry's."""
        return self.config.world_frame(in_scene=self.plant.world.scene is not None)

    def continue_from(self, other: "DrivenRobot") -> None:
        """Continue another robot's odometry and count of cycles, where that one is."""
        odometry = other.controller.odometry
        self.controller.odometry.set_pose(*odometry.pose, odometry.covariance)
        self._odom_placed, self.ticks = other._odom_placed, other.ticks
        self.drift.restart()
        self._continue_arms(other)

    def _continue_arms(self, other: "DrivenRobot") -> None:
        """Have the arms where another robot has them; those that are the same move on."""
        self.finished = other.finished
        if not self.arms:
            return
        present = dict(zip(other.joints, other._joints.positions, strict=True))
        starts = dict(zip(self.plant.joints, self.plant.starts, strict=True))
        positions = {
            name: present.get(name, at) if name in self._starts else at
            for name, at in starts.items()
        }
        self.plant.put(self.plant.pose, list(positions.values()))
        for name, arm in self.arms.items():
            old = other.arms.get(name)
            if old and old.joints == arm.joints:
                self.arms[name] = old
                continue
            arm.reset([positions[joint] for joint in arm.names])
            text = "Current goal cancelled: the robot description has other joints."
            self._finish(name, [old.abort(text) if old else None])

    def _read_state(self) -> None:
        self._joints, self._pose, self._mass_velocity = self.plant.state()
        if self._followers:
            self._joints = self._followed(self._joints)

    def _followed(self, states: JointStates) -> JointStates:
        """Return the states of the plant's joints, and of those that mimic them."""
        positions, velocities, efforts = map(list, states)
        for leader, follower in self._followers:
            at = follower.at(positions[leader])
            moves = follower.lower < at < follower.upper
            positions.append(at)
            velocities.append(follower.multiplier * velocities[leader] if moves else 0.0)
            efforts.append(0.0)
        return JointStates(tuple(positions), tuple(velocities), tuple(efforts))


def wheels_of(description: Description, config: ControlConfig) -> Wheels:
    """Return the driven wheels: as the parameters name them, or else as found in the URDF."""
    return Wheels(description, config.left_wheel_names, config.right_wheel_names)
