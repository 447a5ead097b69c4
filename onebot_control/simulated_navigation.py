"""Drives a robot of a ``Simulation`` to goals, using its own scans, odometry and IMU."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from onebot_control.drive.controller_limits import ControllerLimits
from onebot_control.sensing.imu import ImuInstrument
from onebot_control.sensing.instrument import Instrument
from onebot_control.sensing.lidar import LidarInstrument
from onebot_control.simulation_core import SimulationCore
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import PlanarPose
from onebot_description.model.robot_model import RobotModel
from onebot_description.parameters.arguments import checked_methods
from onebot_description.parameters.reader import values_of

if TYPE_CHECKING:  # the first goal imports the modules that need scipy
    from onebot_control.navigation.grid import LevelScan
    from onebot_control.navigation.navigator import Navigator

_MIN_RAYS = 30  # minimum number of rays of a lidar that can build a map


@checked_methods(before=lambda self: self._core().require_open())
class SimulatedNavigation:
    """Drives one robot of a simulation to goals; use it as ``robot.navigation``.

    It sees the world with the robot's lidar, and localizes the robot by matching scans, starting
    from wheel odometry and the rotation that the IMU measures, if there is one. It knows the true
    pose only at the start, and after a teleport.
    """

    def __init__(self, core: Callable[[], SimulationCore], row: int) -> None:
        """Take a robot of a world, which ``core`` returns; nothing is read until the first goal."""
        self._core, self._row = core, row
        self._begin()

    def _begin(self) -> None:
        core = self._core()
        values = core.parameters[self._row]
        # The pose of the odometry frame in the world when the robot was last placed.
        self._origin = PlanarPose(*(float(values.get(name, 0.0)) for name in ("x", "y", "yaw")))
        self._began = core, core.starts
        self._made: Navigator | None = None

    @property
    def _navigator(self) -> "Navigator | None":
        """The navigator; None if there was no goal since the start of the simulation."""
        if self._began != (self._core(), self._core().starts):
            self._begin()
        return self._made

    @property
    def status(self) -> str:
        """One of idle, driving, blocked, recovering, arrived, cancelled, failed."""
        return self._navigator.status if self._navigator else "idle"

    @property
    def reason(self) -> str:
        """One sentence about the status; may be empty."""
        return self._navigator.reason if self._navigator else ""

    @property
    def navigating(self) -> bool:
        """Whether there is a goal that has not ended."""
        return self._navigator is not None and self._navigator.navigating

    @property
    def navigator(self) -> "Navigator":
        """The navigator, with its map, its pose in it and its costs.

        Raises:
            OneBotError: the robot has no wheels, no level lidar or no shape.
        """
        self._made = self._navigator or self._make()
        return self._made

    @property
    def path(self) -> Floats:
        """Points of the path to the goal, (N, 2), in the world, m; N = 0 without a goal."""
        return self._navigator.path if self._navigator else np.zeros((0, 2))

    def go_to(self, x: float, y: float, yaw: float | None = None) -> None:
        """Drive to a point in the world, m, with a heading there, rad; None for any heading.

        Raises:
            OneBotError: see ``navigator``.
        """
        self.navigator.go_to(x, y, yaw)
        self._core().after_cycle[self] = self._step

    def cancel(self, reason: str = "the goal was cancelled") -> None:
        """End the goal, if there is one; the robot brakes."""
        if self._navigator is not None and self._navigator.navigating:
            self._navigator.cancel(reason)
            self._finish()

    def place(self, pose: PlanarPose) -> None:
        """Accept that the robot was placed at a pose in the world."""
        if self._navigator is not None:
            self._navigator.place(pose)
        self._origin = pose.compose(self._odometry().inverse())

    def _make(self) -> "Navigator":
        from onebot_control.navigation.footprint import vehicle_of
        from onebot_control.navigation.grid import is_level
        from onebot_control.navigation.navigator import Navigator

        core = self._core()
        robot = core.fleet.robots[self._row]
        source = robot.description.source
        if robot.drive is None:
            raise OneBotError(f"{source}: the robot has no wheels to drive on")
        lidars = [
            (item.model.horizontal.upper - item.model.horizontal.lower, item, pose)
            for item, pose in self._mounted(LidarInstrument)
            if is_level(pose) and item.model.horizontal.samples >= _MIN_RAYS
        ]
        if not lidars:
            text = "the robot has no level lidar, which navigation needs"
            if not core.instruments[self._row]:
                text += "; Simulation(sensors=True) gives OneBot its sensors"
            raise OneBotError(f"{source}: {text}")
        _, self._lidar, self._mount = max(lidars, key=lambda each: each[0])
        # Wheels that do not skid measure rotation more exactly than an IMU.
        imus = self._mounted(ImuInstrument) if robot.drive.wheels.skids else []
        self._imu = imus[0] if imus else None
        limits = ControllerLimits.from_parameters("", values_of(robot.drive.config))
        assert limits is not None
        minimum_radius = getattr(robot.drive.geometry, "minimum_radius", 0.0)
        vehicle = vehicle_of(robot.description, [replace(limits, minimum_radius=minimum_radius)])
        navigator = Navigator(vehicle, self._origin.compose(self._odometry()))
        rate = core.fleet.rate
        self._every = max(1, round(rate / navigator.parameters.controller_frequency))
        self._scan_every = self._every * max(1, round(rate / self._lidar.rate / self._every))
        self._cycles, self._turn = 0, 0.0
        return navigator

    def _mounted(self, kind: type[Instrument[Any]]) -> list[tuple[Any, Floats]]:
        """Return the robot's sensors of a kind, with their poses (4, 4) in the root link."""
        description = self._core().fleet.robots[self._row].description
        links = RobotModel.from_description(description).link_matrices({})
        return [
            (item, links[item.sensor.link] @ matrices.of_origin(item.sensor.origin))
            for item in self._core().instruments[self._row]
            if isinstance(item, kind)
        ]

    def _odometry(self) -> PlanarPose:
        drive = self._core().fleet.robots[self._row].drive
        return drive.odometry.pose if drive else PlanarPose()

    def _scan(self) -> "LevelScan":
        from onebot_control.navigation.grid import LevelScan

        fan = self._lidar.model.horizontal
        ranges: Any = self._lidar.measure(self._core().sensed(), {"scan"})["scan"]
        step = (fan.upper - fan.lower) / (fan.samples - 1)
        return LevelScan.mounted(ranges, fan.lower, step, self._lidar.model.range_max, self._mount)

    def _step(self) -> None:
        """Take measurements after a control cycle, and command the next cycles."""
        core, navigator = self._core(), self._navigator
        if navigator is None:  # the simulation was reset
            core.after_cycle.pop(self, None)
            return
        if self._imu is not None:
            imu, pose = self._imu
            _, rates, _ = imu.measure(core.sensed(), {"imu"})["imu"]
            self._turn += float(pose[2, :3] @ rates) * core.fleet.period
        self._cycles += 1
        if self._cycles % self._every:
            return
        turn, self._turn = self._turn if self._imu else None, 0.0
        drive = core.fleet.robots[self._row].drive
        assert drive is not None
        scan = None if (self._cycles - self._every) % self._scan_every else self._scan()
        odometry, speed = drive.odometry.pose, drive.odometry.twist
        command = navigator.update(core.time, odometry, speed, scan=scan, turn=turn)
        if navigator.navigating:
            core.commands[self._row] = command
        else:
            self._finish()

    def _finish(self) -> None:
        """Brake, and release the robot for other commands."""
        self._core().after_cycle.pop(self, None)
        self._core().commands[self._row] = None
        self._core().fleet.robots[self._row].accept(0.0, 0.0)
