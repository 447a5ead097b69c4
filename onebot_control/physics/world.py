"""Worlds in which robots move on the same ground and in the same scene (see ``scene``)."""

import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from onebot_control.physics.contacts import ContactRecorder
from onebot_control.physics.engine import Bullet, PhysicsSettings
from onebot_control.physics.rest_pose import RestPose, pose_on, settle
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.roller_wheels import has_rollers
from onebot_control.physics.scene import SceneBodies
from onebot_control.physics.spawning import LoadedBody, RobotSpawn
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import PlanarPose, Transform, Triple
from onebot_description.model.rigid_bodies import merged_bodies, rigid_frames

# With arms or rollers, the solver stops once an iteration changes no velocity by more than the
# square root of this, rad/s or m/s: a step with seven joints takes half the time, a step with a
# linkage a fifth, and joints are off by 1e-8 rad. At rest, OneBot drifts by 60 nm/s with an arm,
# and by 0.4 nm/s otherwise.
_RESIDUAL = 1e-12


@dataclass
class _Push:
    parts: LoadedBody
    index: int  # index, point and force as in ``LoadedBody.apply_force``
    point: Triple
    force: Triple
    steps: int  # remaining physics steps

    def apply(self) -> None:
        """Apply the force in the next physics step."""
        self.parts.apply_force(self.index, self.point, self.force)
        self.steps -= 1


class World(AbstractContextManager["World"]):
    """Simulates robots on the same ground; they can collide.

    Time advances only in ``step``, for all robots. The same calls give identical results in any
    process. Worlds are independent of each other; a world must not be used by two threads at the
    same time.

    Attributes:
        settings: settings of the physics.
        bullet: the world of PyBullet, for direct calls.
        robots: the robots in the given order.
        scene: bodies around the robots; None on bare ground.
    """

    def __init__(
        self,
        spawns: Sequence[RobotSpawn],
        settings: PhysicsSettings = PhysicsSettings(),  # noqa: B008 - it is frozen
        scene: Description | None = None,
        *,
        at_start: bool = True,
    ) -> None:
        """Build the world, with the robots at rest on the ground or on the scene's ramps.

        Args:
            spawns: the robots.
            settings: settings of the physics.
            scene: walls, ramps and boxes; see ``onebot_control.physics.scene``.
            at_start: place each robot at its start; otherwise the caller must place them.

        Raises:
            OneBotError: a start pose is not finite, a robot or the scene cannot be simulated, two
                robots overlap, or a robot cannot stand at its start.
        """
        self.settings = settings
        self.scene = None if scene is None else SceneBodies(scene)
        # Without a reference cycle, a world that is dropped, or rejected, is freed immediately.
        self.robots = tuple(RobotBody(weakref.proxy(self), spawn) for spawn in spawns)
        self._commanded = [robot for robot in self.robots if robot.commanded]
        # A single robot on bare ground comes to rest in this world, others in separate worlds.
        self._alone = len(self.robots) == 1 and scene is None
        self._on_scene: dict[tuple[RobotBody, PlanarPose, tuple[float, ...]], Transform] = {}
        if not self._alone:
            self._find_rest_poses()
        self.bullet = Bullet(settings)
        self._problem = ""  # reason why it can no longer be used
        self._contacts: ContactRecorder | None = None
        # The ground is only an obstacle for arms.
        self._has_obstacles = bool(self.scene or self._commanded) or len(self.robots) > 1
        self._pushes: list[_Push] = []
        self._build()
        if at_start:
            self._start()

    @property
    def contacts(self) -> ContactRecorder:
        """The recorder of the robots' contacts."""
        self.check()
        if self._contacts is None:
            self._contacts = ContactRecorder(self.robots, self.scene)
            self._contacts.load(self.bullet)
        return self._contacts

    def step(self, duration: float, *, recorded: bool | None = False) -> None:
        """Advance by ``duration`` seconds, rounded to whole physics steps.

        Args:
            duration: s.
            recorded: whether to record ``contacts``; None: if there may be a collision. Once they
                have been requested, they are always recorded.

        Raises:
            OneBotError: the world is closed, or its state is no longer finite.
        """
        count = self.settings.steps(duration)
        self.check()
        if self._contacts is not None and self._contacts.wanted:
            recorded = True
        elif recorded is None:
            recorded = self._has_obstacles and self.contacts.may_collide(duration)
        contacts = self.contacts if recorded else self._contacts
        if contacts is not None:
            contacts.begin(recorded=recorded)
        for number in range(count):
            for robot in self._commanded:
                robot.track(number)
            for parts in self._weightless:
                parts.lift_weightless()
            for parts in self._rolling:
                parts.center_rollers()
            for push in self._pushes:
                push.apply()
            self.bullet.stepSimulation()
            if recorded and contacts is not None:
                contacts.record()
            if self._pushes:
                self._pushes = [push for push in self._pushes if push.steps > 0]
            if number < count - 1:
                for robot in self.robots:
                    robot.record_efforts()
        for robot in self.robots:
            robot.read(count)
        if self.scene is not None:
            self.scene.read()
        self._check_finite()

    def restart(self, starts: Sequence[PlanarPose] = ()) -> None:
        """Go back to the start by rebuilding the world, so that runs are bit-identical.

        Restoring a saved state is not enough: PyBullet's solver keeps its order of contacts.

        Args:
            starts: new start poses of all robots; empty for the current ones.

        Raises:
            OneBotError: the robots cannot stand there together; nothing has changed.
        """
        present = [robot.spawn.start for robot in self.robots]
        try:
            with self._undone_if_refused():
                for robot, start in zip(self.robots, starts or present, strict=True):
                    robot.start_at(start)
                self._place_at_starts()
        except OneBotError:
            for robot, start in zip(self.robots, present, strict=True):
                robot.start_at(start)
            raise
        self.bullet.resetSimulation()
        self._build()
        self._start()

    def reset(self) -> None:
        """Move all robots and the scene's boxes back to their start; time continues.

        Raises:
            OneBotError: see ``stand``.
        """
        self.stand({robot: robot.spawn.start for robot in self.robots}, at_start=True)

    def stand(self, places: Mapping[RobotBody, PlanarPose], *, at_start: bool) -> None:
        """Place robots at rest.

        Args:
            places: root link poses of some or all robots of this world.
            at_start: also move their joints and the scene's boxes back to their start.

        Raises:
            OneBotError: the world is closed or has diverged, a robot cannot stand there, or
                another one is there; nothing has changed.
        """
        self.check()
        stances: dict[RobotBody, tuple[Transform, Sequence[float]]] = {}
        with self._undone_if_refused():
            if len(self.robots) == len(places) and (at_start or self.scene is None):
                # Without other robots, the saved state, with all contacts at rest, can be restored.
                self.bullet.restoreState(self._saved)
            for robot, where in places.items():
                positions = robot.starts if at_start else robot.positions
                stances[robot] = self._pose_at(robot, where, positions), positions
                robot.parts.place(*stances[robot])
            if self.scene is not None and at_start:
                self.scene.put_back([standing_robot.parts for standing_robot in self.robots])
            for robot, where in places.items():
                self._check_boxes(robot, where)
            self._check_overlaps(places)
        for robot, stance in stances.items():
            robot.put(*stance)
            self._pushes = [push for push in self._pushes if push.parts is not robot.parts]
            if self._contacts is not None:
                self._contacts.forget(robot)
        if self.scene is not None:
            self.scene.read()

    def set_joints(self, robot: RobotBody, positions: Mapping[str, float]) -> None:
        """Set positions of joints of a robot, rad or m, at rest; all others continue.

        Raises:
            OneBotError: the robot would overlap something there; nothing has changed.
        """
        self.check()
        with self._undone_if_refused():
            for name, position in positions.items():
                index = robot.parts.joints[name]
                self.bullet.resetJointState(robot.parts.body, index, position, 0.0)
            if self.scene is not None:
                links = {
                    *self.scene.fixed_at(robot.parts).values(),
                    *self.scene.free_at(robot.parts),
                }
                if links:
                    text = f"link {listing(sorted(links))} of {self.scene.description.source}"
                    raise OneBotError(f"the robot would overlap {text} there; nothing has moved")
            self._check_overlaps([robot])
        robot.read_again()

    def push(
        self, robot: RobotBody, link: str, point: Floats | None, force: Floats, duration: float
    ) -> None:
        """Push a link of a robot in the next steps.

        Args:
            robot: the robot.
            link: its link.
            point: (3,), in the link's frame, m; None: the center of mass of the rigid body.
            force: (3,), in the world's axes, N.
            duration: s, rounded to whole physics steps.

        Raises:
            OneBotError: there is no such link, or it is fixed.
        """
        self.check()
        description = robot.spawn.description
        if link not in description.link_names:
            names = description.link_names
            raise OneBotError(f'{description.source}: no link "{link}"{did_you_mean(link, names)}')
        first, pose = rigid_frames(description)[link]
        place = merged_bodies(description)[first].center
        if point is not None:
            place = matrices.transformed(point[None], pose)[0]
        index = robot.parts.links[first]
        if robot.spawn.fixed_base and index < 0:
            raise OneBotError(f'{description.source}: link "{link}" is fixed')
        steps = self.settings.steps(duration)
        self.contacts.always = True
        (x, y, z), (along_x, along_y, along_z) = place.tolist(), force.tolist()
        push = _Push(robot.parts, index, (x, y, z), (along_x, along_y, along_z), steps)
        self._pushes.append(push)

    @contextmanager
    def _undone_if_refused(self) -> Iterator[None]:
        """Undo the ``with`` block's changes to PyBullet's world if it raises a OneBotError."""
        present: int = self.bullet.saveState()
        try:
            yield
        except OneBotError:
            self.bullet.restoreState(present)
            raise
        finally:
            self.bullet.removeState(present)

    def replaced(self, row: int, spawn: RobotSpawn, settings: PhysicsSettings) -> "World":
        """Return a new world in which ``spawn``, at rest, replaces one robot.

        The other robots continue from their current state, the new one from the joint positions of
        the old one; this world does not change. The start poses are kept, even if there is no room.
        The scene's boxes are at their current poses, at rest.

        Args:
            row: index of the robot to replace.
            spawn: the new robot with its current pose.
            settings: settings of the new world's physics.

        Raises:
            OneBotError: the robot cannot be simulated, or another one, or the scene, is in the way.
        """
        spawns = [robot.spawn for robot in self.robots]
        spawns[row] = spawn._replace(start=spawns[row].start, name=spawns[row].name)
        around = self.scene.description if self.scene else None
        world = World(spawns, settings, around, at_start=False)
        if self.scene is not None and world.scene is not None:
            world.scene.put(self.scene.poses)
        for index, (new, old) in enumerate(zip(world.robots, self.robots, strict=True)):
            if index == row:
                new.continue_joints(old)
            else:
                new.continue_from(old)
        world.robots[row].teleport(*spawn.start)
        return world

    def close(self) -> None:
        """Free the world; most other methods raise OneBotError afterwards."""
        self._problem = "this simulation has been closed; create a new one"
        self.bullet.close()

    def check(self) -> None:
        """Raise OneBotError if the world has been closed, or its state is not finite."""
        if self._problem:
            raise OneBotError(self._problem)

    def _check_finite(self) -> None:
        """Raise OneBotError, from now on, if the last read state is not finite."""
        diverged = [robot.spawn.description for robot in self.robots if not robot.finite]
        if self.scene is not None and not self.scene.finite:
            diverged.append(self.scene.description)
        if diverged:
            self._problem = (
                f"{diverged[0].source}: the simulation diverged: its state is no longer finite; "
                "start it again"
            )
        self.check()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _find_rest_poses(self) -> None:
        """Find each robot's rest pose by simulating it alone, once for identical robots."""
        rest_poses: dict[tuple[object, ...], RestPose] = {}
        for robot in self.robots:
            spawn = robot.spawn._replace(start=PlanarPose(), name="")
            description = spawn.description  # its joints include the positions of held ones
            key = description.urdf, description.joints, robot.driven, robot.commanded, robot.starts
            if key not in rest_poses:
                with World([spawn], self.settings) as alone:
                    rest_poses[key] = alone.robots[0].rest_pose
            robot.rest_pose = rest_poses[key]

    def _build(self) -> None:
        """Load all bodies, and save the state for ``stand``."""
        bullet = self.bullet
        stops = self._commanded or any(
            has_rollers(robot.spawn.description) for robot in self.robots
        )
        bullet.set_up(_RESIDUAL if stops else 0.0)
        for robot in self.robots:
            robot.load()
            if self._alone:
                robot.rest_pose = settle(robot.parts, robot.spawn, robot.starts)
            else:
                # Make room at the origin, where the next robot is loaded.
                robot.parts.place(robot.rest_pose.at(*robot.spawn.start))
        if self.scene is not None:
            self.scene.enter(bullet)
        bodies = (
            *(robot.parts for robot in self.robots),
            *(self.scene.parts if self.scene else ()),
        )
        self._weightless = [body for body in bodies if body.weightless]
        self._rolling = [robot.parts for robot in self.robots if robot.parts.rollers]
        self._saved: int = bullet.saveState()
        self._pushes = []
        if self._contacts is not None:
            self._contacts.load(bullet)

    def _start(self) -> None:
        """Place all robots at their starts, from the saved state, like ``RobotBody.reset``."""
        self._problem = ""
        for robot, pose in zip(self.robots, self._place_at_starts(), strict=True):
            robot.put(pose)
        self._check_finite()

    def _place_at_starts(self) -> list[Transform]:
        """Place the bodies of all robots at their starts, and return their poses.

        Raises:
            OneBotError: the robots cannot stand there together.
        """
        self.bullet.restoreState(self._saved)
        poses = []
        for robot in self.robots:
            poses.append(self._pose_at(robot, robot.spawn.start, robot.starts))
            robot.parts.place(poses[-1], robot.starts)
            self._check_boxes(robot, robot.spawn.start)
        self._check_overlaps(self.robots)
        return poses

    def _pose_at(
        self, robot: RobotBody, where: PlanarPose, positions: Sequence[float]
    ) -> Transform:
        """Place the robot at rest on the fixed bodies there; return its pose.

        Raises:
            OneBotError: the scene leaves no place to stand there.
        """
        pose = robot.rest_pose.at(*where)
        if self.scene is None:
            return pose
        robot.parts.place(pose, positions)
        if self.scene.fixed_at(robot.parts):
            key = robot, where, tuple(positions)
            if key not in self._on_scene:  # a reset returns to the same place
                self._on_scene[key] = pose_on(
                    self.scene.description,
                    robot.spawn,
                    self.settings,
                    robot.rest_pose,
                    where,
                    positions,
                )
            pose = self._on_scene[key]
            robot.parts.place(pose)
        return pose

    def _check_boxes(self, robot: RobotBody, where: PlanarPose) -> None:
        """Raise OneBotError if a robot that has just been placed overlaps a box."""
        if self.scene is not None and (links := self.scene.free_at(robot.parts)):
            raise OneBotError(
                f"x {where.x:g} m, y {where.y:g} m: link {listing(links)} of "
                f"{self.scene.description.source} is there; put the robot somewhere else"
            )

    def _check_overlaps(self, placed: Collection[RobotBody]) -> None:
        """Raise OneBotError if a robot that has just been placed overlaps another one."""
        if len(self.robots) == 1:
            return
        self.bullet.performCollisionDetection()
        rows = {standing_robot.parts.body: row for row, standing_robot in enumerate(self.robots)}
        for point in self.bullet.getContactPoints():
            if point[1] == point[2] or point[8] >= 0.0 or not {point[1], point[2]} <= rows.keys():
                continue
            first, second = sorted((rows[point[1]], rows[point[2]]))
            if self.robots[first] in placed or self.robots[second] in placed:
                names = [self.robots[row].spawn.name or str(row + 1) for row in (first, second)]
                (x, y, _), _ = self.robots[second].parts.pose()
                raise OneBotError(
                    f"robots {' and '.join(names)} of the world would stand in the same place, "
                    f"x {round(x, 6) + 0.0:g} m, y {round(y, 6) + 0.0:g} m; move one of them"
                )
