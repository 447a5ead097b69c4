"""One robot on level ground, moved by the speeds of its driven joints."""

import math
import weakref
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.frames import conjugate, cross, rotate
from onebot_control.simulation.loading import load_robot
from onebot_control.simulation.motors import Motors
from onebot_control.simulation.settings import Settings
from onebot_control.simulation.settling import link_pose, place, settle
from onebot_control.simulation.states import JointStates, Pose, Twist
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.model.robot_model import RobotModel

# Farther out, rounding is no longer small against the micrometres that a wheel's contact gives.
FARTHEST = 10_000.0


class Simulation:
    """A robot that stands on the ground of an otherwise empty world.

    Time passes only in ``step``. The same calls give the same bits, in any process. Objects are
    independent of each other; one object is for one thread at a time.

    Attributes:
        joints: names of all joints that move, in the description's order.
        driven: names of the joints that have a motor, in the order given.
        settings: as given.
    """

    def __init__(
        self,
        description: Description,
        *,
        driven: Sequence[str],
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
    ) -> None:
        """Set the robot on the ground with its joints at 0, standing still.

        Args:
            description: a checked robot; see ``load_description``.
            driven: joints with a motor, as strong as their ``<limit effort>`` and as fast as their
                ``<limit velocity>``. All others turn freely, but for the friction and damping of
                their ``<dynamics>``.
            x: where the root link's frame starts, m.
            y: likewise, m.
            yaw: its heading, rad.
            settings: how finely to compute.

        Raises:
            ValueError: x, y or yaw is not finite.
            OneBotError: the robot cannot be simulated, or a driven joint is none; the message says
                what to mend.
        """
        self.joints = RobotModel.from_description(description).joints
        self.driven = tuple(driven)
        self.settings = settings
        self._description = description
        self._start = _checked(x, y, yaw)
        self._motors = Motors(description, self.driven)
        self._driven_rows = [self.joints.index(name) for name in self.driven]
        self._build()

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._steps / self.settings.rate

    def step(self, velocities: Mapping[str, float] | ArrayLike, duration: float) -> None:
        """Let ``duration`` pass while the motors keep up the given speeds.

        A motor keeps its speed as long as its effort suffices, and is no faster than its limit.

        Args:
            velocities: of every driven joint, rad/s (m/s for prismatic ones), by name or in the
                order of ``driven``.
            duration: s; a whole number of physics steps.

        Raises:
            ValueError: a speed is not finite, too few or too many are given, or ``duration`` is no
                whole number of steps; nothing has moved then.
            OneBotError: the state has become non-finite; ``reset`` starts afresh.
        """
        targets = self._motors.targets(velocities)
        count = self._count(duration)
        self._check_usable()
        self._motors.drive(self._client, self._robot, targets)
        efforts = np.zeros(len(self.driven))
        for _ in range(count):
            engine.stepSimulation(self._client)
            efforts += self._motors.efforts(self._client, self._robot)
        self._steps += count
        self._efforts[self._driven_rows] = efforts / count
        self._read()

    def joint_states(self) -> JointStates:
        """Return position, speed and motor effort of all joints, in the order of ``joints``."""
        self._check_usable()
        positions, velocities = (np.array([s[i] for s in self._states], float) for i in (0, 1))
        return JointStates(positions, velocities, self._efforts.copy())

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        self._check_usable()
        position, rotation = self._pose
        return Pose(np.array(position), np.array(rotation))

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        self._check_usable()
        back = conjugate(self._pose[1])
        linear, angular = (rotate(back, value) for value in self._velocity)
        # PyBullet tells the velocity of the centre of mass.
        from_turning = cross(angular, self._robot.mass_frame[0])
        return Twist(np.array(linear) - np.array(from_turning), np.array(angular))

    def reset(self) -> None:
        """Return to the very state of the start, bit for bit; time is 0 again."""
        if not self._disconnect.alive:
            self._check_usable()
        if self._broken:
            # PyBullet does not recover from a NaN, not even by restoring an earlier state.
            self._disconnect()
            self._build()
        else:
            self._restart()

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Set the robot down elsewhere, standing still.

        Joint positions and time go on from where they were, so that odometry is none the wiser.

        Args:
            x: of the root link's frame, m.
            y: likewise, m.
            yaw: its heading, rad.

        Raises:
            ValueError: a value is not finite.
            OneBotError: it is too far away to be exact there.
        """
        where = _checked(x, y, yaw)
        self._check_usable()
        positions = [state[0] for state in self._states]
        engine.restoreState(self._saved, physicsClientId=self._client)
        self._stand(where, positions)

    def brake(self) -> None:
        """Stop everything at once: all speeds are exactly 0, nothing changes its place."""
        self._check_usable()
        place(self._client, self._robot, self._pose)
        self._set_joints([state[0] for state in self._states])

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError from now on."""
        self._disconnect()

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self) -> None:
        """Make the world, let the robot come to rest in it, and keep that state."""
        client: int = engine.connect(engine.DIRECT)
        self._client = client
        self._disconnect = weakref.finalize(self, engine.disconnect, client)
        try:
            self._robot = load_robot(client, self._description, self.settings)
            self._indices = [self._robot.joints[name] for name in self.joints]
            self._motors.hold(client, self._robot)
            self._stance = settle(
                client, self._robot, self._description, self.driven, self.settings
            )
        except BaseException:
            self._disconnect()
            raise
        self._saved: int = engine.saveState(physicsClientId=client)
        self._restart()

    def _restart(self) -> None:
        engine.restoreState(self._saved, physicsClientId=self._client)
        self._steps = 0
        self._stand(self._start, [0.0] * len(self.joints))

    def _stand(self, where: tuple[float, float, float], positions: Sequence[float]) -> None:
        """Set the robot down at x, y, yaw with joints at ``positions``, all of it still."""
        place(self._client, self._robot, self._stance.at(*where))
        self._set_joints(positions)

    def _set_joints(self, positions: Sequence[float]) -> None:
        for index, position in zip(self._indices, positions, strict=True):
            engine.resetJointState(
                self._robot.body, index, position, 0.0, physicsClientId=self._client
            )
        # A saved state holds no targets of motors, nor what they did last.
        self._motors.hold(self._client, self._robot)
        self._efforts = np.zeros(len(self.joints))
        self._read()

    def _read(self) -> None:
        """Fetch the state; what is not finite goes no further."""
        body, client = self._robot.body, self._client
        self._states = engine.getJointStates(body, self._indices, physicsClientId=client)
        self._pose = link_pose(client, self._robot)
        self._velocity = engine.getBaseVelocity(body, physicsClientId=client)
        total = sum(map(sum, (*self._pose, *self._velocity)))
        total += sum(state[0] + state[1] for state in self._states) + float(self._efforts.sum())
        self._broken = not math.isfinite(total)
        self._check_usable()

    def _check_usable(self) -> None:
        if not self._disconnect.alive:
            raise OneBotError("this simulation has been closed; make a new one")
        if self._broken:
            raise OneBotError(
                f"{self._description.source}: the simulation broke down: its state is no longer "
                "finite; reset it"
            )

    def _count(self, duration: float) -> int:
        """Physics steps in ``duration``."""
        steps = duration * self.settings.rate
        count = round(steps) if math.isfinite(steps) else 0
        if count < 1 or abs(steps - count) > 1e-6:
            raise ValueError(
                f"duration must be a whole number of physics steps of 1/{self.settings.rate} s, "
                f"not {duration} s"
            )
        return count


def _checked(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    if not all(map(math.isfinite, (x, y, yaw))):
        raise ValueError(f"x, y and yaw must be finite, not {x}, {y}, {yaw}")
    if max(abs(x), abs(y)) > FARTHEST:
        raise OneBotError(
            f"x {x:g} m, y {y:g} m: the simulation is exact up to {FARTHEST:g} m from the origin"
        )
    return float(x), float(y), float(yaw)
