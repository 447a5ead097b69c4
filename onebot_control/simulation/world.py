"""Worlds: robots on the same ground, and among the same walls, moved by their driven joints."""

import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from functools import cached_property

from numpy.typing import ArrayLike

from onebot_control.poses import Transform
from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import load_robot, make_world
from onebot_control.simulation.rest_pose import RestPose, link_pose, place, settle
from onebot_control.simulation.robot import JointStates, Pose, RobotBody, Twist
from onebot_control.simulation.scene import SceneBodies
from onebot_control.simulation.settings import RobotSpawn, Settings, SpawnPose, checked_spawn_pose
from onebot_control.simulation.spawn import pose_on
from onebot_description.description import Description
from onebot_description.errors import OneBotError, listing


class WorldRobot:
    """One robot of a world."""

    joints: tuple[str, ...]  # names of the moving joints, in the description's order
    driven: tuple[str, ...]  # names of the joints with a motor, in the given order
    body: RobotBody

    def __init__(self, world: "World", row: int) -> None:
        self._world, self._row = world, row
        self.body = world.bodies[row]
        self.joints, self.driven = self.body.joints, self.body.driven

    @property
    def rest_pose(self) -> RestPose:
        """Height and tilt of the robot at rest on level ground."""
        return self._world.rest_poses[self._row]

    @property
    def scene(self) -> SceneBodies | None:
        """What stands around the robots."""
        return self._world.scene

    @property
    def obstructed(self) -> bool:
        """Whether something other than the ground touches the robot."""
        return self._world.obstructed(self._row)

    def turn(self, velocities: Mapping[str, float] | ArrayLike) -> None:
        """Set the target velocities of the motors; see ``step``."""
        targets = self.body.targets(velocities)
        self._world.check_open()
        self.body.turn(targets)

    def step(self, velocities: Mapping[str, float] | ArrayLike, duration: float) -> None:
        """Advance the whole world by ``duration`` with the given target velocities.

        A motor reaches its target as far as its effort allows, within its velocity limit.

        Args:
            velocities: of every driven joint, rad/s (m/s for prismatic ones), by name or in the
                order of ``driven``.
            duration: s; a whole number of physics steps.

        Raises:
            ValueError: a velocity is not finite, too few or too many are given, or ``duration`` is
                not a whole number of steps; the state does not change then.
            OneBotError: the state is no longer finite; ``reset`` recovers.
        """
        targets = self.body.targets(velocities)
        count = self._world.settings.steps(duration)
        self._world.check_usable()
        self.body.turn(targets)
        self._world.advance(count)

    def joint_states(self) -> JointStates:
        """Return positions, velocities and motor efforts, in the order of ``joints``."""
        return self._readable().joint_states()

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        return self._readable().base_pose()

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        return self._readable().base_twist()

    def reset(self) -> None:
        """Move this robot back to its start, at rest, and the scene's boxes; time continues.

        A box stays where it is if another robot is in its place.

        Raises:
            OneBotError: another robot is at its start, or it cannot stand there; nothing has
                changed then.
        """
        self._world.stand(self._row)

    def teleport(self, x: float, y: float, yaw: float) -> None:
        """Move the robot to another pose, at rest.

        Joint positions and time continue, so that odometry is not affected.

        Args:
            x: of the root link's frame, m.
            y: likewise, m.
            yaw: its heading, rad.

        Raises:
            ValueError: a value is not finite.
            OneBotError: it is too far from the origin to be exact, another robot is there, or the
                robot cannot stand there for the scene; nothing has changed then.
        """
        self._world.stand(self._row, checked_spawn_pose(x, y, yaw))

    def brake(self) -> None:
        """Stop at once: all velocities are exactly 0, positions do not change."""
        self._readable().brake()
        self.body.check()

    def close(self) -> None:
        """Do nothing: the world is closed as a whole."""

    def _readable(self) -> RobotBody:
        """The robot's body, after a check that its world is open and its state finite."""
        self._world.check_open()
        self.body.check()
        return self.body


class World:
    """Robots on the same ground, which can collide.

    Time advances in ``step``, for all robots. The same calls give identical results in any process.
    """

    settings: Settings
    client: int  # PyBullet's index of the world, for direct calls
    bodies: tuple[RobotBody, ...]  # in the given order
    rest_poses: list[RestPose]  # of each robot
    scene: SceneBodies | None  # what stands around the robots

    def __init__(
        self,
        spawns: Sequence[RobotSpawn],
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
        scene: Description | None = None,
        *,
        free_starts: bool = True,
    ) -> None:
        """Place the robots at rest, with their joints at 0, on the ground or on the scene's ramps.

        Args:
            spawns: the robots.
            settings: of the simulation.
            scene: walls, ramps and boxes; see ``onebot_control.simulation.scene``.
            free_starts: each robot must have room at its start; else only when it is reset.

        Raises:
            ValueError: a pose is not finite.
            OneBotError: a robot or the scene cannot be simulated, two robots overlap, or one cannot
                stand where it is to start.
        """
        self.settings = settings
        self.scene = None if scene is None else SceneBodies(scene)
        self._spawns = tuple(spawns)
        self._starts = [checked_spawn_pose(item.x, item.y, item.yaw) for item in self._spawns]
        self.bodies = tuple(RobotBody(item.description, item.driven) for item in self._spawns)
        self._free_starts = free_starts
        self._alone = len(self._spawns) == 1 and scene is None
        self.rest_poses = [] if self._alone else _rest_poses(self._spawns, settings)
        self._build()

    @cached_property
    def robots(self) -> tuple[WorldRobot, ...]:
        """The robots, in the given order."""
        return tuple(WorldRobot(self, row) for row in range(len(self.bodies)))

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._steps / self.settings.rate

    def step(self, duration: float) -> None:
        """Advance by ``duration`` seconds, a whole number of physics steps.

        Raises:
            ValueError: it is not a whole number of steps.
            OneBotError: the state is no longer finite; ``reset`` recovers.
        """
        count = self.settings.steps(duration)
        self.check_usable()
        self.advance(count)

    def advance(self, count: int) -> None:
        """Advance by ``count`` physics steps; the world must be usable.

        Raises:
            OneBotError: the state is no longer finite.
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
        if self.scene is not None:
            self.scene.read()
        self.check_usable()

    def obstructed(self, row: int) -> bool:
        """Return whether something other than the ground touches the robot of ``row``."""
        if len(self.bodies) == 1 and self.scene is None:
            return False
        parts = self.bodies[row].parts
        points = engine.getContactPoints(parts.body, physicsClientId=self.client)
        return any(not {point[1], point[2]} <= {parts.body, parts.ground} for point in points)

    def reset(self) -> None:
        """Restore the initial state, bit for bit; time is 0 again."""
        self.check_open()
        if all(body.finite for body in self.bodies) and (self.scene is None or self.scene.finite):
            self._restart()
        else:
            # PyBullet does not recover from a NaN, not even by restoring an earlier state.
            self._disconnect()
            self._build()

    def stand(self, row: int, where: SpawnPose | None = None) -> None:
        """Place the robot of ``row`` at rest at a pose; by default at its start, joints at 0.

        Raises:
            OneBotError: the world is closed, or has diverged, the robot cannot stand there, or
                another one is there; nothing has changed then.
        """
        self.check_usable()
        pose = self._start_poses[row] if where is None else None
        if pose is None:
            pose = self._pose_at(row, where or self._starts[row])
        with self._unchanged_if_refused(row):
            if self._alone or (where is None and len(self.bodies) == 1):
                # Without other robots the contacts of all that is at rest can be restored.
                engine.restoreState(self._saved, physicsClientId=self.client)
            self.bodies[row].stand(pose, start=where is None)
            self.bodies[row].check()
            self.check_overlaps(row)
            if self.scene is not None and where is None:
                self.scene.put_back([body.parts for body in self.bodies])
                self._check_boxes(row, self._starts[row])

    @contextmanager
    def _unchanged_if_refused(self, row: int) -> Iterator[None]:
        """Put the robot of ``row``, and the boxes, back to where they are if OneBotError is raised.

        A robot alone is refused by nothing within the block.
        """
        if len(self.bodies) == 1:
            yield
            return
        body = self.bodies[row]
        before, saved = copy(body), engine.saveState(physicsClientId=self.client)
        try:
            yield
        except OneBotError:
            body.assume(before)
            # To the bit, and with the contacts; targets of motors are not in it.
            engine.restoreState(saved, physicsClientId=self.client)
            if self.scene is not None:
                self.scene.read()
            raise
        finally:
            engine.removeState(saved, physicsClientId=self.client)

    def replaced(self, row: int, spawn: RobotSpawn) -> "World":
        """Return a world with ``spawn``, at rest, in place of the robot of ``row``.

        The others move on as they do in this one, which stays as it is; starts do, too, whether
        there is room for the robot or not. The scene's boxes are where they are now, at rest.

        Raises:
            OneBotError: the robot cannot be simulated, or another one, or the scene, is in the way.
        """
        start = self._spawns[row]._replace(description=spawn.description, driven=spawn.driven)
        spawns = [*self._spawns[:row], start, *self._spawns[row + 1 :]]
        scene = self.scene
        around = scene.description if scene else None
        world = World(spawns, self.settings, around, free_starts=False)
        try:
            if scene is not None and world.scene is not None:
                world.scene.put(scene.poses)
            for other, (body, old) in enumerate(zip(world.bodies, self.bodies, strict=True)):
                if other != row:
                    body.assume(old)
            world.stand(row, (spawn.x, spawn.y, spawn.yaw))
        except BaseException:
            world.close()
            raise
        return world

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError afterwards."""
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
        if self.scene is not None:
            self.scene.check()

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self) -> None:
        """Create the world, place the robots in it, and save that state."""
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
        """Load the robots; a single one settles in this world."""
        client, settings = self.client, self.settings
        for row, (spawn, body) in enumerate(zip(self._spawns, self.bodies, strict=True)):
            parts = load_robot(client, ground, spawn.description, settings)
            body.enter(client, parts)
            if self._alone:
                self.rest_poses = [settle(client, parts, spawn.description, body.driven, settings)]
            else:
                # Away from the origin, where the next one is loaded.
                place(client, parts, self.rest_poses[row].at(*self._starts[row]))
        if self.scene is not None:
            self.scene.enter(client, ground, settings)
        self._start_poses = list(map(self._start_pose, range(len(self.bodies))))
        if not self._alone:
            for body, pose in zip(self.bodies, self._start_poses, strict=True):
                if pose is not None:
                    place(client, body.parts, pose)
        if self._free_starts:
            self.check_overlaps()

    def _start_pose(self, row: int) -> Transform | None:
        """Return the pose of the robot of ``row`` at its start; None if it cannot stand there.

        Raises:
            OneBotError: it cannot, and must.
        """
        try:
            return self._pose_at(row, self._starts[row])
        except OneBotError:
            if self._free_starts:
                raise
            return None

    def _pose_at(self, row: int, where: SpawnPose) -> Transform:
        """Return the pose of the robot of ``row`` at rest there.

        Raises:
            OneBotError: it cannot stand there for the scene.
        """
        rest, scene = self.rest_poses[row], self.scene
        pose = rest.at(*where)
        if scene is None:
            return pose
        parts = self.bodies[row].parts
        before: int = engine.saveState(physicsClientId=self.client)
        try:
            place(self.client, parts, pose)
            if scene.fixed_at(parts):
                settings, spawn = self.settings, self._spawns[row]
                pose = pose_on(scene.description, spawn, settings, rest, where)
                place(self.client, parts, pose)
            self._check_boxes(row, where)
        finally:
            engine.restoreState(before, physicsClientId=self.client)
            engine.removeState(before, physicsClientId=self.client)
        return pose

    def _check_boxes(self, row: int, where: SpawnPose) -> None:
        """Raise OneBotError if the robot of ``row``, which was put there, is in a box."""
        if self.scene is not None and (links := self.scene.free_at(self.bodies[row].parts)):
            raise OneBotError(
                f"x {where[0]:g} m, y {where[1]:g} m: link {listing(links)} of "
                f"{self.scene.description.source} is there; put the robot somewhere else"
            )

    def _restart(self) -> None:
        engine.restoreState(self._saved, physicsClientId=self.client)
        self._steps = 0
        if self.scene is not None:
            self.scene.read()
        for row, (body, pose) in enumerate(zip(self.bodies, self._start_poses, strict=True)):
            body.stand(pose or self.rest_poses[row].at(*self._starts[row]), start=True)
        self.check_usable()

    def check_overlaps(self, robot: int | None = None) -> None:
        """Raise OneBotError if two robots, or the one of row ``robot`` and another, overlap."""
        if len(self.bodies) == 1:
            return
        engine.performCollisionDetection(physicsClientId=self.client)
        rows = {body.parts.body: row for row, body in enumerate(self.bodies)}
        for point in engine.getContactPoints(physicsClientId=self.client):
            if point[1] != point[2] and point[1] in rows and point[2] in rows and point[8] < 0.0:
                first, second = sorted((rows[point[1]], rows[point[2]]))
                if robot in (None, first, second):
                    raise OneBotError(self._overlap(first, second))

    def _overlap(self, first: int, second: int) -> str:
        (x, y, _), _ = link_pose(self.client, self.bodies[second].parts)
        return (
            f"robots {self._name(first)} and {self._name(second)} of the world would stand in the "
            f"same place, x {round(x, 6) + 0.0:g} m, y {round(y, 6) + 0.0:g} m; move one of them"
        )

    def _name(self, row: int) -> str:
        return self._spawns[row].name or str(row + 1)


def _rest_poses(spawns: Sequence[RobotSpawn], settings: Settings) -> list[RestPose]:
    """Return the rest pose of each robot, simulated once for identical robots."""
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
    """A robot in a world that has no other one.

    Time advances only in ``step``. The same calls give identical results, in any process. Objects
    are independent of each other; an object must not be used by two threads at the same time. For
    several robots in one world see ``World``.
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
        scene: Description | None = None,
    ) -> None:
        """Place the robot at rest on the ground, or on the scene's ramp, with its joints at 0.

        Args:
            description: a checked robot; see ``load_description``.
            driven: joints with a motor, limited by their ``<limit effort>`` and ``<limit
                velocity>``. All others turn freely, except for the friction and damping of their
                ``<dynamics>``.
            x: initial position of the root link's frame, m.
            y: likewise, m.
            yaw: its heading, rad.
            settings: of the simulation.
            scene: as ``World`` has it.

        Raises:
            ValueError: x, y or yaw is not finite.
            OneBotError: the robot or the scene cannot be simulated, a driven joint is invalid, or
                the robot cannot stand there.
        """
        # Not one of the world's ``robots``: a reference cycle would keep the world alive.
        super().__init__(World([RobotSpawn(description, driven, x, y, yaw)], settings, scene), 0)
        self.settings = settings

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._world.time

    @property
    def client(self) -> int:
        """PyBullet's index of the world, for direct calls."""
        return self._world.client

    def reset(self) -> None:
        """Restore the initial state, bit for bit; time is 0 again."""
        self._world.reset()

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError afterwards."""
        self._world.close()

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
