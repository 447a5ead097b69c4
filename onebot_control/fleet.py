"""Several robots in one world, each with its controller. No ROS here.

fleet = Fleet(description, config, [PlanarPose(0.0, 0.0, 0.0), PlanarPose(0.0, 1.0, 0.0)])
fleet.drives[0].accept(0.2, 0.0)
for _ in range(500):
    snapshots = fleet.cycle()
"""

from collections.abc import Sequence

from onebot_control.control_config import ControlConfig
from onebot_control.drive import Drive, Snapshot
from onebot_control.frames import PlanarPose
from onebot_control.geometry import check_wheel_names
from onebot_control.simulation import Member, Settings, World
from onebot_description.description import Description


class Fleet:
    """Robots of one kind, driven together.

    Attributes:
        world: which they share.
        drives: one a robot, for commands and parameters.
    """

    def __init__(
        self,
        description: Description,
        config: ControlConfig,
        starts: Sequence[PlanarPose],
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
    ) -> None:
        """Set a robot down at each of ``starts``, whose x, y and yaw count, not the config's.

        Raises:
            OneBotError: config and description do not suit each other, cannot be simulated, or two
                robots stand in the same place.
        """
        left, right = config.left_wheel_names, config.right_wheel_names
        check_wheel_names(description, left_wheel_names=left, right_wheel_names=right)
        members = [Member(description, (*left, *right), *start) for start in starts]
        self.world = World(members, settings)
        try:
            self.drives = tuple(Drive(description, config, body) for body in self.world.robots)
        except BaseException:
            self.world.close()
            raise

    def cycle(self) -> list[Snapshot]:
        """Do a control cycle of all robots; return them as they were at its beginning."""
        snapshots = []
        # One after the other, each while all that is its own is in the processor's caches.
        for drive, robot in zip(self.drives, self.world.robots, strict=True):
            snapshots.append(drive.begin())
            robot.turn(drive.wheel_velocities)
            drive.ticks += 1
        self.world.step(self.drives[0].period)
        return snapshots

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def __enter__(self) -> "Fleet":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
