"""Simulates robots from Python, for tests, notebooks and programs, without ROS.

Example:
    >>> from onebot_control import Simulation
    >>> with Simulation(world="maze", sensors=True, seed=7) as simulation:
    ...     robot = simulation.robot
    ...     robot.drive(0.5)
    ...     simulation.run(until=lambda: robot.distance_ahead() < 1.0)
    ...     robot.drive(0.0)
    ...     simulation.run(2.0)
    ...     error = robot.scan().ahead - robot.distance_ahead()
    >>> abs(error) < 0.05
    True
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from onebot_control.occupancy_grid import OccupancyGrid
from onebot_control.physics.occupancy import occupancy_grid
from onebot_control.robot_setup import (
    Model,
    Parameters,
    RobotSetup,
    fleet_members,
    read_robot_and_scene,
    read_scene,
)
from onebot_control.sensing.camera import picture_from
from onebot_control.sensing.rays import HAS_EMBREE, Rays
from onebot_control.sensing.readings import ByName, RobotPose
from onebot_control.sensing.surroundings import LinkPose
from onebot_control.simulated_robot import Duration, Positive, SimulatedRobot, Vector
from onebot_control.simulation_core import Moment, MomentLog, SimulationCore
from onebot_description.description import Description
from onebot_description.description.loading import XacroValues
from onebot_description.errors import OneBotError, listing
from onebot_description.parameters.arguments import ArgumentError, checked_methods
from onebot_description.parameters.reader import Problem
from onebot_description.parameters.values import NAMESPACE, NAMESPACE_WANTED, Rule, ValueType

if TYPE_CHECKING:
    from onebot_control.nodes.lockstep import Lockstep

ONEBOT = "package://onebot_description/urdf/onebot.urdf.xacro"
"""The default model of a Simulation: OneBot's xacro file."""

observers: list[Callable[["Simulation"], object]] = []
"""Functions that are called with each simulation of this process at its start and on reset."""

_World = Annotated[
    str | Path | Description,
    Rule(write='the name of a world, a URDF or xacro file, a Description, or "" for bare ground'),
]
_Sensors = Annotated[bool | str | Path, Rule(write="True or False, or a URDF or xacro file")]
_Seed = Annotated[int, Rule(at_least=0, at_most=2**64 - 1, write="an integer from 0 to 2^64 - 1")]
_Cycles = Annotated[
    int, Rule(at_least=0, write="a number of control cycles, which is not negative")
]
_Pixels = Annotated[int, Rule(at_least=1, at_most=4096, write="pixels, from 1 to 4096")]
_Bounds = Annotated[
    Sequence[float],
    ValueType(float, Rule(write="bounds: minimum x, minimum y, maximum x, maximum y"), True, 4),
]
_RobotName = Annotated[str, Rule(pattern=NAMESPACE, write=NAMESPACE_WANTED)]
_Robots = Annotated[Mapping[_RobotName, RobotSetup], Rule(write="a dict of RobotSetups by name")]


@checked_methods(before=lambda self: self._core.require_open())
class Simulation(AbstractContextManager["Simulation"]):
    """Simulates one or several robots in one world; time advances only in ``run``.

    It uses the same physics, controller, odometry and sensors as ``velocity_controller``. Nothing
    depends on how fast the computer is: the same calls give bit-identical results.
    """

    def __init__(
        self,
        model: Model = ONEBOT,
        *,
        world: _World = "",
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        sensors: _Sensors = False,
        noise: bool = True,
        seed: _Seed = 0,
        arguments: XacroValues = MappingProxyType({}),
        parameters: Parameters = MappingProxyType({}),
        robots: _Robots = MappingProxyType({}),
    ) -> None:
        """Build the world, with the robot at rest.

        Args:
            model: the robot: a .urdf or .xacro file, ``package://name/path``, or a Description.
            world: the world around it: the name of an included world ("maze", "ramp"), a URDF or
                xacro file, or a Description; "" for bare ground.
            x: start position, m.
            y: start position, m.
            yaw: start heading, rad.
            sensors: True to enable the optional sensors of a xacro file with the argument
                ``sensors_enabled``, such as OneBot's (a lidar, an IMU and a camera), or a URDF or
                xacro file with further sensors. The sensors in a URDF are always simulated.
            noise: whether sensors have the noise that the URDF specifies.
            seed: seed of the noise, 0 to 2^64 - 1; ``velocity_controller`` uses 0.
            arguments: xacro arguments of the model, by name.
            parameters: parameters of the controller, by their ROS names, such as
                ``linear.x.max_velocity``; they override OneBot's control.yaml.
            robots: several robots in this world, by name, instead of a single one.

        Raises:
            OneBotError: a robot, the world or a parameter cannot be used; the text names the file
                or the parameter, and what to write.
        """
        if robots and (x or y or yaw):
            raise OneBotError("x, y and yaw are for a single robot; give each RobotSetup its own")
        setups = dict(robots) or {"": RobotSetup(x, y, yaw)}
        optional = sensors is True
        default, scene = read_robot_and_scene(model, arguments, world, optional=optional)
        self._setups, self._given = setups, parameters
        self._members = partial(fleet_members, default=default, optional=optional)
        members, values = self._members(setups, parameters=parameters)
        sensor_file = "" if isinstance(sensors, bool) else str(sensors)
        self._build = partial(SimulationCore, sensor_file=sensor_file, noise=noise)
        self._core = core = self._build(members, values, scene, seed=seed)
        if sensors and not any(core.instruments):
            raise OneBotError(f"{members[0].description.source}: no sensor found")
        self._lockstep: Lockstep[Simulation] | None = None
        self._log: MomentLog | None = None
        own_robots = (SimulatedRobot(lambda: self._core, row) for row in range(len(setups)))
        self.robots: Mapping[str, SimulatedRobot] = MappingProxyType(
            ByName("no robot {}", zip(setups, own_robots, strict=True))
        )
        """The robots by name, "" for a single robot; an unknown name raises OneBotError."""
        self._begun()

    @property
    def robot(self) -> "SimulatedRobot":
        """The robot of a simulation with a single robot.

        Raises:
            OneBotError: there are several robots.
        """
        if len(self.robots) > 1:
            text = f"there are {len(self.robots)} robots here: {listing(self.robots)}"
            raise OneBotError(f"{text}; write simulation.robots[name]")
        return next(iter(self.robots.values()))

    @property
    def time(self) -> float:
        """Simulated time since the start, s."""
        return self._core.time

    @property
    def period(self) -> float:
        """Simulated duration of a control cycle, s: 1 / update_rate."""
        return self._core.fleet.period

    @property
    def world(self) -> Description | None:
        """The world around the robots; None for bare ground."""
        return self._core.scene

    @property
    def boxes(self) -> Mapping[str, RobotPose]:
        """The true poses of the world's movable boxes, by link; an unknown name raises OneBotError.

        A box is a link below a ``floating`` joint of the world; robots can push or lift it.
        """
        poses = self._core.boxes().items()
        return ByName("no box {} can move", ((link, RobotPose.of(pose)) for link, pose in poses))

    @property
    def seed(self) -> int:
        """The seed of the sensors' noise."""
        return self._core.seed

    def run(
        self,
        seconds: Duration | None = None,
        *,
        until: Callable[[], object] | None = None,
        timeout: Duration = 60.0,
    ) -> None:
        """Simulate for some time, or until a condition holds, as fast as the computer can.

        Args:
            seconds: simulated duration, rounded to whole control cycles.
            until: condition to run until, instead of ``seconds``; it is called before the first
                control cycle and after each one.
            timeout: simulated seconds to wait for ``until``.

        Raises:
            TimeoutError: ``until`` did not return a true value in time.
            ValueError: neither ``seconds`` nor ``until`` is given, or both, or a duration is
                negative or not finite.
            OneBotError: the simulation has been closed, or has diverged.
        """
        if (seconds is None) == (until is None):
            raise ArgumentError([Problem("", "run takes seconds, or until=...")])
        cycles = self._cycles(timeout if seconds is None else seconds)
        for number in range(cycles):
            if until is not None and until():
                return
            self._core.cycle(last=number == cycles - 1)
        if until is not None and not until():
            states = "; ".join(map(str, self.robots.values()))
            text = f"until did not return true in {timeout:g} s of simulated time"
            raise TimeoutError(f"{text}; at {self.time:g} s: {states}")

    def reset(
        self,
        seed: _Seed | None = None,
        *,
        x: float | None = None,
        y: float | None = None,
        yaw: float | None = None,
        parameters: Parameters | None = None,
        world: _World | None = None,
    ) -> None:
        """Go back to the start; everything that follows is bit-identical to a new Simulation.

        All arguments are as for a new one; None keeps the current value. Another world, or other
        parameters that are read at the start, rebuild the physics; all other changes are as fast
        as a reset without arguments.

        Args:
            seed: seed of the sensors' noise.
            x: start position of a single robot, m.
            y: start position of a single robot, m.
            yaw: start heading of a single robot, rad.
            parameters: parameters of the controllers, by their ROS names, instead of those given
                before; RobotSetups have their own.
            world: the world around the robots; "" for bare ground.

        Raises:
            OneBotError: ROS nodes are in lockstep with the simulation, a robot cannot start there,
                or the world or a parameter cannot be used; nothing has changed.
        """
        core = self._core
        if core.publish is not None:
            text = "ROS nodes are in lockstep with the simulation"
            raise OneBotError(f"{text}: time cannot go back for them; create a new Simulation")
        place = {n: v for n, v in (("x", x), ("y", y), ("yaw", yaw)) if v is not None}
        if place and "" not in self._setups:
            raise OneBotError("x, y and yaw are for a single robot; others have RobotSetups")
        seed = core.seed if seed is None else seed
        if not place and parameters is None and world is None:
            core.restart(seed)
        else:
            setups = {
                name: RobotSetup(**{**vars(setup), **place}) for name, setup in self._setups.items()
            }
            given = self._given if parameters is None else parameters
            members, values = self._members(setups, parameters=given)
            scene = core.scene if world is None else read_scene(world)
            if scene is core.scene and core.can_restart(members, values):
                core.restart(seed, values)
            else:
                self._move_into(self._build(members, values, scene, seed=seed))
            self._setups, self._given = setups, given
        self._begun()

    def _move_into(self, core: SimulationCore) -> None:
        """Replace the world and its robots."""
        core.after_cycle = self._core.after_cycle
        self._core.close()
        self._core = core
        if self._log is not None:
            core.record(self._log)

    def _begun(self) -> None:
        for observer in [*observers]:
            observer(self)

    def step(self, cycles: _Cycles = 1) -> None:
        """Simulate a number of control cycles, of ``period`` seconds each.

        Raises:
            ValueError: the number is not whole, or negative.
            OneBotError: the simulation has been closed, or has diverged.
        """
        for number in range(cycles):
            self._core.cycle(last=number == cycles - 1)

    def on_step(self, function: Callable[[], object]) -> Callable[[], None]:
        """Call a function after each control cycle from now on, without arguments.

        The state is the one at the end of the cycle; an exception in the function ends ``run``.

        Returns:
            A function that ends these calls.
        """
        key = object()  # the same function may be registered several times
        self._core.after_cycle[key] = function

        def end() -> None:
            self._core.after_cycle.pop(key, None)

        return end

    def record(self, seconds: Duration | None = None, rate: Positive | None = None) -> None:
        """Record poses and joints from now on, for ``log`` and ``moments``.

        A reset restarts the recording.

        Args:
            seconds: how many of the last simulated seconds to keep; None for all.
            rate: recorded moments per second, Hz; None for one in each control cycle.

        Raises:
            ValueError: the duration is negative or not finite, or the rate is not above 0.
        """
        cycles = None if seconds is None else self._cycles(seconds)
        every = 1 if rate is None else max(1, round(self._core.fleet.rate / rate))
        limit = None if cycles is None else max(1, round(cycles / every))
        self._log = MomentLog(every, limit)
        self._core.record(self._log)

    @property
    def moments(self) -> Sequence[Moment]:
        """The recorded moments, oldest first; empty unless ``record`` was called."""
        return tuple(self._log.moments) if self._log else ()

    @property
    def log(self) -> dict[str, NDArray[np.float64]]:
        """The recorded moments as arrays of equal length, by name, for example for pandas.

        They are ``time`` (s), the root link's true ``x``, ``y``, ``z`` (m), ``roll``, ``pitch``,
        ``yaw`` (rad), ``joints.NAME`` (rad or m), and for boxes ``boxes.NAME.x`` and so on; with
        several robots ``ROBOT.x`` and so on. It is empty unless ``record`` was called.
        """
        return self._log.columns([*self.robots]) if self._log else {}

    def occupancy_grid(
        self,
        resolution: Positive = 0.05,
        *,
        height: Positive = 0.1,
        bounds: _Bounds | None = None,
    ) -> OccupancyGrid:
        """Return the true map of the world at some height, without the robots.

        A cell is occupied if a collision shape of the world, or of a box at its current pose,
        reaches into it at that height.

        Args:
            resolution: edge of a cell, m.
            height: height above the ground, m; a ramp appears only where it is higher.
            bounds: minimum x and y, maximum x and y of the map, m; None to include all obstacles,
                with the corners of cells at multiples of the resolution.

        Raises:
            ValueError: a length is not above 0, or bounds are not minimum before maximum.
            OneBotError: there are neither obstacles nor bounds, or there are too many cells.
        """
        if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
            text = "write bounds: minimum x, minimum y, maximum x, maximum y"
            raise ArgumentError([Problem("bounds", text)])
        boxes = [*self._core.boxes().values()]
        return occupancy_grid(self._core.scene, boxes, resolution, height, bounds)

    def picture(
        self,
        eye: Vector,
        target: Vector,
        *,
        width: _Pixels = 640,
        height: _Pixels = 480,
    ) -> NDArray[np.uint8]:
        """Return a picture of the world and its robots, (height, width, 3), RGB.

        It is rendered like images of simulated cameras, without a display; ``robot.image()`` is the
        image of a robot's own camera.

        Args:
            eye: (3,), the viewpoint in the world, m.
            target: (3,), another point, at the center of the picture, m.
            width: pixels.
            height: pixels.

        Raises:
            ValueError: a number is not finite, eye and target are equal, or a size is out of range.
            OneBotError: Embree, which casts the rays, is not installed.
        """
        start, end = np.array([eye, target], float)
        if np.array_equal(start, end):
            raise ArgumentError([Problem("target", "is the same point as the eye")])
        if not HAS_EMBREE:
            raise OneBotError("pictures need the package embreex, which is not installed here")
        return picture_from(self._core.sensed(), start, end, width, height)

    def ray(self, origin: Vector, direction: Vector) -> float:
        """Return the distance to the first thing on a ray, m; infinite if there is none.

        The ray hits the ground and the visual shapes of world, boxes and robots, as for sensors.

        Args:
            origin: (3,), in the world, m.
            direction: (3,), in the world, of any length.

        Raises:
            ValueError: a number is not finite, or the direction is zero.
        """
        start, vector = np.array([origin, direction], float)
        length = np.linalg.norm(vector)
        if not length:
            raise ArgumentError([Problem("direction", "is zero; write three finite numbers")])
        ray = Rays((vector / length).reshape(1, 3))
        return self._core.distance(LinkPose(np.eye(3), start), ray)

    def ros(
        self,
        domain_id: int | None = None,
        *,
        remap: Mapping[str, str] = MappingProxyType({}),
        nav2_topics: bool = False,
        callback_timeout: float = 30.0,
    ) -> "Lockstep[Simulation]":
        """Publish the robots on ROS topics, and run nodes of this process in lockstep with them.

        Args:
            domain_id: the ROS domain, 0 to 232; None for ROS_DOMAIN_ID, or the domain of rclpy's
                default context if that is initialized.
            remap: new names of topics and services by name, for nodes and robots, like ``-r`` on a
                command line: ``{"cmd_vel": "velocity_controller/cmd_vel"}``.
            nav2_topics: whether the robots use the topics that Nav2 expects, cmd_vel and odom.
            callback_timeout: wall time that a callback may take, s; infinite for no limit. It ends
                only callbacks of the main thread, and none while a debugger is attached.

        Returns:
            The ``Lockstep``, to which nodes can be added.

        Raises:
            OneBotError: an argument cannot be used, the robots of this or of another simulation are
                already on ROS topics, or ROS 2 is missing.
        """
        from onebot_control.nodes.lockstep import Lockstep  # only this needs ROS

        if self._core.publish is not None:
            raise OneBotError("the robots are already on ROS topics")
        self._lockstep = Lockstep(
            self,
            self._core,
            domain_id,
            remap=remap,
            nav2_topics=nav2_topics,
            callback_timeout=callback_timeout,
        )
        return self._lockstep

    def close(self) -> None:
        """Free the world; a ``with`` block does so at its end.

        The poses and other states read last remain; all methods raise OneBotError.
        """
        if self._lockstep is not None:
            self._lockstep.close()
        self._core.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Simulation at {self.time:g} s: {'; '.join(map(str, self.robots.values()))}>"

    def _cycles(self, seconds: float) -> int:
        return round(seconds * self._core.fleet.rate)
