"""Worlds: robots on the same level ground, moved together by the speeds of their driven joints."""

import weakref
from collections.abc import Mapping, Sequence
from functools import cached_property

from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import load_robot, make_world
from onebot_control.simulation.rest_pose import RestPose, place, settle
from onebot_control.simulation.robot import JointStates, Pose, RobotBody, Twist
from onebot_control.simulation.settings import RobotSpawn, Settings, SpawnPose, checked_spawn_pose
from onebot_description.description import Description
from onebot_description.errors import OneBotError


class WorldRobot:
    """One robot of a world.

    Attributes:
        joints: names of all joints that move, in the description's order.
        driven: names of the joints that have a motor, in the order given.
        body: what the world moves.
    """

    def __init__(self, world: "World", row: int) -> None:
        """Refer to the robot of ``row`` in ``world``."""
        self._world, self._row = world, row
        self.body: RobotBody = world.bodies[row]
        self.joints, self.driven = self.body.joints, self.body.driven

    @property
    def rest_pose(self) -> RestPose:
        """How the robot stands on level ground."""
        return self._world.rest_poses[self._row]

    def turn(self, velocities: Mapping[str, float] | ArrayLike) -> None:
        """Have the motors keep up these speeds from now on; see ``step``."""
        targets = self.body.targets(velocities)
        self._world.check_open()
        self.body.turn(targets)

    def step(self, velocities: Mapping[str, float] | ArrayLike, duration: float) -> None:
        """Let ``duration`` pass, for the whole world, while the motors keep up the given speeds.

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
        targets = self.body.targets(velocities)
        count = self._world.settings.steps(duration)
        self._world.check_usable()
        self.body.turn(targets)
        self._world.advance(count)

    def joint_states(self) -> JointStates:
        """Return position, speed and motor effort of all joints, in the order of ``joints``."""
        return self._readable().joint_states()

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        return self._readable().base_pose()

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        return self._readable().base_twist()

    def reset(self) -> None:
        """Put this robot back to its start, at rest; time goes on."""
        self._world.stand(self._row)

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Set the robot down elsewhere, standing still.

        Joint positions and time go on from where they were, so that odometry does not notice.

        Args:
            x: of the root link's frame, m.
            y: likewise, m.
            yaw: its heading, rad.

        Raises:
            ValueError: a value is not finite.
            OneBotError: it is too far away to be exact there.
        """
        self._world.stand(self._row, checked_spawn_pose(x, y, yaw))

    def brake(self) -> None:
        """Stop at once: all speeds are exactly 0, and no position changes."""
        self._readable().brake()
        self.body.check()

    def close(self) -> None:
        """Do nothing: the world is closed as a whole."""

    def _readable(self) -> RobotBody:
        """The robot's body, whose world is open and whose state is finite."""
        self._world.check_open()
        self.body.check()
        return self.body


class World:
    """Robots that stand on the same ground and may run into each other.

    Time passes in ``step``, for all of them. The same calls give the same bits, in any process.

    Attributes:
        settings: as given.
        client: PyBullet's number of the world, for what it can do besides.
        bodies: what the world moves, in the order given.
        rest_poses: how each robot stands on level ground.
    """

    def __init__(
        self,
        spawns: Sequence[RobotSpawn],
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
    ) -> None:
        """Set the robots on the ground with their joints at 0, standing still.

        Args:
            spawns: the robots.
            settings: how finely to compute.

        Raises:
            ValueError: a place is not finite.
            OneBotError: a robot cannot be simulated, or two stand in the same place.
        """
        self.settings = settings
        self._spawns = tuple(spawns)
        self._starts = [checked_spawn_pose(item.x, item.y, item.yaw) for item in self._spawns]
        self.bodies = tuple(RobotBody(item.description, item.driven) for item in self._spawns)
        self._alone = len(self._spawns) == 1
        self.rest_poses = [] if self._alone else _rest_poses(self._spawns, settings)
        self._build()

    @cached_property
    def robots(self) -> tuple[WorldRobot, ...]:
        """The robots, in the order given."""
        return tuple(WorldRobot(self, row) for row in range(len(self.bodies)))

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
        self.advance(count)

    def advance(self, count: int) -> None:
        """Do ``count`` physics steps in a world that is usable.

        Raises:
            OneBotError: the state has become non-finite.
        """
        client, bodies = self.client, self.bodies
        for body in bodies:
            body.begin()
        for _ in range(count - 1):
            engine.stepSimulation(client)
            for body in bodies:
                body.record_efforts()
        engine.stepSimulation(client)
        self._steps += count
        for body in bodies:
            body.read(count)
        self.check_usable()

    def reset(self) -> None:
        """Return to the very state of the start, bit for bit; time is 0 again."""
        self.check_open()
        if all(body.finite for body in self.bodies):
            self._restart()
        else:
            # PyBullet does not recover from a NaN, not even by restoring an earlier state.
            self._disconnect()
            self._build()

    def stand(self, row: int, where: SpawnPose | None = None) -> None:
        """Set the robot of ``row`` down: at x, y, yaw, or without these at its start, joints at 0.

        Raises:
            OneBotError: the world has been closed, or broke down.
        """
        self.check_usable()
        if self._alone:
            # Where it disturbs no one else, the contacts are those of a robot at rest.
            engine.restoreState(self._saved, physicsClientId=self.client)
        there = self._starts[row] if where is None else where
        self.bodies[row].stand(self.rest_poses[row], there, start=where is None)
        self.bodies[row].check()

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError from now on."""
        self._disconnect()

    def check_open(self) -> None:
        """Raise OneBotError if the world has been closed."""
        if not self._disconnect.alive:
            raise OneBotError("this simulation has been closed; make a new one")

    def check_usable(self) -> None:
        """Raise OneBotError if the world has been closed, or its state is not finite."""
        self.check_open()
        for body in self.bodies:
            body.check()

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self) -> None:
        """Make the world, set the robots down in it, and keep that state."""
        client: int = engine.connect(engine.DIRECT)
        self.client = client
        self._disconnect = weakref.finalize(self, engine.disconnect, client)
        try:
            self._populate(make_world(client, self.settings))
        except BaseException:
            self._disconnect()
            raise
        self._saved: int = engine.saveState(physicsClientId=client)
        self._restart()

    def _populate(self, ground: int) -> None:
        """Load the robots; one that is alone comes to rest right here."""
        client, settings = self.client, self.settings
        for row, (spawn, body) in enumerate(zip(self._spawns, self.bodies, strict=True)):
            parts = load_robot(client, ground, spawn.description, settings)
            body.enter(client, parts)
            if self._alone:
                self.rest_poses = [settle(client, parts, spawn.description, body.driven, settings)]
            else:
                # Away from the origin, where the next one appears.
                place(client, parts, self.rest_poses[row].at(*self._starts[row]))
        self._refuse_overlaps()

    def _restart(self) -> None:
        engine.restoreState(self._saved, physicsClientId=self.client)
        self._steps = 0
        for body, rest_pose, start in zip(self.bodies, self.rest_poses, self._starts, strict=True):
            body.stand(rest_pose, start, start=True)
        self.check_usable()

    def _refuse_overlaps(self) -> None:
        if self._alone:
            return
        engine.performCollisionDetection(physicsClientId=self.client)
        rows = {body.parts.body: row for row, body in enumerate(self.bodies)}
        for point in engine.getContactPoints(physicsClientId=self.client):
            if point[1] != point[2] and point[1] in rows and point[2] in rows and point[8] < 0.0:
                first, second = sorted((rows[point[1]], rows[point[2]]))
                x, y, _ = self._starts[second]
                raise OneBotError(
                    f"robots {first + 1} and {second + 1} of the world stand in the same place, "
                    f"x {x:g} m, y {y:g} m; move one of them"
                )


def _rest_poses(spawns: Sequence[RobotSpawn], settings: Settings) -> list[RestPose]:
    """Return how each robot stands, found out once for all that are alike."""
    known: dict[tuple[str, tuple[str, ...]], RestPose] = {}
    rest_poses = []
    for spawn in spawns:
        key = (spawn.description.urdf, tuple(spawn.driven))
        if key not in known:
            with World([RobotSpawn(spawn.description, spawn.driven)], settings) as alone:
                known[key] = alone.rest_poses[0]
        rest_poses.append(known[key])
    return rest_poses


class Simulation(WorldRobot):
    """A robot that stands on the ground of an otherwise empty world.

    Time passes only in ``step``. The same calls give the same bits, in any process. Objects are
    independent of each other; one object is for one thread at a time. For several robots in one
    world see ``World``.

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
                what to correct.
        """
        # Not taken from the world's ``robots``, which hold it: forgotten, this frees the world.
        super().__init__(World([RobotSpawn(description, driven, x, y, yaw)], settings), 0)
        self.settings = settings

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._world.time

    @property
    def client(self) -> int:
        """PyBullet's number of the world, for what it can do besides."""
        return self._world.client

    def reset(self) -> None:
        """Return to the very state of the start, bit for bit; time is 0 again."""
        self._world.reset()

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError from now on."""
        self._world.close()

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
