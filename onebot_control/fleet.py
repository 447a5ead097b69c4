"""Robots in one world, each with its controller, one control cycle at a time. No ROS here.

with Fleet.of([Member(description, ControlConfig.from_parameters({...}))]) as fleet:
    fleet.robots[0].accept(0.2, 0.0)
    snapshots = fleet.cycle()
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from onebot_control.driven_robot import DrivenRobot, DrivenSpawn, Snapshot
from onebot_control.joint_controllers import JointController
from onebot_control.parameters import ControlConfig
from onebot_control.physics import Robot, Settings, World
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.ros.parameters.reader import ConfigError
from onebot_description.ros.wire.cdr import NANO

# Of the solver, for the fingers of a linkage to move as one, and for arms: with 200 Panda is off by
# 5e-5 rad on its way to some poses. It stops as soon as it is exact; an arm that drives about would
# take three times as long.
_ARM_ITERATIONS = 1000


class Member(NamedTuple):
    """A robot of a fleet; it starts at the x, y and yaw of its config."""

    description: Description
    config: ControlConfig
    name: str = ""  # named in errors; empty if there is no other robot
    places: Mapping[str, str] = MappingProxyType({})  # files and lines of its parameters
    controllers: Sequence[JointController[Any]] = ()  # of joints that are no wheels
    stands: bool = False  # its base stands still


class Fleet:
    """Robots in one world, driven together; their configs have one update_rate.

    ``robots`` take commands and parameters. One robot alone is a fleet, too.
    """

    def __init__(self, robots: Sequence[DrivenRobot], world: World) -> None:
        self.robots, self.world = list(robots), world

    @classmethod
    def of(
        cls,
        members: Sequence[Member],
        settings: Settings = Settings(),  # noqa: B008 - it is frozen
        scene: Description | None = None,
    ) -> "Fleet":
        """Return robots in a world of their own.

        The rate of ``settings`` is fitted to the robots' update_rate.

        Raises:
            OneBotError: config and description of a robot do not suit each other, it cannot be
                simulated, or two robots start in the same place.
        """
        parts = [_part(member) for member in members]
        fitted = settings.fitted(members[0].config.update_rate)
        if any(part.converges_slowly for part in parts):
            fitted = replace(fitted, iterations=max(fitted.iterations, _ARM_ITERATIONS))
        world = World([part.spawn for part in parts], fitted, scene)
        try:
            robots = map(_driven, members, parts, world.robots)
            return cls(list(robots), world)
        except BaseException:
            world.close()
            raise

    @property
    def rate(self) -> float:
        """Control cycles a second, Hz."""
        return self.robots[0].config.update_rate

    @property
    def period(self) -> float:
        """Seconds of a control cycle."""
        return self.robots[0].period

    @property
    def ticks(self) -> int:
        """Control cycles done."""
        return self.robots[0].ticks

    @property
    def stamp(self) -> int:
        """Simulated time of the present cycle, ns.

        One period ahead, because a stamp of 0 means "not known" in ROS.
        """
        return round((self.ticks + 1) * NANO / self.rate)

    def cycle(self) -> list[Snapshot]:
        """Do a control cycle of all robots; return them as they were at its beginning."""
        snapshots = self.begin()
        self.finish()
        return snapshots

    def begin(self, stamp: int | None = None) -> list[Snapshot]:
        """Read the robots' states and update the controllers with them.

        ``stamp``: the time that commands are by, ns; None: the simulated one.
        """
        now = self.stamp if stamp is None else stamp
        return [robot.begin(now) for robot in self.robots]

    def finish(self) -> None:
        """Turn the wheels of all robots for a control period."""
        for robot in self.robots:
            robot.turn()
        self.world.step(self.period)

    def restart(self) -> None:
        """Begin again, as a new fleet of the same robots does."""
        self.world.restart()
        for robot in self.robots:
            robot.start(robot.config)

    def observe(self) -> None:
        """Read the robots' states now, before the cycle in which the controllers decide."""
        for robot in self.robots:
            robot.observe()

    def replace(self, row: int, description: Description) -> None:
        """Drive the robot of ``row`` by another description, where it is; the others move on.

        Raises:
            OneBotError: the description does not suit the parameters, cannot be simulated, or
                another robot is in the way; then nothing has changed.
        """
        old = self.robots[row]
        controllers = [*old.controllers.values()]
        member = Member(description, old.config, controllers=controllers, stands=old.wheels is None)
        part = _part(member)
        here = part.spawn._replace(**old.true_pose._asdict())
        world = self.world.replaced(row, here)
        try:
            robot = _driven(member, part, world.robots[row])
        except BaseException:
            world.close()
            raise
        robot.continue_from(old)
        self.world.close()
        self.world, self.robots[row] = world, robot
        for driven, plant in zip(self.robots, world.robots, strict=True):
            driven.plant = plant

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def __enter__(self) -> "Fleet":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Divider:
    """Picks so many of the cycles a second, evenly, and never more than there are."""

    def __init__(self, rate: float, cycles: float) -> None:
        self._share = min(rate / cycles, 1.0)
        self.restart()

    def restart(self) -> None:
        """Pick the next cycle."""
        self._phase = 1.0

    def due(self) -> bool:
        """Return whether this cycle is picked."""
        # A little less than 1, so that rounding errors of the sum drop no cycle.
        picked = self._phase >= 1.0 - 1e-9
        self._phase += self._share - (1.0 if picked else 0.0)
        return picked


def _part(member: Member) -> DrivenSpawn:
    with located(member):
        return DrivenSpawn.of(
            member.description,
            member.config,
            member.name,
            member.controllers,
            stands=member.stands,
        )


def _driven(member: Member, part: DrivenSpawn, plant: Robot) -> DrivenRobot:
    with located(member):
        return DrivenRobot(part, member.description, member.config, plant)


@contextmanager
def located(member: Member) -> Iterator[None]:
    """Have errors about a robot name it, and the lines that its parameters were written on."""
    try:
        yield
    except OneBotError as error:
        placed = error.located(member.places) if isinstance(error, ConfigError) else error
        if not member.name:
            raise placed from None
        raise OneBotError(f"{member.name}: {placed}") from None
