"""One robot of a world: its motors, state and placement."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

from onebot_control.physics.engine import Bullet, engine
from onebot_control.physics.rest_pose import RestPose
from onebot_control.physics.spawning import (
    RobotSpawn,
    checked_place,
    load_robot,
)
from onebot_description.geometry.poses import (
    PlanarPose,
    Quaternion,
    Transform,
    Triple,
    clamp,
    conjugate,
    cross,
    rotate,
)

_EFFORT = 3  # column of the effort in getJointStates
_MOVING = 1e-4  # rad/s or m/s above which a motor must overcome the full friction of its joint


class JointStates(NamedTuple):
    """State of all moving joints, in the description's order."""

    positions: tuple[float, ...]  # rad (never wrapped), m for prismatic joints
    velocities: tuple[float, ...]  # rad/s or m/s
    efforts: tuple[float, ...]  # mean of the motor in the last ``step``, Nm or N; 0 without motor


class Twist(NamedTuple):
    """Velocity of the root link's frame in its own axes, as in nav_msgs/Odometry."""

    linear: Triple  # velocity of the frame's origin, m/s
    angular: Triple  # rad/s


class MassVelocity(NamedTuple):
    """Velocity of the root link's center of mass in the world's axes, as in PyBullet."""

    linear: Triple  # m/s
    angular: Triple  # rad/s
    center: Triple  # the center of mass in the root link's frame, m

    def twist(self, rotation: Quaternion) -> Twist:
        """Return the velocity of the root link's frame: v - w x c, turned into the frame's axes.

        Args:
            rotation: rotation of the root link's frame in the world.
        """
        back = conjugate(rotation)
        x, y, z = rotate(back, self.linear)
        turning = rotate(back, self.angular)
        a, b, c = cross(turning, self.center)
        return Twist((x - a, y - b, z - c), turning)


class _World(Protocol):
    """The part of ``World`` that a robot uses."""

    bullet: Bullet

    @property
    def scene(self) -> object | None: ...

    def check(self) -> None: ...

    def stand(self, places: Mapping["RobotBody", PlanarPose], *, at_start: bool) -> None: ...

    def set_joints(self, robot: "RobotBody", positions: Mapping[str, float]) -> None: ...


class RobotBody:
    """One simulated robot, which moves when its world steps.

    A motor makes each driven joint follow a velocity, and each commanded joint follow positions,
    limited by effort and velocity of ``<limit>``. Gears move joints that mimic a commanded one. All
    other joints turn freely, except for friction and damping of their ``<dynamics>``.

    Before each physics step of length dt, a commanded joint at q is given the velocity (r - q) / dt
    with the reference r at the end of the step, which it reaches unless a limit prevents it.

    Attributes:
        world: its world.
        spawn: the robot as given.
        joints: names of the moving joints, in the description's order.
        driven: names of the joints that follow velocities, in the given order.
        commanded: names of the joints that follow positions, in the given order.
        starts: start positions, in the order of ``joints``.
        rest_pose: height and tilt at rest on level ground.
        parts: its PyBullet indices.
        pose: the root link's frame, as last read.
        positions: joint positions, in the order of ``joints``, as last read.
        finite: whether the state last read was finite.
    """

    rest_pose: RestPose

    def __init__(self, world: _World, spawn: RobotSpawn) -> None:
        """Look up the joints; ``load`` adds the robot to its world.

        Raises:
            OneBotError: the start pose is not finite, or too far from the origin.
        """
        self.world, self.spawn = world, spawn
        self.start_at(spawn.start)
        moving = {joint.name: joint for joint in spawn.description.moving_joints}
        self.joints = tuple(moving)
        self.driven, self.commanded = tuple(spawn.driven), tuple(spawn.commanded)
        self.starts = tuple([spawn.starts.get(name, 0.0) for name in self.joints])
        motors = [moving[name] for name in (*self.driven, *self.commanded)]
        self._motors = [self.joints.index(joint.name) for joint in motors]
        count = len(self.driven)
        self._frictions = [0.0] * count + [joint.friction for joint in motors[count:]]
        self._most_efforts = [joint.effort or 0.0 for joint in motors]
        strengths = list(map(_strength, self._most_efforts, self._frictions))
        self._strengths, self._strengths_commanded = strengths[:count], strengths[count:]
        fastest = [math.inf if joint.velocity is None else joint.velocity for joint in motors]
        self._fastest = fastest[:count]
        self._limits = [
            (*joint.range, most)
            for joint, most in zip(motors[count:], fastest[count:], strict=True)
        ]
        self._all_limits = tuple(self._limits)
        self._references: Sequence[Sequence[float]] = [
            [spawn.starts.get(name, 0.0) for name in self.commanded]
        ]
        self.finite = True

    def start_at(self, place: PlanarPose) -> None:
        """Change the robot's start pose, from the world's next restart on.

        Raises:
            OneBotError: the pose is not finite, or too far from the origin.
        """
        self.spawn = self.spawn._replace(start=checked_place(*place))

    def load(self) -> None:
        """Add the robot to its world, at the origin."""
        bullet = self.world.bullet
        self.parts = load_robot(bullet, self.spawn)
        self._step = 1.0 / bullet.settings.rate
        body = self.parts.body
        self._indices = list(self.parts.joints.values())
        motors = [self.parts.joints[name] for name in (*self.driven, *self.commanded)]
        self._driven_indices = motors[: len(self.driven)]
        self._commanded_indices = motors[len(self.driven) :]
        self._read_joints, self._read_motors = self._reader(self._indices), self._reader(motors)
        self._read_velocity = partial(bullet.getBaseVelocity, body)
        self._set_motors = partial(
            bullet.setJointMotorControlArray, body, controlMode=engine.VELOCITY_CONTROL
        )
        self._targets = [0.0] * len(self.driven)
        self._efforts = (0.0,) * len(self.joints)  # efforts of the motors
        self._sums = [0.0] * len(motors)  # efforts summed over all physics steps but the last
        self.read_again()

    def obstructed(self) -> bool:
        """Return whether something other than the ground touches the robot."""
        own = {self.parts.body, self.world.bullet.ground}
        points = self.world.bullet.getContactPoints(self.parts.body)
        return any(not {point[1], point[2]} <= own for point in points)

    def turn(self, velocities: Sequence[float]) -> None:
        """Set the motors' target velocities, which apply until others are set.

        Args:
            velocities: velocities in the order of ``driven``, rad/s (m/s for prismatic joints);
                they are clamped to the joints' limits. A velocity that is not finite would make the
                whole world NaN permanently.
        """
        self.world.check()
        # PyBullet keeps the targets; setting them takes as long as reading the joints.
        if list(velocities) != self._targets:
            self._drive(self.targets(velocities))

    def targets(self, velocities: Sequence[float]) -> list[float]:
        """Return velocities within the joints' limits; see ``turn``."""
        return [
            clamp(velocity, -fastest, fastest)
            for velocity, fastest in zip(velocities, self._fastest, strict=True)
        ]

    def ends(self, duration: float) -> list[float]:
        """Return the end times of the physics steps in the next ``duration``, s; s from now."""
        count = self.world.bullet.settings.steps(duration)
        return [(step + 1) * self._step for step in range(count)]

    def follow(self, references: Sequence[Sequence[float]]) -> None:
        """Set the target positions of the commanded joints for the next ``World.step``.

        Args:
            references: positions at the end of each physics step (see ``ends``), in the order of
                ``commanded``, rad or m; the last ones apply until others are set.
        """
        self._references = references

    def track(self, step: int) -> None:
        """Set the motors of the commanded joints for physics step number ``step``."""
        # Comparisons: min() and max() would take three times as long.
        targets = []
        for goal, position, (lower, upper, fastest) in zip(
            self._references[min(step, len(self._references) - 1)],
            self._commanded_positions,
            self._limits,
            strict=True,
        ):
            within = lower if goal < lower else upper if goal > upper else goal
            speed = (within - position) / self._step
            targets.append(fastest if speed > fastest else -fastest if speed < -fastest else speed)
        self._set_motors(
            jointIndices=self._commanded_indices,
            targetVelocities=targets,
            forces=self._strengths_commanded,
        )

    def limit(self, name: str, effort: float, velocity: float) -> None:
        """Limit the motor of a commanded joint, in addition to the joint's own limits.

        Args:
            name: the joint.
            effort: maximum effort, Nm or N; 0 for the joint's own limit.
            velocity: maximum velocity, rad/s or m/s; 0 for the joint's own limit.
        """
        number = self.commanded.index(name)
        motor = len(self.driven) + number
        most = min(self._most_efforts[motor], effort or math.inf)
        self._strengths_commanded[number] = _strength(most, self._frictions[motor])
        lower, upper, fastest = self._all_limits[number]
        self._limits[number] = lower, upper, min(fastest, velocity or math.inf)

    def state(self) -> tuple[JointStates, Transform, MassVelocity]:
        """Return the state of the joints, and the true pose and velocity of the root link."""
        self.world.check()
        return (
            JointStates(self.positions, self._velocities, self._efforts),
            self.pose,
            MassVelocity(*self._velocity, self.parts.mass_frame[0]),
        )

    def reset(self) -> None:
        """Move the robot and the scene's boxes back to their start; time continues.

        A box is not moved if a robot is in its place.

        Raises:
            OneBotError: another robot is at its start, or it cannot stand there; nothing has
                changed.
        """
        self.world.stand({self: self.spawn.start}, at_start=True)

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Move the robot to another pose, at rest.

        Joint positions and time continue, so that odometry is not affected.

        Args:
            x: x coordinate of the root link's frame in the world, m.
            y: y coordinate of the root link's frame in the world, m.
            yaw: heading of that frame, rad.

        Raises:
            OneBotError: the pose is not finite, or too far from the origin to be exact, another
                robot is there, or the scene leaves no place to stand; nothing has changed.
        """
        self.world.stand({self: checked_place(x, y, yaw)}, at_start=False)

    def put(self, pose: Transform, positions: Sequence[float] | None = None) -> None:
        """Place the robot at rest with these joint positions, by default ``starts``."""
        self.parts.place(pose, positions or self.starts)
        # A saved state contains neither targets nor efforts of motors.
        self._drive([0.0] * len(self.driven))
        self._efforts = (0.0,) * len(self.joints)
        self.read_again()

    def read_again(self) -> None:
        """Read the state after joints have been set."""
        self._update(self._read_joints())

    def continue_from(self, other: "RobotBody") -> None:
        """Adopt pose, velocity and motors of the same robot in another world."""
        body, bullet = self.parts.body, self.world.bullet
        self.parts.place(other.pose)
        bullet.resetBaseVelocity(body, *other._velocity)
        states = zip(self._indices, other.positions, other._velocities, strict=True)
        for index, position, velocity in states:
            bullet.resetJointState(body, index, position, velocity)
        self._drive(other._targets)
        self._efforts = other._efforts
        self.read_again()

    def continue_joints(self, other: "RobotBody") -> None:
        """Adopt the joint positions, except of wheels, of the robot that this one replaces."""
        positions = {**self.spawn.starts}
        present = zip(other.joints, other.positions, strict=True)
        positions.update((name, at) for name, at in present if name in positions)
        self.put(self.pose, [positions.get(name, 0.0) for name in self.joints])

    def record_efforts(self) -> None:
        """Sum up the motors' efforts after a physics step; ``read`` adds those of the last one."""
        # Only keep floats: whole states of 100 robots would not fit into the processor's caches.
        states = self._read_motors()
        # Not sum(), which rounds differently from Python 3.12 on.
        self._sums = [
            effort + state[_EFFORT] for effort, state in zip(self._sums, states, strict=True)
        ]
        if self.commanded:
            self._commanded_positions = [state[0] for state in states[len(self.driven) :]]

    def read(self, steps: int) -> None:
        """Read the state after ``steps`` physics steps."""
        states = self._read_joints()
        efforts = [0.0] * len(states)
        for index, total, friction in zip(self._motors, self._sums, self._frictions, strict=True):
            efforts[index] = (total + states[index][_EFFORT]) / steps
            if friction:  # PyBullet does not include it, but the motor must overcome it
                efforts[index] += friction * clamp(states[index][1] / _MOVING, -1.0, 1.0)
        self._efforts, self._sums = tuple(efforts), [0.0] * len(self._sums)
        self._references = self._references[-1:]
        self._update(states, base_moves=not self.spawn.fixed_base)

    def _reader(self, indices: Sequence[int]) -> Callable[[], Sequence[Sequence[Any]]]:
        """Return a function that reads joints; PyBullet would return None for no joints."""
        if not indices:
            return tuple
        return partial(self.world.bullet.getJointStates, self.parts.body, indices)

    def _drive(self, targets: list[float]) -> None:
        self._targets = targets
        if not targets:
            return
        self._set_motors(
            jointIndices=self._driven_indices, targetVelocities=targets, forces=self._strengths
        )

    def _update(self, states: Sequence[Sequence[Any]], *, base_moves: bool = True) -> None:
        """Store the joints' state, read the base's, and check that all values are finite."""
        self.positions = tuple([state[0] for state in states])
        self._velocities = tuple([state[1] for state in states])
        indices = self._motors[len(self.driven) :]
        self._commanded_positions = [self.positions[index] for index in indices]
        if base_moves:
            self.pose = self.parts.pose()
            self._velocity: tuple[Triple, Triple] = self._read_velocity()
        (place, turn), (linear, angular) = self.pose, self._velocity
        root = *place, *turn, *linear, *angular
        joints = *self.positions, *self._velocities, *self._efforts
        self.finite = math.isfinite(sum(root) + sum(joints))


def _strength(effort: float, friction: float) -> float:
    """Return the maximum effort of a motor, minus the friction of its joint."""
    return max(effort - friction, friction)
