"""Several robots on one ground, in one world, moved together."""

import weakref
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import load_robot, make_world
from onebot_control.simulation.robot import RobotBody, checked_place
from onebot_control.simulation.settings import Settings
from onebot_control.simulation.settling import Stance, place
from onebot_control.simulation.simulation import Simulation
from onebot_control.simulation.states import JointStates, Pose, Twist
from onebot_description.description import Description
from onebot_description.errors import OneBotError


class Member(NamedTuple):
    """A robot to put into a world.

    Attributes:
        description: a checked robot.
        driven: its joints with a motor; see ``Simulation``.
        x: where the root link's frame starts, m.
        y: likewise, m.
        yaw: its heading, rad.
    """

    description: Description
    driven: Sequence[str]
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0


class World:
    """Robots that stand on the same ground and may run into each other.

    Time passes in ``step``, for all of them. The same calls give the same bits, in any process.

    Attributes:
        robots: in the order given.
        settings: as given.
        client: PyBullet's number of the world, for what it can do besides.
    """

    def __init__(
        self,
        members: Sequence[Member],
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
    ) -> None:
        """Set the robots on the ground with their joints at 0, standing still.

        Args:
            members: the robots.
            settings: how finely to compute.

        Raises:
            ValueError: a place is not finite.
            OneBotError: a robot cannot be simulated, or two stand in the same place.
        """
        self.settings = settings
        self._members = tuple(members)
        self._starts = [checked_place(item.x, item.y, item.yaw) for item in self._members]
        self._stances = _stances(self._members, settings)
        self.robots = tuple(WorldRobot(self, row) for row in range(len(self._members)))
        self._build()

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._steps / self.settings.rate

    def step(self, duration: float) -> None:
        """Let ``duration`` seconds pass, a whole number of physics steps.

        Raises:
            ValueError: it is none.
            OneBotError: the state has become non-finite; ``reset`` starts afresh.
        """
        count = self.settings.steps(duration)
        self.check_usable()
        bodies = [robot.body for robot in self.robots]
        for _ in range(count):
            engine.stepSimulation(self.client)
            for body in bodies:
                body.watch()
        self._steps += count
        for body in bodies:
            body.read(count)
        self.check_usable()

    def reset(self) -> None:
        """Return to the very state of the start, bit for bit; time is 0 again."""
        if not self._disconnect.alive:
            self.check_usable()
        if all(robot.body.finite for robot in self.robots):
            self._restart()
        else:
            # PyBullet does not recover from a NaN, not even by restoring an earlier state.
            self._disconnect()
            self._build()

    def stand(self, row: int, where: tuple[float, float, float] | None = None) -> None:
        """Set the robot of ``row`` down: at x, y, yaw, or without these at its start, joints at 0.

        Raises:
            OneBotError: the world has been closed, or broke down.
        """
        self.check_usable()
        place_there = self._starts[row] if where is None else where
        self.robots[row].body.stand(self._stances[row], place_there, start=where is None)

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError from now on."""
        self._disconnect()

    def check_open(self) -> None:
        """Raise OneBotError if the world has been closed."""
        if not self._disconnect.alive:
            raise OneBotError("this world has been closed; make a new one")

    def check_usable(self) -> None:
        """Raise OneBotError if the world has been closed, or its state is not finite."""
        self.check_open()
        if not all(robot.body.finite for robot in self.robots):
            raise OneBotError("the simulation broke down: its state is no longer finite; reset it")

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self) -> None:
        client: int = engine.connect(engine.DIRECT)
        self.client = client
        self._disconnect = weakref.finalize(self, engine.disconnect, client)
        try:
            ground = make_world(client, self.settings)
            for row, member in enumerate(self._members):
                parts = load_robot(client, ground, member.description, self.settings)
                # Away from the origin, where the next one appears.
                place(client, parts, self._stances[row].at(*self._starts[row]))
                self.robots[row].body.enter(client, parts)
            self._refuse_overlaps()
        except BaseException:
            self._disconnect()
            raise
        self._saved: int = engine.saveState(physicsClientId=client)
        self._restart()

    def _restart(self) -> None:
        engine.restoreState(self._saved, physicsClientId=self.client)
        self._steps = 0
        for row, robot in enumerate(self.robots):
            robot.body.stand(self._stances[row], self._starts[row], start=True)
            robot.body.turn([0.0] * len(robot.driven))

    def _refuse_overlaps(self) -> None:
        engine.performCollisionDetection(physicsClientId=self.client)
        rows = {robot.body.parts.body: row for row, robot in enumerate(self.robots)}
        for point in engine.getContactPoints(physicsClientId=self.client):
            if point[1] != point[2] and point[1] in rows and point[2] in rows and point[8] < 0.0:
                first, second = sorted((rows[point[1]], rows[point[2]]))
                x, y, _ = self._starts[second]
                raise OneBotError(
                    f"robots {first + 1} and {second + 1} of the world stand in the same place, "
                    f"x {x:g} m, y {y:g} m; move one of them"
                )


class WorldRobot:
    """One robot of a world. Its methods are those of ``Simulation``, and mean the same.

    Attributes:
        joints: names of all joints that move, in the description's order.
        driven: names of the joints that have a motor.
        body: what the world moves.
    """

    def __init__(self, world: World, row: int) -> None:
        """Take the place ``row`` in ``world``."""
        member = world._members[row]
        self._world, self._row = world, row
        self.body = RobotBody(member.description, member.driven)
        self.joints, self.driven = self.body.joints, self.body.driven

    def turn(self, velocities: Mapping[str, float] | ArrayLike) -> None:
        """Have the motors keep up these speeds from now on; see ``Simulation.step``."""
        targets = self.body.targets(velocities)
        self._world.check_open()
        self.body.turn(targets)

    def step(self, velocities: Mapping[str, float] | ArrayLike, duration: float) -> None:
        """Turn the wheels, and let time pass for the whole world."""
        self.turn(velocities)
        self._world.step(duration)

    def joint_states(self) -> JointStates:
        """Return position, speed and motor effort of all joints, in the order of ``joints``."""
        return self.body.joint_states()

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        return self.body.base_pose()

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        return self.body.base_twist()

    def reset(self) -> None:
        """Put this robot back to its start, at rest; time goes on."""
        self._world.stand(self._row)

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Set the robot down elsewhere, standing still; see ``Simulation.teleport``."""
        self._world.stand(self._row, checked_place(x, y, yaw))

    def close(self) -> None:
        """Do nothing: the world is closed as a whole."""


def _stances(members: Sequence[Member], settings: Settings) -> list[Stance]:
    """Return how each robot stands, found out once for all that are alike."""
    known: dict[tuple[str, tuple[str, ...]], Stance] = {}
    stances = []
    for member in members:
        key = (member.description.urdf, tuple(member.driven))
        if key not in known:
            alone = Simulation(member.description, driven=member.driven, settings=settings)
            with alone:
                known[key] = alone.stance
        stances.append(known[key])
    return stances
