"""One robot of a world: what may be done with it, and what there is to see of it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from onebot_control.simulation.places import checked_place
from onebot_control.simulation.robot import RobotBody
from onebot_control.simulation.settling import Stance
from onebot_control.simulation.states import JointStates, Pose, Twist

if TYPE_CHECKING:
    from onebot_control.simulation.world import World


class WorldRobot:
    """One robot of a world.

    Attributes:
        joints: names of all joints that move, in the description's order.
        driven: names of the joints that have a motor, in the order given.
        body: what the world moves.
    """

    def __init__(self, world: "World", row: int) -> None:
        """Take the place ``row`` in ``world``."""
        self._world, self._row = world, row
        self.body: RobotBody = world.bodies[row]
        self.joints, self.driven = self.body.joints, self.body.driven

    @property
    def stance(self) -> Stance:
        """How the robot stands on level ground."""
        return self._world.stances[self._row]

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
        return self._seen().joint_states()

    def base_pose(self) -> Pose:
        """Return the true pose of the root link's frame in the world."""
        return self._seen().base_pose()

    def base_twist(self) -> Twist:
        """Return the true velocity of the root link's frame, in its own axes."""
        return self._seen().base_twist()

    def reset(self) -> None:
        """Put this robot back to its start, at rest; time goes on."""
        self._world.stand(self._row)

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
        self._world.stand(self._row, checked_place(x, y, yaw))

    def brake(self) -> None:
        """Stop it all at once: its speeds are exactly 0, nothing changes its place."""
        self._seen().brake()
        self.body.check()

    def close(self) -> None:
        """Do nothing: the world is closed as a whole."""

    def _seen(self) -> RobotBody:
        """The robot's body, if there is anything to see of it."""
        self._world.check_open()
        self.body.check()
        return self.body
