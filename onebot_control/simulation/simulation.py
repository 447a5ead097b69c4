"""One robot on level ground, moved by the speeds of its driven joints."""

import weakref
from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from onebot_control.simulation.engine import engine
from onebot_control.simulation.loading import load_robot, make_world
from onebot_control.simulation.robot import FARTHEST, RobotBody, checked_place
from onebot_control.simulation.settings import Settings
from onebot_control.simulation.settling import Stance, settle
from onebot_control.simulation.states import JointStates, Pose, Twist
from onebot_description.description import Description
from onebot_description.errors import OneBotError

__all__ = ["FARTHEST", "Simulation"]


class Simulation:
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
                what to mend.
        """
        self.settings = settings
        self._description = description
        self._start = checked_place(x, y, yaw)
        self._body = RobotBody(description, driven)
        self.joints, self.driven = self._body.joints, self._body.driven
        self._build()

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self._steps / self.settings.rate

    @property
    def stance(self) -> Stance:
        """How the robot stands on level ground."""
        return self._stance

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
        body = self._body
        targets = body.targets(velocities)
        count = self.settings.steps(duration)
        self._check_usable()
        body.turn(targets)
        for _ in range(count):
            engine.stepSimulation(self._client)
            body.watch()
        self._steps += count
        body.read(count)
        self._check_usable()

    def joint_states(self) -> JointStates:
        """Return position, speed and motor effort of all joints, in the order of ``joints``."""
        self._check_usable()
        return self._body.joint_states()

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        self._check_usable()
        return self._body.base_pose()

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        self._check_usable()
        return self._body.base_twist()

    def reset(self) -> None:
        """Return to the very state of the start, bit for bit; time is 0 again."""
        if not self._disconnect.alive:
            self._check_usable()
        if not self._body.finite:
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
        where = checked_place(x, y, yaw)
        self._check_usable()
        engine.restoreState(self._saved, physicsClientId=self._client)
        self._body.stand(self._stance, where, start=False)
        self._check_usable()

    def brake(self) -> None:
        """Stop everything at once: all speeds are exactly 0, nothing changes its place."""
        self._check_usable()
        self._body.brake()
        self._check_usable()

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
        settings, description = self.settings, self._description
        try:
            self._robot = load_robot(client, make_world(client, settings), description, settings)
            self._body.enter(client, self._robot)
            self._stance = settle(client, self._robot, description, self.driven, settings)
        except BaseException:
            self._disconnect()
            raise
        self._saved: int = engine.saveState(physicsClientId=client)
        self._restart()

    def _restart(self) -> None:
        engine.restoreState(self._saved, physicsClientId=self._client)
        self._steps = 0
        self._body.stand(self._stance, self._start, start=True)
        self._check_usable()

    def _check_usable(self) -> None:
        if not self._disconnect.alive:
            raise OneBotError("this simulation has been closed; make a new one")
        if not self._body.finite:
            raise OneBotError(
                f"{self._description.source}: the simulation broke down: its state is no longer "
                "finite; reset it"
            )
