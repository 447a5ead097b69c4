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

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_control.control_files import default_control_file, read_control_files
from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.controller_names import DRIVE_CONTROLLER
from onebot_control.drive.drive import Drive
from onebot_control.drive.wheels.finding import has_wheels
from onebot_control.drive_kinds import ControlConfig
from onebot_control.fleet import Fleet, Member
from onebot_control.joint_controllers import named
from onebot_control.physics.contacts import Contact
from onebot_control.physics.occupancy import OccupancyGrid, occupancy_grid
from onebot_control.recording import Moment, MomentLog
from onebot_control.sensing.camera import picture_from
from onebot_control.sensing.instrument import Frame, Instrument, SensedWorld
from onebot_control.sensing.lidar import LidarInstrument, angles
from onebot_control.sensing.rays import HAS_EMBREE, Rays, cast
from onebot_control.sensing.readings import (
    ImuReading,
    JointState,
    OdometryReading,
    PlanarVelocity,
    RobotPose,
    Scan,
)
from onebot_control.sensing.sensors import INSTRUMENTS, Sensors
from onebot_control.sensing.surroundings import LinkPose, SensedRobot
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.description import Description, load_description
from onebot_description.description.loading import XacroValues, load_sensors, load_world
from onebot_description.description.xacro import xacro_arguments
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.geometry.poses import PlanarPose, Transform, to_rpy
from onebot_description.parameters.arguments import ArgumentError, checked_methods
from onebot_description.parameters.reader import ConfigError, Problem, leaves
from onebot_description.parameters.values import NAMESPACE, NAMESPACE_WANTED, Rule, ValueType, plain

if TYPE_CHECKING:
    from onebot_control.nodes.lockstep import Lockstep

V = TypeVar("V")

ONEBOT = "package://onebot_description/urdf/onebot.urdf.xacro"
"""The default model of a Simulation: OneBot's xacro file."""

_SENSORS = "sensors_enabled"  # the xacro argument of optional sensors
_CLOSED = "this simulation has been closed; make a new one"
_AHEAD = Rays(np.array([[1.0, 0.0, 0.0]]))  # along the x axis
_REACH = 1e4  # m; rays that go farther hit nothing
# Parameters of velocity_controller that do not make a Simulation another one.
_WITHOUT_EFFECT = {
    *("x", "y", "yaw", "world", "sensors", "sensor_noise", "robot_description"),
    *("real_time_factor", "paused", "step_topics", "step_timeout"),
}

_Model = Annotated[str | Path | Description, Rule(write="a URDF or xacro file, or a Description")]
_World = Annotated[
    str | Path | Description,
    Rule(write='the name of a world, a URDF or xacro file, a Description, or "" for bare ground'),
]
_Sensors = Annotated[bool | str | Path, Rule(write="True or False, or a URDF or xacro file")]
_Seed = Annotated[int, Rule(at_least=0, at_most=2**64 - 1, write="an integer from 0 to 2^64 - 1")]
_Duration = Annotated[
    float, Rule(at_least=0.0, at_most=1e12, write="a duration that is finite and not negative, s")
]
_Vector = Annotated[
    Sequence[float], ValueType(float, Rule(write="three finite numbers: x, y, z"), True, 3)
]
_Positive = Annotated[float, Rule(above=0.0)]
_Cycles = Annotated[
    int, Rule(at_least=0, write="a number of control cycles, which is not negative")
]
_Pixels = Annotated[int, Rule(at_least=1, at_most=4096, write="pixels, from 1 to 4096")]
_Bounds = Annotated[
    Sequence[float],
    ValueType(float, Rule(write="bounds: least x, least y, greatest x, greatest y"), True, 4),
]
_Positions = Annotated[Mapping[str, float], Rule(write="a dict of positions by joint")]
_Remap = Annotated[Mapping[str, str], Rule(write='a dict such as {"cmd_vel": "/cmd_vel"}')]
_Parameters = Annotated[Mapping[str, Any], Rule(write="a dict of values by their ROS names")]
_RobotName = Annotated[str, Rule(pattern=NAMESPACE, write=NAMESPACE_WANTED)]


@checked_methods()
@dataclass(frozen=True)
class RobotSetup:
    """Model, start pose and parameters of one of several robots in a ``Simulation``.

    Attributes:
        x: start position in the world, m.
        y: start position in the world, m.
        yaw: start heading, rad.
        model: a URDF or xacro file, or a Description; None for the Simulation's model.
        parameters: parameters of its controller, by ROS names; they override the Simulation's.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    model: _Model | None = None
    parameters: _Parameters = field(default_factory=dict)


_Robots = Annotated[Mapping[_RobotName, RobotSetup], Rule(write="a dict of RobotSetups by name")]


@checked_methods(before=lambda simulation: simulation._require_open())
class Simulation(AbstractContextManager["Simulation"]):
    """Simulates one or several robots in one world; time advances only in ``run``.

    It uses the same physics, controller, odometry and sensors as ``velocity_controller``. Nothing
    depends on how fast the computer is: the same calls give bit-identical results.
    """

    def __init__(
        self,
        model: _Model = ONEBOT,
        *,
        world: _World = "",
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        sensors: _Sensors = False,
        noise: bool = True,
        seed: _Seed = 0,
        arguments: XacroValues = MappingProxyType({}),
        parameters: _Parameters = MappingProxyType({}),
        robots: _Robots = MappingProxyType({}),
    ) -> None:
        """Build the world, with the robot at rest.

        Args:
            model: the robot: a .urdf or .xacro file, ``package://name/path``, or a Description.
            world: what stands around it: the name of an included world ("maze", "ramp"), a URDF or
                xacro file, or a Description; "" for bare ground.
            x: start position, m.
            y: start position, m.
            yaw: start heading, rad.
            sensors: True to enable the optional sensors of a xacro file with the argument
                ``sensors_enabled``, as OneBot's (a lidar, an IMU and a camera), or a URDF or xacro
                file with further ones. The sensors in a URDF are always simulated.
            noise: whether sensors have the noise that the URDF specifies.
            seed: seed of that noise, 0 to 2^64 - 1; ``velocity_controller`` uses 0.
            arguments: xacro arguments of the model, by name.
            parameters: parameters of the controller, by their ROS names, such as
                ``linear.x.max_velocity``; they override OneBot's control.yaml.
            robots: several robots in this world, by name, instead of a single one.

        Raises:
            OneBotError: a robot, the world or a parameter cannot be used; the text names the file
                or the parameter, and what would be right.
        """
        self._seed, self._noisy, self._closed = seed, noise, False
        self._ros: Lockstep[Simulation] | None = None
        self._recording: MomentLog | None = None
        self._functions: dict[object, Callable[[], object]] = {}  # called after each cycle
        if robots and (x or y or yaw):
            raise OneBotError("x, y and yaw are for a single robot; give each RobotSetup its own")
        setups = dict(robots) or {"": RobotSetup(x, y, yaw)}
        optional = sensors is True
        description, scene = _read(model, arguments, world, optional)
        self._scene = scene
        self._values = [
            _values(setup, {**parameters, **setup.parameters}) for setup in setups.values()
        ]
        self._start_values = tuple(self._values)
        members = [
            _member(
                name,
                description if setup.model is None else _described(setup.model, {}, optional),
                _config(name, values),
            )
            for (name, setup), values in zip(setups.items(), self._values, strict=True)
        ]
        self._sensor_file = "" if isinstance(sensors, bool) else str(sensors)
        self._fleet = fleet = Fleet.from_members(members, scene=scene)
        self._sensors = Sensors(scene, fleet.rate, fleet.world.settings.gravity)
        self.robots: Mapping[str, SimulatedRobot] = MappingProxyType(
            _Named(
                "no robot {}", ((n, SimulatedRobot(self, n, row)) for row, n in enumerate(setups))
            )
        )
        """The robots by name, that of a single robot is ""; an unknown name raises OneBotError."""
        for robot in self.robots.values():
            robot._equip(self._sensor_file, noise)
        if sensors and not any(robot._instruments for robot in self.robots.values()):
            raise OneBotError(f"{self._fleet.robots[0].description.source}: no sensor found")
        self._begin()

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
        return self._fleet.ticks / self._fleet.rate

    @property
    def period(self) -> float:
        """Simulated duration of a control cycle, s: 1 / update_rate."""
        return self._fleet.period

    @property
    def world(self) -> Description | None:
        """What stands around the robots; None for bare ground."""
        return self._scene

    @property
    def boxes(self) -> Mapping[str, RobotPose]:
        """The true poses of the world's movable boxes, by link; an unknown name raises OneBotError.

        A box is a link below a ``floating`` joint of the world; robots can push or lift it.
        """
        return _Named(
            "no box {} can move",
            {link: _pose(transform) for link, transform in self._boxes().items()},
        )

    @property
    def seed(self) -> int:
        """The seed of the sensors' noise."""
        return self._seed

    def run(
        self,
        seconds: _Duration | None = None,
        *,
        until: Callable[[], object] | None = None,
        timeout: _Duration = 60.0,
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
            self._cycle(last=number == cycles - 1)
        if until is not None and not until():
            states = "; ".join(map(str, self.robots.values()))
            text = f"until returned nothing true in {timeout:g} s of simulated time"
            raise TimeoutError(f"{text}; at {self.time:g} s: {states}")

    def reset(self, seed: _Seed | None = None) -> None:
        """Go back to the start; everything that follows is bit-identical to a new Simulation.

        Args:
            seed: new seed of the sensors' noise; None to use the same one again.

        Raises:
            OneBotError: ROS nodes are in step with the simulation.
        """
        if self._ros is not None:
            raise OneBotError("nodes are in step with it: time cannot go back for them; begin anew")
        if seed is not None:
            self._seed = seed
            for robot in self.robots.values():
                for instrument in robot._instruments:
                    instrument.reseed(self._seed)
        for row, values in enumerate(self._start_values):
            if values is not self._values[row]:
                self._configure(row, values)
        self._fleet.restart()
        self._begin()
        if self._recording is not None:
            self._recording.moments.clear()
            self._recording.moments.append(self._moment())

    def _set_parameters(self, row: int, parameters: Mapping[str, Any]) -> None:
        if self._ros is not None:
            raise OneBotError("nodes are in step with it: set the parameters of the robot's node")
        _check_effects(parameters)
        fixed = {leaf.name for leaf in leaves(ControlConfig) if leaf.type.rule.read_only}
        text = "is read at the start; give it to Simulation(parameters=...)"
        if problems := [Problem(name, text) for name in parameters if name in fixed]:
            raise ConfigError(problems)
        given = {name: plain(value) for name, value in parameters.items()}
        self._configure(row, {**self._values[row], **given})

    def _configure(self, row: int, values: dict[str, Any]) -> None:
        config, robot = ControlConfig.from_parameters(values), self._fleet.robots[row]
        robot.configure(config if robot.drive else config.standing)
        self._values[row] = values

    def step(self, cycles: _Cycles = 1) -> None:
        """Simulate a number of control cycles, of ``period`` seconds each.

        Raises:
            ValueError: the number is not whole, or negative.
            OneBotError: the simulation has been closed, or has diverged.
        """
        for number in range(cycles):
            self._cycle(last=number == cycles - 1)

    def on_step(self, function: Callable[[], object]) -> Callable[[], None]:
        """Call a function after each control cycle from now on, without arguments.

        The state is that at the cycle's end; what the function raises ends ``run`` there.

        Returns:
            A function that ends these calls.
        """
        key = object()  # the same function may be there several times
        self._functions[key] = function

        def end() -> None:
            self._functions.pop(key, None)

        return end

    def record(self, seconds: _Duration | None = None, rate: _Positive | None = None) -> None:
        """Record poses and joints from now on, for ``log`` and ``moments``.

        A reset begins the recording anew.

        Args:
            seconds: how many simulated seconds are kept, the last ones; None for all.
            rate: recorded moments per second, Hz; None for one in each control cycle.

        Raises:
            ValueError: the duration is negative or not finite, or the rate is not above 0.
        """
        cycles = None if seconds is None else self._cycles(seconds)
        every = 1 if rate is None else max(1, round(self._fleet.rate / rate))
        most = None if cycles is None else max(1, round(cycles / every))
        self._recording = MomentLog(every, most)
        self._recording.moments.append(self._moment())

    @property
    def moments(self) -> "Sequence[Moment]":
        """The recorded moments, oldest first; empty unless ``record`` was called."""
        return tuple(self._recording.moments) if self._recording else ()

    @property
    def log(self) -> dict[str, NDArray[np.float64]]:
        """The recorded moments as arrays of one length, by name, as for ``pandas.DataFrame``.

        They are ``time`` (s), the root link's true ``x``, ``y``, ``z`` (m), ``roll``, ``pitch``,
        ``yaw`` (rad), ``joints.NAME`` (rad or m), and of a box ``boxes.NAME.x`` and so on; of
        several robots ``ROBOT.x`` and so on. It is empty unless ``record`` was called.
        """
        return self._recording.columns([*self.robots]) if self._recording else {}

    def _moment(self) -> Moment:
        fleet = self._fleet
        snapshots = [robot.snapshot() for robot in fleet.robots]
        return Moment(
            self.time,
            fleet.stamp,
            [snapshot.pose for snapshot in snapshots],
            [
                {**robot.held, **dict(zip(robot.joints, snapshot.joints.positions, strict=True))}
                for robot, snapshot in zip(fleet.robots, snapshots, strict=True)
            ],
            self._boxes(),
        )

    def _boxes(self) -> dict[str, Transform]:
        scene = self._fleet.world.scene
        return dict(zip(scene.links, scene.poses, strict=True)) if scene else {}

    def occupancy_grid(
        self,
        resolution: _Positive = 0.05,
        *,
        height: _Positive = 0.1,
        bounds: _Bounds | None = None,
    ) -> OccupancyGrid:
        """Return the true map of the world: what stands at some height, without the robots.

        A cell is occupied if a collision shape of the world, or of a box where it is now, reaches
        into it at that height.

        Args:
            resolution: edge of a cell, m.
            height: height above the ground, m; a ramp is there only where it is higher.
            bounds: least x and y, greatest x and y of the map, m; None for what is there, with the
                corners of cells at multiples of the resolution.

        Raises:
            ValueError: a length is not above 0, or bounds are not least before greatest.
            OneBotError: nothing is there, and there are no bounds; or there are too many cells.
        """
        if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
            text = "write bounds: least x, least y, greatest x, greatest y"
            raise ArgumentError([Problem("bounds", text)])
        boxes = [*self._boxes().values()]
        return occupancy_grid(self._scene, boxes, resolution, height, bounds)

    def picture(
        self,
        eye: _Vector,
        target: _Vector,
        *,
        width: _Pixels = 640,
        height: _Pixels = 480,
    ) -> NDArray[np.uint8]:
        """Return a picture of the world and its robots, (height, width, 3), RGB.

        It is painted as those of simulated cameras, without a display; ``robot.image()`` is what a
        robot's own camera sees.

        Args:
            eye: (3,), where it is seen from, in the world, m.
            target: (3,), another point, in the middle of the picture, m.
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
        return picture_from(self._sensed_world(), start, end, width, height)

    def ray(self, origin: _Vector, direction: _Vector) -> float:
        """Return the distance to the first thing on a ray, m; infinite if there is none.

        The ray hits the ground and the visual shapes of world, boxes and robots, as sensors do.

        Args:
            origin: (3,), in the world, m.
            direction: (3,), in the world, of any length.

        Raises:
            ValueError: a number is not finite, or the direction is zero.
        """
        start, way = np.array([origin, direction], float)
        length = np.linalg.norm(way)
        if not length:
            raise ArgumentError([Problem("direction", "is zero; write three finite numbers")])
        ray = Rays((way / length).reshape(1, 3))
        return self._distance(LinkPose(np.eye(3), start), ray, ())

    def ros(
        self,
        domain_id: int | None = None,
        *,
        remap: _Remap = MappingProxyType({}),
        nav2_topics: bool = False,
        callback_timeout: Annotated[float, Rule(above=0.0, infinite=True)] = 30.0,
    ) -> "Lockstep[Simulation]":
        """Publish the robots on ROS topics, and run nodes of this process in lockstep with them.

        Args:
            domain_id: the ROS domain, 0 to 232; None for ROS_DOMAIN_ID, or the domain of rclpy's
                default context if that is initialized.
            remap: new names of topics and services by name, for nodes and robots, as ``-r`` on a
                command line: ``{"cmd_vel": "velocity_controller/cmd_vel"}``.
            nav2_topics: whether the robots' topics are those that Nav2 expects, cmd_vel and odom.
            callback_timeout: wall time that a callback may take, s; infinite for any. It ends
                callbacks of the main thread only, and none while a debugger is attached.

        Returns:
            The ``Lockstep``, to which nodes can be added.

        Raises:
            OneBotError: an argument cannot be used, the robots of this or of another simulation are
                on ROS topics already, or ROS 2 is missing.
        """
        from onebot_control.nodes.lockstep import Lockstep  # only this needs ROS

        if self._ros is not None:
            raise OneBotError("the robots are on ROS topics already")
        self._ros = Lockstep(
            self,
            domain_id,
            remap=remap,
            nav2_topics=nav2_topics,
            callback_timeout=callback_timeout,
        )
        return self._ros

    def close(self) -> None:
        """Free the world; a ``with`` block does so at its end.

        Poses and other states that were last read remain; all methods raise OneBotError.
        """
        if self._ros is not None:
            self._ros.close()
        self._fleet.close()
        self._closed = True

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Simulation at {self.time:g} s: {'; '.join(map(str, self.robots.values()))}>"

    def _begin(self) -> None:
        self._before: Sequence[Snapshot] | None = None
        self._frame: Frame | None = None
        self._asked = False  # whether somebody has asked for contacts
        self._sensors.restart()
        for robot in self.robots.values():
            robot._command = None
        self._fleet.observe()
        self._current_frame()  # an IMU needs the orientation at the start

    def _require_open(self) -> None:
        if self._closed:
            raise OneBotError(_CLOSED)

    def _cycles(self, seconds: float) -> int:
        return round(seconds * self._fleet.rate)

    def _cycle(self, *, last: bool) -> None:
        """Run one control cycle; afterwards the robots' state is that at its end.

        Args:
            last: whether it is the last one before somebody can ask for its contacts. They are
                recorded then, and from the first time on that somebody has asked.
        """
        fleet = self._fleet
        for robot in self.robots.values():
            if robot._command is not None:
                robot._controlled.accept(*robot._command)
        self._before = fleet.begin()
        try:
            if self._ros is not None:
                self._ros.publish(self._before, fleet.stamp)
        finally:  # after an exception in a callback, the simulation can go on
            fleet.finish(recorded=last or self._asked or None)
            fleet.observe()
            self._frame = None
            if self._recording is not None and fleet.ticks % self._recording.every == 0:
                self._recording.moments.append(self._moment())
        for function in [*self._functions.values()]:
            function()

    def _sensed_world(self) -> SensedWorld:
        """Return the world as it is now, for sensors; the first time their meshes are read."""
        return self._sensors.world(self._current_frame())

    def _current_frame(self) -> Frame:
        fleet = self._fleet
        if self._frame is None:
            scene = fleet.world.scene
            snapshots = [robot.snapshot() for robot in fleet.robots]
            boxes = scene.poses if scene else ()
            self._frame = self._sensors.frame(fleet.stamp, snapshots, self._before, boxes)
        return self._frame

    def _distance(self, pose: LinkPose, ray: Rays, skipped: Sequence[int]) -> float:
        placed = self._sensed_world().placed
        hits = cast(
            ray,
            *pose,
            placed.surroundings.still,
            placed.targets,
            _REACH,
            skipped,
        )
        distance = float(hits.distances[0])
        return distance if distance < _REACH else math.inf


@checked_methods(before=lambda robot: robot._simulation._require_open())
class SimulatedRobot:
    """One robot of a Simulation: takes commands, and returns its true state and measurements."""

    def __init__(self, simulation: Simulation, name: str, row: int) -> None:
        """Take the robot ``row`` of a simulation; users get it from ``Simulation.robots``."""
        self._simulation, self._name, self._row = simulation, name, row
        self._command: tuple[float, float] | None = None
        self._instruments: list[Instrument[Any]] = []

    def drive(self, linear: float, angular: float = 0.0) -> None:
        """Command a velocity; it holds until the next call, as if sent in every cycle.

        From then on, commands of ROS nodes in step have no effect. The controller limits speed and
        acceleration: OneBot's accelerates by 0.5 m/s^2, so it takes 1 s to reach 0.5 m/s.

        Args:
            linear: forward, m/s.
            angular: velocity of turning to the left, rad/s.

        Raises:
            ValueError: a velocity is not finite.
            OneBotError: the robot has no wheels.
        """
        if self._drive:
            self._command = linear, angular

    def move_to(self, positions: _Positions, *, seconds: _Positive) -> None:
        """Move joints to ``positions``, where they come to rest after ``seconds``.

        They start in the next control cycle and follow a quintic polynomial that begins with their
        current velocity; another call replaces it. Other joints hold their commanded positions, so
        fingers that grip something keep gripping it. Joints that are too slow for it arrive later:
        ``moving`` is true until they are there, or cannot get there, as ``stalled`` tells.

        Args:
            positions: target by joint name, rad (m for prismatic joints); a continuous joint makes
                whole turns to it.
            seconds: simulated duration, above 0.

        Raises:
            OneBotError: no controller commands a joint, or a position is not finite or beyond the
                joint's limits; then nothing moves.
        """
        stamp = self._simulation._fleet.stamp
        arms = self._trajectories
        owners = {joint: name for name, arm in arms.items() for joint in arm.names}
        for joint in positions:
            if joint not in owners:
                raise OneBotError(f'no joint "{joint}" is commanded{did_you_mean(joint, owners)}')
        problems, goals = list[str](), dict[str, TrajectoryGoal]()
        for controller in dict.fromkeys(owners[joint] for joint in positions):
            arm = arms[controller]
            moved = {name: positions[name] for name in arm.names if name in positions}
            present = dict(zip(arm.names, arm.reference(0.0), strict=True))
            problems += arm.problems(_goal({**present, **moved}, seconds), stamp)
            goals[controller] = _goal(moved, seconds)
        if problems:
            raise OneBotError("\n".join(problems))
        for controller, goal in goals.items():
            arm = arms[controller]
            held = set(arm.names) - set(positions)
            replaced = arm.start(goal, from_command=held, absolute=True)
            self._controlled.finish(controller, [replaced])

    @property
    def moving(self) -> bool:
        """Whether joints are still moving to a goal of ``move_to`` or of a ROS node.

        A joint arrives within 1e-4 rad or m, at rest. It cannot get there if, after the end of the
        motion, it stands still elsewhere for a second, or comes no nearer for five.
        """
        return any(arm.moving for arm in self._trajectories.values())

    @property
    def stalled(self) -> Sequence[str]:
        """The joints that could not get to their last goal: blocked, or too weak; see ``moving``.

        A finger that grips something is one of them.
        """
        return [name for arm in self._trajectories.values() for name in arm.stalled]

    @property
    def _trajectories(self) -> dict[str, TrajectoryFollower]:
        arms = self._controlled.arms.items()
        return {name: arm for name, arm in arms if isinstance(arm, TrajectoryFollower)}

    def teleport(self, x: float, y: float, yaw: float = 0.0) -> None:
        """Move the robot to another pose in the world, at rest; its odometry does not change.

        Args:
            x: x coordinate of the root link in the world, m.
            y: y coordinate of the root link in the world, m.
            yaw: heading in the world, rad.

        Raises:
            OneBotError: something is in the way, or a value not finite; then nothing has changed.
        """
        self._controlled.teleport(PlanarPose(x, y, yaw))
        self._controlled.observe()
        self._simulation._frame = None

    @property
    def contacts(self) -> Sequence[Contact]:
        """What touched the robot in the last control cycle, in any of its physics steps.

        It is empty after a reset or a teleport, until the next cycle. Of two links that touch, all
        points are listed, where they were last; the sum of their forces is the mean over the cycle.
        """
        self._simulation._asked = True
        return self._simulation._fleet.world.contacts.contacts(self._row)

    @property
    def collided(self) -> bool:
        """Whether it has touched anything but what it stands on since it was placed.

        It was placed at the start, by a reset, a teleport. It stands on what carries its base,
        wheels and casters from below; for links that arms move, the ground is an obstacle, too.
        """
        return self._simulation._fleet.world.contacts.collided[self._row]

    def push(
        self,
        force: _Vector,
        seconds: _Duration,
        *,
        link: str = "",
        point: _Vector | None = None,
    ) -> None:
        """Push the robot for some time, from the next cycle on; several pushes add up.

        Args:
            force: (3,), in the world's axes, N.
            seconds: simulated duration, rounded to whole physics steps; a reset or a teleport of
                the robot ends it.
            link: what is pushed; "" for the root link.
            point: (3,), where, in the link's frame, m; None for the centre of mass of the link and
                all that is fixed to it.

        Raises:
            ValueError: a number is not finite, or the duration is negative.
            OneBotError: there is no such link, or it stands still.
        """
        at = None if point is None else np.array(point, float)
        link = link or self.description.root_link
        world = self._simulation._fleet.world
        world.push(self._controlled.body, link, at, np.array(force, float), seconds)

    def set_joints(self, positions: _Positions) -> None:
        """Set joints to ``positions`` at once, at rest; their controllers hold them there.

        Joints that mimic them follow; other joints and the base go on. Use ``move_to`` to move
        joints by their motors.

        Args:
            positions: position by joint name, rad (m for prismatic joints).

        Raises:
            OneBotError: a joint cannot be set, a position is not finite or beyond the joint's
                limits, or the robot would be in something there; then nothing has changed.
        """
        self._controlled.set_joints(positions)
        self._controlled.observe()
        self._simulation._frame = None

    def set_parameters(self, parameters: _Parameters) -> None:
        """Change parameters of the controller from the next cycle on; a reset undoes it.

        Args:
            parameters: values by their ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: a value is wrong, or is read at the start only; then nothing has changed.
            OneBotError: ROS nodes are in step: the robot's node has the parameters.
        """
        self._simulation._set_parameters(self._row, parameters)

    @property
    def description(self) -> Description:
        """The robot's description: its links, joints and sensors as read from the URDF."""
        return self._controlled.description

    @property
    def has_wheels(self) -> bool:
        """Whether the robot drives on wheels; otherwise its base stands still."""
        return self._controlled.drive is not None

    @property
    def wheel_separation(self) -> float:
        """Distance between the wheels, m: the parameter, or the value from the URDF."""
        return float(self._drive.geometry.separation)

    @property
    def wheel_radius(self) -> float:
        """Radius of the driven wheels, m: the parameter, or the value from the URDF."""
        return float(self._drive.geometry.radius)

    @property
    def pose(self) -> RobotPose:
        """The true pose of the robot's root link in the world."""
        return _pose(self._controlled.snapshot().pose)

    @property
    def twist(self) -> PlanarVelocity:
        """The true velocity of the robot's root link, in its own axes."""
        linear, angular = self._controlled.snapshot().velocity
        return PlanarVelocity(linear[0], angular[2])

    @property
    def odometry(self) -> OdometryReading:
        """Pose and velocity by the wheels' odometry."""
        (x, y, yaw), covariances, (linear, _, angular), _ = self._drive.state(
            self._controlled.pace.value
        )
        xx, xy, yy, xt, yt, tt = covariances
        covariance = ((xx, xy, xt), (xy, yy, yt), (xt, yt, tt))
        return OdometryReading(x, y, math.remainder(yaw, math.tau), linear, angular, covariance)

    @property
    def command(self) -> PlanarVelocity:
        """The limited velocity that the controller set in the last cycle, as in ~/cmd_vel_out."""
        command = self._drive.command
        return PlanarVelocity(command.linear, command.angular)

    @property
    def joints(self) -> Mapping[str, JointState]:
        """The states of the moving joints, by name; an unknown name raises OneBotError."""
        states = zip(*self._controlled.snapshot().joint_states, strict=True)
        readings = (JointState(*state) for state in states)
        return _Named("no joint {} can move", zip(self._controlled.joints, readings, strict=True))

    def scan(self, sensor: str = "") -> Scan:
        """Measure with a lidar now, whatever its rate.

        Args:
            sensor: name of the lidar; may be left out if there is only one.

        Returns:
            The ranges in the lidar's plane; of a 3D lidar, those of its middle row.

        Raises:
            OneBotError: there is no such lidar, or there are several.
        """
        lidar = self._instrument("scan", sensor).model
        ranges = self._measured("scan", sensor)
        return Scan(ranges, angles(lidar.horizontal), lidar.least, lidar.greatest)

    def range(self, sensor: str = "") -> float:
        """Return what a range sensor measures now, m; arguments and errors as for ``scan``."""
        return float(self._measured("range", sensor))

    def image(self, sensor: str = "") -> NDArray[np.uint8]:
        """Return a camera's image now, (height, width, 3), RGB; see ``scan`` for the rest."""
        pixels: NDArray[np.uint8] = self._measured("image", sensor)
        return pixels

    def depth(self, sensor: str = "") -> NDArray[np.float32]:
        """Return a depth camera's image now, (height, width), m along its axis.

        Depths are infinite where nothing is in range. For argument and errors see ``scan``.
        """
        depths: NDArray[np.float32] = self._measured("depth", sensor)
        return depths

    def points(self, sensor: str = "") -> NDArray[np.float32]:
        """Return the points that a lidar or depth camera sees now, (N, 3), m.

        They are in the frame of the sensor's messages; rays that hit nothing yield no point. For
        argument and errors see ``scan``.
        """
        cloud = self._measured("points", sensor).ravel()
        xyz: NDArray[np.float32] = np.stack([cloud[axis] for axis in "xyz"], axis=-1)
        return xyz[np.isfinite(xyz).all(axis=1)]

    def imu(self, sensor: str = "") -> ImuReading:
        """Measure with an inertial measurement unit (IMU) now; see ``scan`` for the rest."""
        orientation, *vectors = self._measured("imu", sensor)
        return ImuReading(None if orientation is None else np.array(orientation), *vectors)

    def distance_ahead(self) -> float:
        """Return the exact distance to the first thing ahead, m; infinite if there is none.

        It is measured along the x axis of the lidar, or of the root link if there is no lidar. The
        robot itself is not hit. There is no noise and no maximum range.
        """
        placed = self._simulation._sensed_world().placed
        lidars = [item for item in self._instruments if isinstance(item, LidarInstrument)]
        pose = lidars[0].pose(placed) if lidars else None
        pose = pose or placed.link(self._row, self.description.root_link)
        assert pose is not None
        links = self.description.link_names
        own_links = [placed.surroundings.target(self._row, link) for link in links]
        return self._simulation._distance(pose, _AHEAD, own_links)

    def __repr__(self) -> str:
        pose = self.pose
        x, y, yaw = (round(value, 3) + 0.0 for value in (pose.x, pose.y, pose.yaw))
        return f"{self._name or 'robot'} at x {x:.3f} m, y {y:.3f} m, yaw {yaw:.3f} rad"

    @property
    def _drive(self) -> Drive:
        """The robot's drive; a robot that stands raises OneBotError."""
        if (drive := self._controlled.drive) is None:
            raise OneBotError(f"{self.description.source}: the robot has no wheels to drive on")
        return drive

    @property
    def _controlled(self) -> ControlledRobot:
        return self._simulation._fleet.robots[self._row]

    def _equip(self, file: str, noisy: bool) -> None:
        """Set up the sensors of the description, and of a ``file``; "" for none."""
        controlled, simulation = self._controlled, self._simulation
        robot = SensedRobot(controlled.description, controlled.joints, controlled.held)
        simulation._sensors.enter(self._row, robot)
        sensors = list(controlled.description.sensors)
        if file:
            sensors += load_sensors(file, controlled.description).sensors
        space, rate, seed = f"/{self._name}", simulation._fleet.rate, simulation.seed
        self._instruments = [
            INSTRUMENTS[type(sensor.model)](sensor, self._row, space, rate, noisy, seed)
            for sensor in sensors
        ]

    def _instrument(self, output: str, name: str) -> Instrument[Any]:
        able = {
            item.sensor.name: item for item in self._instruments if output in item.sensor.topics
        }
        if not name and len(able) == 1:
            return next(iter(able.values()))
        if name not in able:
            text = f"name a sensor that measures {output}: {listing(able)}"
            if not self._instruments:
                text += "; Simulation(sensors=True) gives OneBot its sensors"
            raise OneBotError(text)
        return able[name]

    def _measured(self, output: str, sensor: str) -> Any:
        """Measure one output now, with a named sensor or the only one that has this output."""
        instrument = self._instrument(output, sensor)
        return instrument.measure(self._simulation._sensed_world(), {output})[output]


class _Named(dict[str, V]):
    """Values by name; an unknown name raises OneBotError."""

    def __init__(self, error: str, values: Mapping[str, V] | Iterable[tuple[str, V]]) -> None:
        """Take the values, and the error about a name, which replaces the braces in it."""
        super().__init__(values)
        self._error = error

    def __missing__(self, name: str) -> V:
        names = [known or "the only one, simulation.robot" for known in self]
        text = self._error.format(f'"{name}"')
        raise OneBotError(f"{text}{did_you_mean(str(name), names)}")


def _pose(transform: Transform) -> RobotPose:
    translation, rotation = transform
    return RobotPose(*translation, *to_rpy(rotation))


def _read(
    model: "str | Path | Description",
    arguments: XacroValues,
    world: "str | Path | Description",
    optional: bool,
) -> tuple[Description, Description | None]:
    """Return the robot and the world; two files are read at once, as xacro runs in processes."""
    with ThreadPoolExecutor(1) as executor:
        reading = executor.submit(_loaded_scene, world)
        description = _described(model, arguments, optional)
    return description, reading.result()


def _described(
    model: "str | Path | Description", arguments: XacroValues, optional: bool
) -> Description:
    """Return a model's description; ``optional``: with its optional sensors, if it has any."""
    if isinstance(model, Description):
        if arguments:
            raise OneBotError("arguments are for a xacro file; a Description has been expanded")
        return model
    if optional:
        names = [argument.name for argument in xacro_arguments(str(model)).arguments]
        arguments = {_SENSORS: "true", **arguments} if _SENSORS in names else arguments
    return load_description(model, arguments)


def _config(robot: str, values: Mapping[str, Any]) -> ControlConfig:
    with named(f"robots.{robot}") if robot else nullcontext():
        return ControlConfig.from_parameters(values)


def _member(name: str, description: Description, config: ControlConfig) -> Member:
    has_drive = bool(config.left_wheel_names) or has_wheels(description)
    return Member(description, config if has_drive else config.standing, name)


def _loaded_scene(world: "str | Path | Description") -> Description | None:
    if isinstance(world, Description):
        return world
    return load_world(str(world)) if str(world) else None


def _values(setup: RobotSetup, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a robot's controller, by name: OneBot's, then the given ones.

    Raises:
        ConfigError: a given parameter has no effect in a Simulation.
    """
    _check_effects(parameters)
    defaults = read_control_files([default_control_file()], "/", DRIVE_CONTROLLER)
    given = {name: plain(value) for name, value in parameters.items()}
    return {**defaults.values, **given, "x": setup.x, "y": setup.y, "yaw": setup.yaw}


def _check_effects(parameters: Mapping[str, Any]) -> None:
    """Raise ConfigError for parameters that have no effect in a Simulation."""
    text = "has no effect here; Simulation has arguments for what can be chosen"
    if problems := [Problem(name, text) for name in parameters if name in _WITHOUT_EFFECT]:
        raise ConfigError(problems)


def _goal(positions: Mapping[str, float], seconds: float) -> TrajectoryGoal:
    """Return a goal for joints, at which they are at rest after ``seconds``."""
    zeros = (0.0,) * len(positions)
    point = Waypoint(seconds, tuple(map(float, positions.values())), zeros, zeros)
    return TrajectoryGoal(tuple(positions), (point,))
