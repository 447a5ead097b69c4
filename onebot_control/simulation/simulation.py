"""One robot on level ground, moved by the speeds of its driven joints."""

from collections.abc import Sequence

from onebot_control.simulation.member import Member
from onebot_control.simulation.settings import Settings
from onebot_control.simulation.world import World
from onebot_control.simulation.world_robot import WorldRobot
from onebot_description.description import Description


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
                what to mend.
        """
        # Not taken from the world's ``robots``, which hold it: forgotten, this frees the world.
        super().__init__(World([Member(description, driven, x, y, yaw)], settings), 0)
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
