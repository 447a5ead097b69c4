"""Runs robots in one world, each with its controller, one control cycle at a time. No ROS here.

Example:
    >>> from onebot_control.fleet import Fleet
    >>> from onebot_control.drive_kinds import ControlConfig
    >>> from onebot_control.prepared_robot import Member
    >>> from onebot_description.description import load_description
    >>> description = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    >>> config = ControlConfig.from_parameters({"cmd_vel_timeout": 0.5})
    >>> with Fleet.from_members([Member(description, config)]) as fleet:
    ...     fleet.robots[0].accept(0.2, 0.0)
    ...     [snapshot] = fleet.cycle()
    >>> snapshot.tick
    0
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.physics.engine import PhysicsSettings, logger
from onebot_control.physics.robot_body import RobotBody
from onebot_control.physics.spawning import RobotSpawn
from onebot_control.physics.world import World
from onebot_control.prepared_robot import Member, PreparedRobot
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.timing import NS_PER_S

# Solver iterations for robots whose linkage fingers must move as one, and for arms with a fixed
# base: with 200, Panda is off by 5e-5 rad on its way to some poses. The solver stops as soon as it
# is exact; an arm on a moving base would take three times as long.
_ARM_ITERATIONS = 1000


class Fleet(AbstractContextManager["Fleet"]):
    """Robots in one world that are driven together, one control cycle at a time.

    A single robot is a fleet, too.

    Attributes:
        robots: the robots, which take commands and parameters, in the order of the members.
        world: the physics that they share.
    """

    def __init__(self, robots: Sequence[ControlledRobot], world: World) -> None:
        """Drive robots in their world."""
        self.robots, self.world = list(robots), world

    @classmethod
    def from_members(
        cls, members: Sequence[Member], *, scene: Description | None = None
    ) -> "Fleet":
        """Build a world with these robots in it.

        Args:
            members: the robots, one or more.
            scene: the world around the robots; None for bare ground.

        Raises:
            OneBotError: config and description of a robot do not match, it cannot be simulated, two
                robots start in the same place, or their update_rates differ.
        """
        _check_rates(members)
        prepared_robots = [_prepared(member) for member in members]
        spawns = [prepared.spawn for prepared in prepared_robots]
        world = World(spawns, _settings(members[0].config.update_rate, spawns), scene)
        return cls([*map(_controlled, prepared_robots, world.robots)], world)

    @property
    def rate(self) -> float:
        """Control cycles per second, Hz."""
        return self.robots[0].config.update_rate

    @property
    def period(self) -> float:
        """Duration of a control cycle, s."""
        return self.robots[0].period

    @property
    def ticks(self) -> int:
        """Number of control cycles done."""
        return self.robots[0].ticks

    @property
    def stamp(self) -> int:
        """Simulated time of the current cycle, ns.

        It is one period ahead, because a stamp of 0 means "not known" in ROS.
        """
        return round((self.ticks + 1) * NS_PER_S / self.rate)

    def cycle(self) -> list[Snapshot]:
        """Run one control cycle of all robots; return their states at its start."""
        snapshots = self.begin()
        self.finish()
        return snapshots

    def begin(self, stamp: int | None = None) -> list[Snapshot]:
        """Read the robots' states and update the controllers with them.

        Args:
            stamp: time of the cycle for trajectories, ns; None for simulated time.

        Returns:
            The states, in the order of ``robots``.
        """
        now = self.stamp if stamp is None else stamp
        return [robot.begin(now) for robot in self.robots]

    def finish(self, *, recorded: bool | None = False) -> None:
        """Move all robots for one control period, as commanded by their controllers.

        Args:
            recorded: also record the contacts of the world; see ``World.step``.
        """
        for robot in self.robots:
            robot.turn()
        self.world.step(self.period, recorded=recorded)

    def restart(self, configs: Sequence[SimulationConfig] = ()) -> None:
        """Go back to the start, to the same state as a new fleet of these robots.

        Args:
            configs: new parameters of all robots, including start poses; other parameters that are
                read only at the start have no effect. Empty to keep the current ones.

        Raises:
            OneBotError: their start poses overlap, for example after ``replace``, or a parameter
                does not match its robot; nothing has changed.
        """
        configs = configs or [robot.config for robot in self.robots]
        for robot, config in zip(self.robots, configs, strict=True):
            robot.fitted(config)
        self.world.restart([config.start for config in configs])
        for robot, config in zip(self.robots, configs, strict=True):
            robot.start(config)

    def reset(self) -> None:
        """Move all robots back to their starts; time and parameters stay.

        Raises:
            OneBotError: their start poses overlap, for example after ``replace``; nothing has
                changed.
        """
        self.world.reset()
        for robot in self.robots:
            robot.begin_at_rest()

    def observe(self) -> None:
        """Read the robots' states now; the next ``begin`` does not read them again."""
        for robot in self.robots:
            robot.observe()

    def replace(self, row: int, description: Description) -> None:
        """Replace the description of one robot, where it is; the others keep moving.

        Args:
            row: index of the robot in ``robots``.
            description: the new one.

        Raises:
            OneBotError: the description does not match the parameters, cannot be simulated, or
                another robot is in the way; nothing has changed.
        """
        old = self.robots[row]
        controllers = [*old.joint_controllers.values()]
        member = Member(description, old.config, controllers=controllers)
        prepared = _prepared(member)
        here = prepared.spawn._replace(start=old.true_pose)
        spawns = [robot.body.spawn for robot in self.robots]
        spawns[row] = here
        world = self.world.replaced(row, here, _settings(self.rate, spawns))
        robot = _controlled(prepared, world.robots[row])
        robot.continue_from(old)
        self.world.close()
        self.world, self.robots[row] = world, robot
        for robot, body in zip(self.robots, world.robots, strict=True):
            robot.move_into(body)

    def close(self) -> None:
        """Free the world."""
        self.world.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def _settings(rate: float, spawns: Sequence[RobotSpawn]) -> PhysicsSettings:
    """Return the physics for cycles at ``rate``, Hz, with the iterations that the robots need."""
    settings = PhysicsSettings().fitted(rate)
    if any(spawn.converges_slowly for spawn in spawns):
        return replace(settings, iterations=_ARM_ITERATIONS)
    return settings


def _prepared(member: Member) -> PreparedRobot:
    with member.located():
        prepared = PreparedRobot(member)
    for problem in prepared.ignored:
        logger.warning(problem.message(member.places))
    return prepared


def _check_rates(members: Sequence[Member]) -> None:
    """Raise a OneBotError if the members differ in their update_rate."""
    first = members[0]
    for member in members:
        rate, same = member.config.update_rate, first.config.update_rate
        if rate != same:
            text = f"{member.name}: update_rate is {rate:g} Hz, but {first.name} has {same:g} Hz"
            raise OneBotError(f"{text}; it must be the same for all robots of a world")


def _controlled(prepared: PreparedRobot, body: RobotBody) -> ControlledRobot:
    with prepared.member.located():
        return ControlledRobot(prepared, body)
