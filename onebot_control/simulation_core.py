"""The core that a ``Simulation``, its robots and the ROS nodes in lockstep with it share.

It runs the control cycles of a fleet and keeps the data of the current simulated time: the state
that sensors measure, the contacts and the recorded moments. No ROS here.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from onebot_control.controlled_robot import Snapshot
from onebot_control.fleet import Fleet
from onebot_control.physics.contacts import Contact
from onebot_control.prepared_robot import Member
from onebot_control.sensing.instrument import Frame, Instrument, SensedWorld
from onebot_control.sensing.rays import Rays, cast
from onebot_control.sensing.sensors import INSTRUMENTS, Sensors
from onebot_control.sensing.surroundings import LinkPose, SensedRobot
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.description.loading import load_sensors
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Transform, Triple, to_rpy
from onebot_description.parameters.reader import leaves, read

_CLOSED = "this simulation has been closed; create a new one"
_REACH = 1e4  # m; rays end here
_AXES = ("x", "y", "z", "roll", "pitch", "yaw")


class Moment(NamedTuple):
    """The poses and joints of all robots at one time.

    Attributes:
        time: simulated time, s.
        stamp: the same time on ROS topics, ns: one control period later.
        poses: the robots' root links in the world, in the order of ``Simulation.robots``.
        joints: joint positions by name for each robot, rad or m.
        boxes: poses in the world of movable boxes, by link.
    """

    time: float
    stamp: int
    poses: Sequence[Transform]
    joints: Sequence[Mapping[str, float]]
    boxes: Mapping[str, Transform]


class MomentLog:
    """The last moments of a simulation.

    Attributes:
        every: control cycles from one moment to the next.
        moments: the moments, oldest first.
    """

    def __init__(self, every: int, limit: int | None) -> None:
        """Start empty; ``limit`` is the maximum number of moments kept, None for all."""
        self.every, self.moments = every, deque[Moment](maxlen=limit)

    def columns(self, robots: Sequence[str]) -> dict[str, Floats]:
        """Return the moments as arrays (N,), as described in ``Simulation.log``.

        Args:
            robots: names of the robots; the name of a single one is "".
        """
        rows = [self._row(moment, robots) for moment in self.moments]
        names = rows[0] if rows else ()
        return {name: np.array([row[name] for row in rows]) for name in names}

    def _row(self, moment: Moment, robots: Sequence[str]) -> dict[str, float]:
        row = {"time": moment.time}
        for name, pose, joints in zip(robots, moment.poses, moment.joints, strict=True):
            prefix = f"{name}." if name else ""
            row |= {f"{prefix}{key}": value for key, value in _named(pose)}
            row |= {f"{prefix}joints.{joint}": value for joint, value in joints.items()}
        for box, pose in moment.boxes.items():
            row |= {f"boxes.{box}.{key}": value for key, value in _named(pose)}
        return row


def _named(pose: Transform) -> Iterator[tuple[str, float]]:
    translation, rotation = pose
    return zip(_AXES, (*translation, *to_rpy(rotation)), strict=True)


def _built_by(kind: type[SimulationConfig], parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters that the construction of a world depends on, except start poses."""
    changeable = {leaf.name for leaf in leaves(kind) if not leaf.type.rule.read_only}
    changeable |= {"x", "y", "yaw"}
    return {name: value for name, value in parameters.items() if name not in changeable}


class SimulationCore:
    """A fleet with its sensors, whose time advances by control cycles.

    Attributes:
        fleet: the robots with their controllers, in one physics world.
        scene: the world around them; None for bare ground.
        sensors: robots and surroundings as sensors see them.
        instruments: the sensors of each robot.
        sensor_file: the file that added sensors to the robots; "" for none.
        noise: whether the sensors are noisy.
        seed: seed of the noise.
        names: the robots' names, in the order of the fleet; "" for a single robot.
        parameters: parameters of each robot's controller, by name.
        commands: the commanded velocity of each robot forward and to the left, m/s, and of turning
            to the left, rad/s, which is sent in every cycle; None if there was no command.
        after_cycle: functions that are called after each cycle, by any key.
        starts: number of starts, including restarts.
        publish: function that publishes the states at the start of a cycle and their stamp, ns, to
            ROS nodes in lockstep, and runs these nodes; None if there are none.
    """

    def __init__(
        self,
        members: Sequence[Member],
        parameters: Sequence[dict[str, Any]],
        scene: Description | None,
        *,
        sensor_file: str,
        noise: bool,
        seed: int,
    ) -> None:
        """Build the world, with the robots at rest.

        Args:
            members: the robots.
            parameters: parameters of each robot's controller, by name.
            scene: the world around the robots; None for bare ground.
            sensor_file: a URDF or xacro file with further sensors; "" for none.
            noise: whether sensors have the noise that the URDF specifies.
            seed: seed of the noise.

        Raises:
            OneBotError: a robot, its sensors or the scene cannot be simulated.
        """
        self.scene, self.sensor_file, self.noise, self.seed = scene, sensor_file, noise, seed
        self.names = [member.name for member in members]
        self.parameters, self._start_parameters = list(parameters), tuple(parameters)
        self.after_cycle: dict[object, Callable[[], object]] = {}
        self.publish: Callable[[Sequence[Snapshot], int], object] | None = None
        self._log: MomentLog | None = None
        self._is_closed, self.starts = False, 0
        self.fleet = fleet = Fleet.from_members(members, scene=scene)
        self.sensors = Sensors(scene, fleet.rate, fleet.world.settings.gravity)
        self.instruments = [self._instruments(row) for row in range(len(members))]
        self._begin()

    def _instruments(self, row: int) -> list[Instrument[Any]]:
        """Return the instruments of a robot's sensors."""
        robot, rate = self.fleet.robots[row], self.fleet.rate
        self.sensors.enter(row, SensedRobot(robot.description, robot.joints, robot.held))
        sensors = list(robot.description.sensors)
        if self.sensor_file:
            sensors += load_sensors(self.sensor_file, robot.description).sensors
        return [
            INSTRUMENTS[type(sensor.model)](
                sensor, row, f"/{self.names[row]}", rate, noisy=self.noise, seed=self.seed
            )
            for sensor in sensors
        ]

    def _begin(self) -> None:
        self.starts += 1
        self._frame: Frame | None = None
        self.commands: list[Triple | None] = [None] * len(self.names)
        self.sensors.restart()
        self.fleet.observe()
        self._current_frame()  # an IMU needs the orientation at the start

    @property
    def time(self) -> float:
        """Simulated time since the start, s."""
        return self.fleet.ticks / self.fleet.rate

    def require_open(self) -> None:
        """Raise a OneBotError if the world has been closed."""
        if self._is_closed:
            raise OneBotError(_CLOSED)

    def close(self) -> None:
        """Free the world; the states read last remain."""
        self.fleet.close()
        self.sensors.close()
        self._is_closed = True

    def restart(self, seed: int, parameters: Sequence[dict[str, Any]] | None = None) -> None:
        """Go back to the start.

        Args:
            seed: seed of the sensors' noise.
            parameters: new parameters of each robot's controller, including its start pose; other
                parameters that are read only at the start must not change. None to keep them.

        Raises:
            OneBotError: a robot cannot start there, or a value is wrong; nothing has changed.
        """
        values = self._start_parameters if parameters is None else tuple(parameters)
        configs = [
            robot.config if new is present else read(type(robot.config), new)
            for robot, new, present in zip(self.fleet.robots, values, self.parameters, strict=True)
        ]
        self.fleet.restart(configs)
        self._start_parameters, self.parameters = values, list(values)
        self.seed = seed
        for instruments in self.instruments:
            for instrument in instruments:
                instrument.reseed(seed)
        self._begin()
        if self._log is not None:
            self.record(self._log)

    def can_restart(self, members: Sequence[Member], parameters: Sequence[dict[str, Any]]) -> bool:
        """Return whether ``restart`` makes this world equal to a new one with these robots."""
        return all(
            member.description is robot.description
            and type(member.config) is type(robot.config)
            and _built_by(type(robot.config), new) == _built_by(type(robot.config), old)
            for robot, member, new, old in zip(
                self.fleet.robots, members, parameters, self._start_parameters, strict=True
            )
        )

    def configure(self, row: int, parameters: dict[str, Any]) -> None:
        """Set all parameters of a robot's controller, from the next cycle on.

        Raises:
            OneBotError: a value is wrong; nothing has changed.
        """
        robot = self.fleet.robots[row]
        robot.configure(read(type(robot.config), parameters))
        self.parameters[row] = parameters

    def cycle(self, *, last: bool) -> None:
        """Run one control cycle; afterwards, the robots' state is the one at its end.

        Args:
            last: whether it is the last cycle before its contacts can be read. They are recorded
                then, and in every cycle after they have been read once.
        """
        fleet = self.fleet
        for robot, command in zip(fleet.robots, self.commands, strict=True):
            if command is not None:
                linear, lateral, angular = command
                robot.accept(linear, angular, lateral=lateral)
        snapshots = fleet.begin()
        try:
            if self.publish is not None:
                self.publish(snapshots, fleet.stamp)
        finally:  # after an exception in a callback, the simulation can continue
            fleet.finish(recorded=last or None)
            fleet.observe()
            self.sensors.last, self._frame = snapshots, None
            if self._log is not None and fleet.ticks % self._log.every == 0:
                self._log.moments.append(self._moment())
        for function in [*self.after_cycle.values()]:
            function()

    def moved(self, row: int) -> None:
        """Read the state of a robot that was moved between two cycles."""
        self.fleet.robots[row].observe()
        self._frame = None

    def contacts(self, row: int) -> list[Contact]:
        """Return a robot's contacts in the last cycle; record them in every cycle from now on."""
        return self.fleet.world.contacts.contacts(row)

    def boxes(self) -> dict[str, Transform]:
        """Return the poses of the scene's movable boxes in the world, by link."""
        scene = self.fleet.world.scene
        return dict(zip(scene.links, scene.poses, strict=True)) if scene else {}

    def record(self, log: MomentLog) -> None:
        """Record moments in ``log``, beginning with the current one, in place of those in it."""
        self._log = log
        log.moments.clear()
        log.moments.append(self._moment())

    def _moment(self) -> Moment:
        robots = self.fleet.robots
        snapshots = [robot.snapshot() for robot in robots]
        return Moment(
            self.time,
            self.fleet.stamp,
            [snapshot.pose for snapshot in snapshots],
            [
                {**robot.held, **dict(zip(robot.joints, snapshot.joints.positions, strict=True))}
                for robot, snapshot in zip(robots, snapshots, strict=True)
            ],
            self.boxes(),
        )

    def sensed(self) -> SensedWorld:
        """Return the world as it is now, for sensors; the first time, their meshes are read."""
        return self.sensors.world(self._current_frame())

    def _current_frame(self) -> Frame:
        if self._frame is None:
            scene = self.fleet.world.scene
            snapshots = [robot.snapshot() for robot in self.fleet.robots]
            boxes = scene.poses if scene else ()
            self._frame = self.sensors.frame(self.fleet.stamp, snapshots, boxes)
        return self._frame

    def distance(self, pose: LinkPose, ray: Rays, skipped: Sequence[int] = ()) -> float:
        """Return the distance from ``pose`` to the first thing on a ray, m; infinite for none.

        Args:
            pose: where the ray begins, in the world.
            ray: a single ray, in this frame.
            skipped: indices of targets to ignore.
        """
        placed = self.sensed().placed
        still, targets = placed.surroundings.still, placed.targets
        distance = float(cast(ray, *pose, still, targets, _REACH, skipped).distances[0])
        return distance if distance < _REACH else math.inf
