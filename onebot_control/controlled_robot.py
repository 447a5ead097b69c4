"""One simulated robot with its controllers, which run in control cycles. No ROS here."""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from onebot_control.conventions import BROADCASTER
from onebot_control.drive.drive import Drive, DriveState, NoDrive
from onebot_control.joint_controllers import JointController, named
from onebot_control.physics.robot_body import JointStates, MassVelocity, RobotBody, Twist
from onebot_control.prepared_robot import PreparedRobot
from onebot_control.simulation_parameters import INTERFACES, BroadcasterConfig, SimulationConfig
from onebot_control.trajectories.following import JointFollower, Outcome
from onebot_control.trajectories.goal import FollowedJoint, MotorLimits
from onebot_control.trajectories.trajectory import JointMotion
from onebot_description.errors import OneBotError, did_you_mean, unknown_names
from onebot_description.geometry.poses import PlanarPose, Transform, clamp, scaled, total, yaw_of
from onebot_description.parameters.reader import ConfigError, Problem

_DRIFT_PERIOD = 0.1  # s between comparisons of odometry and ground truth


class Snapshot(NamedTuple):
    """The state of a robot in one control cycle.

    Velocities are per second of the clock of the stamps, except where stated. If the simulation is
    slower than this clock, they are lower than in simulated time.
    """

    tick: int  # cycles done before this one
    joints: JointStates  # all moving joints, in simulated time
    pose: Transform  # true pose of the root link in the world
    mass_velocity: MassVelocity  # true velocity, in simulated time
    pace: float  # simulated seconds per second of the clock
    drive: DriveState | None  # None if it has no wheels to drive on

    @property
    def joint_states(self) -> JointStates:
        """The states of all moving joints."""
        return self.joints._replace(
            velocities=tuple([speed * self.pace for speed in self.joints.velocities])
        )

    @property
    def velocity(self) -> Twist:
        """The true velocity of the root link's frame, in its own axes."""
        linear, angular = self.mass_velocity.twist(self.pose.rotation)
        return Twist(scaled(linear, self.pace), scaled(angular, self.pace))


class JointStateBroadcaster:
    """Chooses the joints and interfaces of JointState messages, as in ros2_control."""

    def __init__(
        self,
        config: BroadcasterConfig,
        joints: Sequence[str],
        held: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Choose the joints that the parameters name, or all.

        Args:
            config: joint_state_broadcaster's parameters.
            joints: names of the joints whose states are passed to ``values``, in that order.
            held: joints that do not move, with their positions, rad or m.

        Raises:
            ConfigError: a joint that the parameters name is not among them.
        """
        joints = (*joints, *held)
        chosen = config.joints or joints
        problems = [
            Problem(f"{BROADCASTER}.joints", f'no joint "{name}"{hint}')
            for name, hint in unknown_names(chosen, joints)
        ]
        if problems:
            raise ConfigError(problems)
        published = {*chosen}
        extra = [name for name in config.extra_joints if name not in published]
        self.names = (*chosen, *extra)
        self.frame_id = config.frame_id
        self._indices = [joints.index(name) for name in chosen]
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
        return [field[index] for index in self._indices] + self._extra


class CyclePace:
    """Duration of the cycles divided by the elapsed time: 1, or less if cycles were late.

    A velocity times the pace is the change of position per change of stamp.

    Attributes:
        value: the average over some cycles.
    """

    def __init__(self) -> None:
        """Start without cycles; call ``set_window`` before the first one."""
        # Pairs: duration of a cycle, and elapsed time (equal or longer), s.
        self._passed: deque[tuple[float, float]] = deque()
        self.value, self._stalled = 1.0, 0.0

    def set_window(self, window: int) -> None:
        """Average over ``window`` cycles from now on."""
        self._passed = deque(self._passed, window)

    def cycle(self, seconds: float) -> None:
        """Record a control cycle."""
        self._pass(seconds + self._stalled, seconds)
        self._stalled = 0.0

    def wait(self, seconds: float, *, stalled: bool = False) -> None:
        """Record ``seconds`` without a cycle; the time of a stall counts for the next cycle."""
        if stalled:
            self._stalled += seconds
        else:
            self._pass(seconds, 0.0)

    def _pass(self, seconds: float, cycle: float) -> None:
        self._passed.append((cycle, seconds))
        if self.value < 1.0 or cycle < seconds:
            cycles, durations = zip(*self._passed, strict=True)
            self.value = total(cycles) / total(durations)


class ControlledRobot:
    """A simulated robot with its controllers.

    Attributes:
        description: the robot as read, before it was prepared.
        config: the current parameters.
        drive: the drive of its wheels; None if its base is fixed.
        pace: the pace of its cycles.
        body: the simulated robot.
        followers: the followers that move joints, by the names of their controllers.
        joints: names of the moving joints: the body's, then those that mimic its wheels.
        held: positions of the joints that do not move, by name.
        finished: goals that have ended, as (controller, outcome); the reader empties it.
        ticks: number of control cycles done.
        period: duration of a control cycle, s.
    """

    def __init__(self, prepared: PreparedRobot, body: RobotBody) -> None:
        """Start at rest where the body is, with odometry at zero.

        Args:
            prepared: the robot, prepared for its world.
            body: the simulated robot.

        Raises:
            OneBotError: see ``fitted``.
        """
        self._prepared, self.body, spawn = prepared, body, prepared.spawn
        self.description, self.held = prepared.member.description, spawn.held
        self.joints = (*body.joints, *spawn.wheel_mimics)
        ranges = {joint.name: joint.range for joint in self.description.joints}
        self._wheel_mimics = [
            (mimic, body.joints.index(mimic.joint), *ranges[name])
            for name, mimic in spawn.wheel_mimics.items()
        ]
        self._starts = spawn.starts
        self.joint_controllers = {**prepared.controllers}
        self.followers: dict[str, JointFollower] = {}
        self.finished: list[tuple[str, Outcome]] = []
        self.start(prepared.member.config)

    def start(self, config: SimulationConfig) -> None:
        """Start again with these parameters, at rest, with odometry and time at zero.

        Raises:
            OneBotError: see ``fitted``.
        """
        wheels, drive = self._prepared.wheels, config.drive
        self.drive = Drive(wheels, self.body.joints, drive) if drive else None
        self._base: Any = self.drive or NoDrive()
        self.pace = CyclePace()
        self.configure(config)
        self.ticks, self._observed = 0, -1
        self._reset_followers()
        self.followers = {
            name: self._follower(controller) for name, controller in self.joint_controllers.items()
        }
        self._follower_indices = {
            name: [self.body.joints.index(joint) for joint in follower.names]
            for name, follower in self.followers.items()
        }
        self.move_into(self.body)
        self._read_state()
        self.place_odometry(PlanarPose())

    def move_into(self, body: RobotBody) -> None:
        """Control the same robot in another world from now on."""
        self.body = body
        self._motor_limits: dict[str, MotorLimits] = {}  # limits set on the body, by controller

    def _follower(self, controller: JointController[Any]) -> JointFollower:
        """Return the follower that moves a controller's joints from their start positions."""
        moving = {joint.name: joint for joint in self.description.moving_joints}
        interfaces = self.description.interfaces
        joints = []
        for name in self._prepared.controlled[controller.name]:
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

    def fitted(self, config: SimulationConfig) -> JointStateBroadcaster:
        """Check ``config``, and return the broadcaster that it gives this robot.

        Raises:
            OneBotError: the parameters do not match the drive, or a joint to publish is not among
                the robot's joints.
        """
        self._base.check(config.drive)
        return JointStateBroadcaster(config.broadcaster, self.joints, self.held)

    def configure(self, config: SimulationConfig) -> None:
        """Apply changed parameters, from the next cycle on.

        Raises:
            OneBotError: they do not match the robot; nothing has changed.
        """
        self.broadcaster = self.fitted(config)
        self._base.configure(config.drive)
        self.config, self.period = config, 1.0 / config.update_rate
        self.pace.set_window(self._base.window)
        self._drift_cycles = math.ceil(_DRIFT_PERIOD * config.update_rate)

    def accept(
        self, linear: float, angular: float, age: float | None = None, *, lateral: float = 0.0
    ) -> str | None:
        """Command a velocity; see ``Drive.accept``. A robot with a fixed base ignores it."""
        refused: str | None = self._base.accept(linear, angular, age, lateral=lateral)
        return refused

    def wait(self, seconds: float, *, stalled: bool = False) -> None:
        """Let time pass without a control cycle, as in a pause.

        Args:
            seconds: how long.
            stalled: whether this process did not run.
        """
        self.pace.wait(seconds, stalled=stalled)
        self._base.wait(seconds)

    def begin(self, stamp: int = 0) -> Snapshot:
        """Read the robot's state and update the controllers with it, at a ``stamp`` in ns."""
        self.observe()
        self.pace.cycle(self.period)
        self._base.decide(self.period)
        if self.drive and self.ticks % self._drift_cycles == 0:
            odometry, obstructed = self.drive.odometry.pose, self.body.obstructed()
            self.drive.drift.update(odometry, self.true_pose, obstructed=obstructed)
        for name, follower in self.followers.items():
            positions, velocities, _ = self.states(name)
            motion = JointMotion(positions, velocities, ())
            self.finish(name, follower.update(motion, stamp, self.period))
            limits = follower.motor_limits
            if limits is not None and limits != self._motor_limits.get(name):
                self._motor_limits[name] = limits
                for joint in follower.names:
                    self.body.limit(joint, *limits)
        return self.snapshot()

    def observe(self) -> None:
        """Read the robot's state and update the odometry, once per cycle."""
        if self._observed == self.ticks:
            return
        self._observed = self.ticks
        self._read_state()
        self._base.observe(self._joints.positions, self._joints.velocities, self.period)

    def turn(self) -> None:
        """Set the wheel velocities that ``begin`` has computed, for the world's next step."""
        self.body.turn(self._base.velocities)
        if self.followers or self._base.steering:
            self.body.follow([self._reference(ahead) for ahead in self.body.ends(self.period)])
        self.ticks += 1

    def _reset_followers(self) -> None:
        """Hold the joints of controllers at their start positions; goals end."""
        for name, follower in self.followers.items():
            self.finish(name, [follower.reset([self._starts[joint] for joint in follower.names])])

    def stop(self, text: str) -> None:
        """Brake, and hold the joints, with ``text`` as the reason why goals end."""
        self.accept(0.0, 0.0)
        self.hold_joints(text)

    def hold_joints(self, text: str) -> None:
        """Abort the goals of all controllers with ``text`` as the reason, and hold their joints."""
        for name, follower in self.followers.items():
            self.finish(name, [follower.abort(text)])

    def configure_controller(self, controller: JointController[Any]) -> None:
        """Apply changed parameters of one joint controller."""
        self.joint_controllers[controller.name] = controller
        self.followers[controller.name].configure(controller.config)

    def finish(self, controller: str, outcomes: Iterable[Outcome | None]) -> None:
        """Report how goals of a controller ended; None entries are ignored."""
        self.finished += [(controller, outcome) for outcome in outcomes if outcome is not None]

    def states(self, controller: str) -> JointStates:
        """Return the measured states of the joints of one controller."""
        indices = self._follower_indices[controller]
        return JointStates(*(tuple([field[index] for index in indices]) for field in self._joints))

    def _reference(self, ahead: float) -> list[float]:
        """Return the commanded positions, ``ahead`` seconds after the start of the cycle."""
        positions = [
            position
            for follower in self.followers.values()
            for position in follower.reference(ahead)
        ]
        return [*positions, *self._base.steering]

    def snapshot(self) -> Snapshot:
        """Return the state of the robot as last read."""
        pace = self.pace.value
        drive = self._base.state(pace)
        return Snapshot(self.ticks, self._joints, self._pose, self._mass_velocity, pace, drive)

    def reset(self) -> None:
        """Move the robot back to its start, with odometry at zero; time and parameters stay."""
        self.body.reset()
        self.begin_at_rest()

    def begin_at_rest(self) -> None:
        """Start with odometry at zero where the body was placed at rest, as after ``reset``."""
        self._reset_followers()
        self._begin_here()
        self.place_odometry(PlanarPose())

    def teleport(self, pose: PlanarPose) -> None:
        """Move the robot to another pose in the world, at rest; its odometry does not change."""
        self.body.teleport(*pose)
        self._begin_here()

    def _begin_here(self) -> None:
        """Stop the drive where the body was placed, and discard velocities for ``turn``."""
        self._base.moved()
        self._read_state()
        self._observed = -1

    def set_joints(self, positions: Mapping[str, float]) -> None:
        """Set positions of joints, rad or m, at rest; controllers hold them there.

        Joints that mimic them follow. Other joints and the base continue; a goal of a controller
        whose joints are set ends.

        Raises:
            OneBotError: a joint cannot be set, a position is beyond the joint's limits, or the
                robot would overlap something; nothing has changed.
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
        if problems:
            raise OneBotError(
                "\n".join(f"{self.description.source}: {problem}" for problem in problems)
            )
        gears = self.body.spawn.gears.items()
        mimics = {
            name: mimic.at(positions[mimic.joint])
            for name, mimic in gears
            if mimic.joint in positions
        }
        self.body.world.set_joints(self.body, {**positions, **mimics})
        for name, follower in self.followers.items():
            present = dict(zip(follower.names, follower.reference(0.0), strict=True))
            if not present.keys().isdisjoint(positions):
                held = {name: positions.get(name, at) for name, at in present.items()}
                self.finish(name, [follower.reset([*held.values()])])
        self._read_state()
        if self.drive and not positions.keys().isdisjoint(self.body.driven):
            self.drive.odometry.forget_wheels()
            self._observed = -1

    def place_odometry(self, pose: PlanarPose) -> None:
        """Set the odometry's current pose to ``pose``, with zero covariance."""
        self._base.place(pose, self.true_pose)

    @property
    def odom_in_world(self) -> PlanarPose:
        """The pose of the odometry frame in the world; zero for a robot with a fixed base.

        On bare ground it changes only when the odometry is set; in a scene, where wheels slip, it
        changes continuously.
        """
        if self.drive is None:
            return PlanarPose()
        if self.body.world.scene is None:
            return self.drive.origin
        return self.true_pose.compose(self.drive.odometry.pose.inverse())

    @property
    def world_frame(self) -> str:
        """Name of the frame of true poses; "" if they are in the odometry's frame."""
        return self.config.world_frame(in_scene=self.body.world.scene is not None)

    def continue_from(self, other: "ControlledRobot") -> None:
        """Take over odometry, cycle count and followers of the robot that this one replaces."""
        self.ticks = other.ticks
        self._base.continue_from(other.drive)
        self._continue_followers(other)

    def _continue_followers(self, other: "ControlledRobot") -> None:
        """Hold the joints where they are; followers of the same joints keep moving."""
        self.finished = other.finished
        positions = dict(zip(self.body.joints, self.body.positions, strict=True))
        for name, follower in self.followers.items():
            old = other.followers.get(name)
            if old and old.joints == follower.joints:
                self.followers[name] = old
                continue
            follower.reset([positions[joint] for joint in follower.names])
            text = "Current goal cancelled: the robot description has other joints."
            self.finish(name, [old.abort(text) if old else None])

    def _read_state(self) -> None:
        self._joints, self._pose, self._mass_velocity = self.body.state()
        if self._wheel_mimics:
            self._joints = self._with_mimics(self._joints)

    def _with_mimics(self, states: JointStates) -> JointStates:
        """Return the states of the body's joints, then of those that mimic its wheels."""
        positions, velocities = [*states.positions], [*states.velocities]
        for mimic, leader, lower, upper in self._wheel_mimics:
            at = mimic.at(positions[leader])
            positions.append(clamp(at, lower, upper))
            velocities.append(mimic.multiplier * velocities[leader] if lower < at < upper else 0.0)
        efforts = (*states.efforts, *[0.0] * len(self._wheel_mimics))
        return JointStates(tuple(positions), tuple(velocities), efforts)
