"""One simulated robot with its controllers, in control cycles. No ROS here."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from onebot_control.controller_names import BROADCASTER, DEFAULT_JOINT_CONTROLLER
from onebot_control.drive.diff_drive import DiffDriveController, WheelCommand, WheelStates
from onebot_control.drive.drift_check import DriftCheck
from onebot_control.drive.odometry import DiffDriveKinematics, PoseCovariance
from onebot_control.drive.parameters import INTERFACES, BroadcasterConfig, ControlConfig
from onebot_control.drive.wheels.geometry import WheelGeometry, Wheels
from onebot_control.joint_controllers import (
    JointController,
    named,
)
from onebot_control.physics import (
    JointStates,
    MassVelocity,
    Pose,
    RobotBody,
    RobotSpawn,
    Twist,
)
from onebot_control.physics.simulated_model import (
    Follower,
    check_interfaces,
    commandable,
    independent,
    simulated_model,
    without_limits,
)
from onebot_control.trajectories.following import JointFollower, Outcome, TrajectoryFollower
from onebot_control.trajectories.goal import FollowedJoint, MotorLimits
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean, listing, unknown_names
from onebot_description.geometry.poses import PlanarPose, scaled, yaw_of
from onebot_description.parameters.reader import ConfigError, Problem

_STANDING = WheelGeometry(1.0, 1.0)  # placeholder for a robot without wheels: its odometry is zero
_NO_COMMAND = WheelCommand(0.0, 0.0, 0.0, 0.0)
_DRIFT_PERIOD = 0.1  # s between comparisons of odometry and truth


class Snapshot(NamedTuple):
    """The state of a robot in one control cycle.

    Velocities are per second of the clock of the stamps, except where stated. If the simulation is
    slower than that clock, they are lower than in simulated time.
    """

    tick: int  # cycles done before this one
    joints: JointStates  # all joints that move, in the simulation's own time
    odometry: PlanarPose  # the wheels' pose, in the odometry's frame
    covariance: PoseCovariance  # covariance of that pose
    twist: tuple[float, float]  # linear and angular velocity by the wheels, m/s and rad/s
    pose: Pose  # true pose in the world
    mass_velocity: MassVelocity  # true velocity, in the simulation's own time
    pace: float  # simulated seconds per second of the clock
    command: WheelCommand  # the command in force, and the wheels' velocities for it

    @property
    def joint_states(self) -> JointStates:
        """The states of all joints that move."""
        return self.joints._replace(
            velocities=tuple([speed * self.pace for speed in self.joints.velocities])
        )

    @property
    def velocity(self) -> Twist:
        """The true velocity of the root link's frame, in its own axes."""
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
        """Choose the joints that the parameters name, or all.

        Args:
            config: joint_state_broadcaster's parameters.
            joints: names of the joints whose states ``values`` gets, in that order.
            held: joints that do not move, with their positions, rad or m.

        Raises:
            ConfigError: a joint that the parameters name is not among these.
        """
        joints = (*joints, *held)
        chosen = config.joints or joints
        problems = [
            Problem(f"{BROADCASTER}.joints", f'no joint "{name}"{hint}')
            for name, hint in unknown_names(chosen, joints)
        ]
        if problems:
            raise ConfigError(problems)
        known = {*chosen}
        extra = [name for name in config.extra_joints if name not in known]
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
        """Return positions, velocities and efforts of ``names``; NaN for unwanted interfaces."""
        return [
            self._chosen([*field, *held]) if published else self._hidden
            for field, held, published in zip(states, self._held, self._published, strict=True)
        ]

    def _chosen(self, field: list[float]) -> list[float]:
        return [field[row] for row in self._rows] + self._extra


class Side:
    """Treats the wheels of one side as one wheel whose positive velocity drives forward."""

    def __init__(
        self, names: Sequence[str], directions: Mapping[str, float], joints: Sequence[str]
    ) -> None:
        self._rows = [(joints.index(name), directions[name]) for name in names]

    def mean(self, joints: JointStates) -> tuple[float, float]:
        """Return the mean position, rad, and velocity, rad/s, of the wheels."""
        position = velocity = 0.0
        positions, velocities, _ = joints
        for row, direction in self._rows:
            position += direction * positions[row]
            velocity += direction * velocities[row]
        count = len(self._rows) or 1
        return position / count, velocity / count

    def velocities(self, speed: float) -> list[float]:
        """Return the velocity of each joint for a forward ``speed`` of the wheels, rad/s."""
        return [direction * speed for _, direction in self._rows]


DEFAULT_CONTROLLER = JointController(TrajectoryFollower, DEFAULT_JOINT_CONTROLLER)
"""The controller of joints that is used if the control file names none."""


class PreparedRobot(NamedTuple):
    """What to simulate and to control of a robot, before it enters a world."""

    wheels: Wheels | None  # None: its base stands still
    spawn: RobotSpawn
    held: Mapping[str, float]  # positions of joints that do not move, by name
    followers: Sequence[Follower]  # joints that mimic wheels or casters
    controllers: Sequence[JointController[Any]]  # the active ones, of its other joints
    controlled: Mapping[str, Sequence[str]]  # joints of each controller, by the controller's name
    ignored: Sequence[Problem]  # controllers that are inactive, and parameters without effect

    @classmethod
    def from_description(
        cls,
        description: Description,
        config: ControlConfig,
        name: str = "",
        controllers: Sequence[JointController[Any]] = (),
        *,
        stands: bool = False,
    ) -> "PreparedRobot":
        """Prepare a robot for a world.

        Args:
            description: the robot.
            config: its parameters.
            name: prefix of error messages.
            controllers: controllers of joints other than wheels; none for the default controller.
            stands: whether its base stands still.

        Raises:
            OneBotError: config and description do not suit each other.
        """
        description = independent(description)
        wheels = None if stands else wheels_of(description, config)
        if wheels:
            wheels.geometry(config.wheel_separation, config.wheel_radius)
        candidates = controllers or [DEFAULT_CONTROLLER]
        joints = {arm.name: joints_of(arm, description, wheels) for arm in candidates}
        candidates = [arm for arm in candidates if joints[arm.name]]
        inactive = _inactive(description, wheels, candidates, joints)
        names = {problem.key for problem in inactive}
        controllers = [arm for arm in candidates if arm.name not in names]
        controlled = {arm.name: joints[arm.name] for arm in controllers}
        commanded = tuple([joint for joints in controlled.values() for joint in joints])
        check_interfaces(description, commanded, stands=stands)
        unlimited = [arm.name for arm in controllers if not arm.config.enforce_command_limits]
        free = {joint for name in unlimited for joint in controlled[name]}
        description = without_limits(description, free)
        simulated, held, followers, gears, starts = simulated_model(
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
            links=description.links,
        )
        ignored = [
            Problem(f"{arm.name}.{problem.key}", problem.text)
            for arm in controllers
            for problem in arm.config.ignored(controlled[arm.name])
        ]
        return cls(wheels, spawn, held, followers, controllers, controlled, [*inactive, *ignored])


def joints_of(
    controller: JointController[Any], description: Description, wheels: Wheels | None
) -> Sequence[str]:
    """Return the joints that a controller commands: those it names, or all commandable ones."""
    return controller.config.joint_names or commandable(description, wheels)


def _inactive(
    description: Description,
    wheels: Wheels | None,
    controllers: Sequence[JointController[Any]],
    joints: Mapping[str, Sequence[str]],
) -> list[Problem]:
    """Return why controllers are inactive: the robot has none of their joints, or others move them.

    Raises:
        ConfigError: only some joints of a controller move, or it is the only one and none moves.
    """
    owners = dict.fromkeys(wheels.names if wheels else (), "the controller of the wheels")
    moving = [joint.name for joint in description.moving_joints]
    inactive, problems = list[Problem](), list[Problem]()
    for controller in controllers:
        own = joints[controller.name]
        missing = [
            Problem(
                f"{controller.name}.{controller.config.joints_parameter}",
                f'joint "{joint}" does not move{hint}',
            )
            for joint, hint in unknown_names(own, moving)
        ]
        taken = [joint for joint in own if joint in owners]
        if missing and (len(missing) < len(own) or len(controllers) == 1):
            problems += missing
        elif missing:
            text = f"is inactive: no joint of the robot is {listing(own)}"
            inactive.append(Problem(controller.name, text))
        elif taken:
            text = f"is inactive: {owners[taken[0]]}, which comes first, moves {listing(taken)}"
            inactive.append(Problem(controller.name, text))
        else:
            owners.update(dict.fromkeys(own, controller.name))
    if problems:
        raise ConfigError(problems)
    return inactive


class ControlledRobot:
    """A simulated robot with its controllers and odometry.

    Attributes:
        config: the parameters in force.
        geometry: separation and radius of the wheels, before multipliers.
        body: the simulated robot.
        arms: the followers that move joints, by the names of their controllers.
        joints: names of the moving joints: the body's, then those that mimic them.
        held: positions of the joints that are held still, by name.
        finished: goals of arms that have ended, as (controller, outcome); the reader empties it.
        ticks: number of control cycles done.
        period: duration of a control cycle, s.
    """

    def __init__(
        self,
        prepared: PreparedRobot,
        description: Description,
        config: ControlConfig,
        body: RobotBody,
    ) -> None:
        """Start at rest where the body is, with odometry at zero.

        Args:
            prepared: the robot, prepared for its world.
            description: the robot as read, before it was prepared.
            config: its parameters.
            body: the simulated robot.

        Raises:
            OneBotError: see ``fitted``.
        """
        self.wheels, self.body, self.held = prepared.wheels, body, prepared.held
        self.joints = (*body.joints, *(follower.name for follower in prepared.followers))
        self._followers = [
            (self.joints.index(follower.mimic.joint), follower) for follower in prepared.followers
        ]
        self.description, self._starts = description, prepared.spawn.starts
        self._left, self._right = (
            Side(names, self.wheels.directions if self.wheels else {}, body.joints)
            for names in ((self.wheels.left, self.wheels.right) if self.wheels else ((), ()))
        )
        self.joint_controllers = {
            controller.name: controller for controller in prepared.controllers
        }
        self._controlled = prepared.controlled
        self.arms: dict[str, JointFollower] = {}
        self.finished: list[tuple[str, Outcome]] = []
        self.start(config)

    def start(self, config: ControlConfig) -> None:
        """Start again with these parameters, at rest, with odometry and time at zero.

        Raises:
            OneBotError: see ``fitted``.
        """
        self.geometry, kinematics, self.broadcaster = self.fitted(config)
        self.diff_drive = DiffDriveController(config, kinematics)
        self._use(config)
        self.ticks, self._observed = 0, -1
        self._command = _NO_COMMAND
        self.drift = DriftCheck(skids=self.wheels is not None and len(self.wheels.names) > 2)
        self._reset_arms()
        self.arms = {
            name: self._follower(controller) for name, controller in self.joint_controllers.items()
        }
        self._arm_rows = {
            name: [self.body.joints.index(joint) for joint in arm.names]
            for name, arm in self.arms.items()
        }
        self.move_into(self.body)
        self._read_state()
        self.place_odometry(PlanarPose())

    def move_into(self, body: RobotBody) -> None:
        """Control the same robot in another world from now on."""
        self.body = body
        self._motor_limits: dict[str, MotorLimits] = {}  # those that the body has, by controller

    def _follower(self, controller: JointController[Any]) -> JointFollower:
        """Return the follower that moves a controller's joints from their start positions."""
        moving = {joint.name: joint for joint in self.description.moving_joints}
        interfaces = self.description.interfaces
        joints = []
        for name in self._controlled[controller.name]:
            joint = FollowedJoint(name, moving[name].kind == "continuous", *moving[name].range)
            limits = interfaces[name].limits if name in interfaces else {}
            joints.append(joint.within(*limits["position"]) if "position" in limits else joint)
        with named(controller.name):
            starts = [self._starts[joint.name] for joint in joints]
            follower: JointFollower = controller.kind(joints, controller.config, starts)
        return follower

    @property
    def true_pose(self) -> PlanarPose:
        """Where the robot is in the world, seen from above."""
        (x, y, _), rotation = self._pose
        return PlanarPose(x, y, yaw_of(*rotation))

    def fitted(
        self, config: ControlConfig
    ) -> tuple[WheelGeometry, DiffDriveKinematics, JointStateBroadcaster]:
        """Return geometry, kinematics and broadcaster that ``config`` gives this robot.

        Separation and radius come from ``config``, or from the description where they are 0 there.

        Raises:
            OneBotError: the description does not determine the geometry, the geometry is unusable,
                or a joint to publish is not among the robot's.
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
        """Apply changed parameters, from the next cycle on.

        Raises:
            OneBotError: they do not suit the robot; then nothing has changed.
        """
        self.geometry, kinematics, self.broadcaster = self.fitted(config)
        self.diff_drive.configure(config, kinematics)
        self._use(config)

    def _use(self, config: ControlConfig) -> None:
        self.config, self.period = config, 1.0 / config.update_rate
        self._drift_cycles = math.ceil(_DRIFT_PERIOD * config.update_rate)

    def accept(self, linear: float, angular: float, age: float | None = None) -> str | None:
        """Command a velocity; see ``DiffDriveController.accept``."""
        return self.diff_drive.accept(linear, angular, age)

    def begin(self, stamp: int = 0) -> Snapshot:
        """Read the robot's state and update the controllers with it, at a ``stamp`` in ns."""
        self.observe()
        self._command = self.diff_drive.decide(self.period)
        for name, arm in self.arms.items():
            positions, velocities, _ = self.states(name)
            motion = JointMotion(positions, velocities, ())
            self.finish(name, arm.update(motion, stamp, self.period))
            limits = arm.motor_limits
            if limits is not None and limits != self._motor_limits.get(name):
                self._motor_limits[name] = limits
                for joint in arm.names:
                    self.body.limit(joint, *limits)
        snapshot = self.snapshot()
        if self.wheels and self.ticks % self._drift_cycles == 0:
            self.drift.update(snapshot.odometry, self.true_pose, lambda: self.body.obstructed)
        return snapshot

    def observe(self) -> None:
        """Read the robot's state and update the odometry, unless done already in this cycle."""
        if self._observed == self.ticks:
            return
        self._observed = self.ticks
        self._read_state()
        left, left_velocity = self._left.mean(self._joints)
        right, right_velocity = self._right.mean(self._joints)
        wheels = WheelStates(left, right, left_velocity, right_velocity)
        self.diff_drive.observe(wheels, self.period)

    def turn(self) -> None:
        """Set the wheel velocities that ``begin`` decided on, for the world's next step."""
        left, right = self._command.left, self._command.right
        # ``Wheels.names`` are the driven joints.
        self.body.turn(self._left.velocities(left) + self._right.velocities(right))
        if self.arms:
            self.body.follow([self._reference(ahead) for ahead in self.body.ends(self.period)])
        self.ticks += 1

    def _reset_arms(self) -> None:
        """Hold the joints of arms at their start positions; goals end."""
        for name, arm in self.arms.items():
            self.finish(name, [arm.reset([self._starts[joint] for joint in arm.names])])

    def hold_arms(self, text: str) -> None:
        """Abort the goals of all arms with ``text`` as the reason, and hold the arms."""
        for name, arm in self.arms.items():
            self.finish(name, [arm.abort(text)])

    def configure_arm(self, controller: JointController[Any]) -> None:
        """Apply changed parameters of one joint controller."""
        self.joint_controllers[controller.name] = controller
        self.arms[controller.name].configure(controller.config)

    def finish(self, arm: str, outcomes: Iterable[Outcome | None]) -> None:
        """Report how goals of an arm ended; None is no goal."""
        self.finished += [(arm, outcome) for outcome in outcomes if outcome is not None]

    def states(self, arm: str) -> JointStates:
        """Return the measured states of the joints of one arm."""
        rows = self._arm_rows[arm]
        return JointStates(*(tuple([field[row] for row in rows]) for field in self._joints))

    def _reference(self, ahead: float) -> list[float]:
        """Return the commanded positions, ``ahead`` seconds after the cycle's beginning."""
        return [position for arm in self.arms.values() for position in arm.reference(ahead)]

    def snapshot(self) -> Snapshot:
        """Return the state of the robot as last read."""
        odometry, pace = self.diff_drive.odometry, self.diff_drive.pace
        return Snapshot(
            self.ticks,
            self._joints,
            odometry.pose,
            odometry.covariance,
            (odometry.linear * pace, odometry.angular * pace),
            self._pose,
            self._mass_velocity,
            pace,
            self._command,
        )

    def reset(self) -> None:
        """Move the robot back to its start, with odometry at zero; time and parameters stay."""
        self.body.reset()
        self.begin_at_rest()

    def begin_at_rest(self) -> None:
        """Begin with odometry at zero where the body was placed at rest, as after ``reset``."""
        self._halt()
        self._reset_arms()
        self._read_state()
        self.diff_drive.odometry.reset()
        self.place_odometry(PlanarPose())
        self._observed = -1

    def teleport(self, pose: PlanarPose) -> None:
        """Move the robot to another pose in the world, at rest; its odometry does not change."""
        self.body.teleport(*pose)
        self._halt()
        self.diff_drive.odometry.forget_wheels()
        self.drift.restart()
        self._read_state()
        self._observed = -1

    def set_joints(self, positions: Mapping[str, float]) -> None:
        """Set positions of joints, rad or m, at rest; controllers hold them there.

        Joints that mimic them follow. Other joints and the base go on; a goal of a controller
        whose joints are set ends.

        Raises:
            OneBotError: a joint cannot be set, a position is not finite or beyond the joint's
                limits, or the robot would be in something there; then nothing has changed.
        """
        moving = {joint.name: joint for joint in self.description.moving_joints}
        settable = [name for name in self.body.joints if name not in self.body.spawn.gears]
        problems = []
        for name, position in positions.items():
            if name not in settable:
                problems.append(f'joint "{name}" cannot be set{did_you_mean(name, settable)}')
            elif not moving[name].range[0] <= position <= moving[name].range[1]:
                lower, upper = moving[name].range
                problems.append(f'joint "{name}": {position} is not from {lower:g} to {upper:g}')
            elif not math.isfinite(position):
                problems.append(f'joint "{name}": {position} is not finite')
        if problems:
            raise OneBotError("\n".join(f"{self.description.source}: {each}" for each in problems))
        gears = self.body.spawn.gears.items()
        followers = {
            name: mimic.at(positions[mimic.joint])
            for name, mimic in gears
            if mimic.joint in positions
        }
        self.body.world.set_joints(self.body, {**positions, **followers})
        for name, arm in self.arms.items():
            present = dict(zip(arm.names, arm.reference(0.0), strict=True))
            if not present.keys().isdisjoint(positions):
                held = {name: positions.get(name, at) for name, at in present.items()}
                self.finish(name, [arm.reset([*held.values()])])
        self._read_state()
        if not positions.keys().isdisjoint(self.body.driven):
            self.diff_drive.odometry.forget_wheels()
            self._observed = -1

    def _halt(self) -> None:
        """Drop the command, and what ``begin`` decided if ``turn`` is still to come."""
        self.diff_drive.halt()
        self._command = _NO_COMMAND

    def place_odometry(self, pose: PlanarPose) -> None:
        """Set the odometry's current pose to ``pose``, with zero covariance."""
        self.diff_drive.odometry.set_pose(*pose)
        self._odom_placed = self.true_pose.compose(pose.inverse())
        self.drift.restart()

    @property
    def odom_in_world(self) -> PlanarPose:
        """The pose of the odometry frame in the world.

        On bare ground it changes only when the odometry is set; in a scene, where wheels slip, it
        changes all the time.
        """
        if self.body.world.scene is None:
            return self._odom_placed
        return self.true_pose.compose(self.diff_drive.odometry.pose.inverse())

    @property
    def world_frame(self) -> str:
        """Name of the frame of true poses; "" if they are in the odometry's frame."""
        return self.config.world_frame(in_scene=self.body.world.scene is not None)

    def continue_from(self, other: "ControlledRobot") -> None:
        """Take over odometry, cycle count and arms of the robot that this one replaces."""
        odometry = other.diff_drive.odometry
        self.diff_drive.odometry.set_pose(*odometry.pose, odometry.covariance)
        self._odom_placed, self.ticks = other._odom_placed, other.ticks
        self.drift.restart()
        self._continue_arms(other)

    def _continue_arms(self, other: "ControlledRobot") -> None:
        """Hold the arms where they are; arms with the same joints keep moving."""
        self.finished = other.finished
        positions = dict(zip(self.body.joints, self.body.positions, strict=True))
        for name, arm in self.arms.items():
            old = other.arms.get(name)
            if old and old.joints == arm.joints:
                self.arms[name] = old
                continue
            arm.reset([positions[joint] for joint in arm.names])
            text = "Current goal cancelled: the robot description has other joints."
            self.finish(name, [old.abort(text) if old else None])

    def _read_state(self) -> None:
        self._joints, self._pose, self._mass_velocity = self.body.state()
        if self._followers:
            self._joints = self._followed(self._joints)

    def _followed(self, states: JointStates) -> JointStates:
        """Return the states of the body's joints, then of the joints that mimic them."""
        positions, velocities, efforts = map(list, states)
        for leader, follower in self._followers:
            at = follower.at(positions[leader])
            moves = follower.lower < at < follower.upper
            positions.append(at)
            velocities.append(follower.mimic.multiplier * velocities[leader] if moves else 0.0)
            efforts.append(0.0)
        return JointStates(tuple(positions), tuple(velocities), tuple(efforts))


def wheels_of(description: Description, config: ControlConfig) -> Wheels:
    """Return the driven wheels: those that the parameters name, or those found in the URDF."""
    return Wheels(description, config.left_wheel_names, config.right_wheel_names)
