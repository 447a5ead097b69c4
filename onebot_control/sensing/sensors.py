"""Measures with the sensors of a world's robots, one measurement per call."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from onebot_control.controlled_robot import Snapshot
from onebot_control.physics.contacts import Contact
from onebot_control.sensing.camera import CameraInstrument
from onebot_control.sensing.contact import ContactInstrument
from onebot_control.sensing.imu import ImuInstrument
from onebot_control.sensing.instrument import Frame, Instrument, SensedWorld
from onebot_control.sensing.lidar import LidarInstrument
from onebot_control.sensing.painter import Painter
from onebot_control.sensing.surroundings import (
    Placed,
    SensedRobot,
    VisibleSurfaces,
)
from onebot_description.description import Description
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.contact import ContactSensor
from onebot_description.description.sensors.imu import Imu
from onebot_description.description.sensors.lidar import Lidar
from onebot_description.elements.sensor import SensorModel
from onebot_description.geometry.poses import Quaternion, Transform

INSTRUMENTS: Mapping[type[SensorModel], type[Instrument[Any]]] = {
    Lidar: LidarInstrument,
    Camera: CameraInstrument,
    Imu: ImuInstrument,
    ContactSensor: ContactInstrument,
}
"""The class of instruments for each sensor model."""


class Sensors:
    """Keeps the robots and surroundings of a world up to date for its sensors.

    Attributes:
        last: snapshots of the robots in the last cycle; None if there were none.
    """

    def __init__(self, world: Description | None, cycles: float, gravity: float) -> None:
        """Start without robots.

        Args:
            world: the scene around the robots; None on bare ground.
            cycles: control cycles per second, Hz.
            gravity: downwards, m/s^2.
        """
        self._world, self._cycles, self._gravity = world, cycles, gravity
        self._robots: tuple[SensedRobot, ...] = ()
        self._built: tuple[Sequence[SensedRobot], VisibleSurfaces, Painter] | None = None
        self._starts: Sequence[Quaternion]
        self._placed: SensedWorld | None
        self.last: Sequence[Snapshot] | None
        self.restart()

    def enter(self, row: int, robot: SensedRobot) -> None:
        """Set the robot of a row; if it is new, the surroundings are rebuilt."""
        last = self._robots[row] if row < len(self._robots) else None
        if last is None or last.description is not robot.description:
            self._robots = (*self._robots[:row], robot, *self._robots[row + 1 :])
            self.last = None  # there is no motion between two different robots

    def restart(self) -> None:
        """Restart: the next frame is the first one."""
        self._starts, self._placed, self.last = (), None, None

    def close(self) -> None:
        """Free the surroundings, which take the most memory of a simulation."""
        self._built = self._placed = None

    def frame(
        self,
        stamp: int,
        snapshots: Sequence[Snapshot],
        boxes: Sequence[Transform],
        contacts: Mapping[int, Sequence[Contact]] = MappingProxyType({}),
    ) -> Frame:
        """Return the frame of a control cycle.

        Args:
            stamp: stamp of the cycle, ns.
            snapshots: snapshots of the robots in this cycle.
            boxes: poses of movable boxes in the world.
            contacts: contacts of robots in the last cycle, by their indices in the fleet.
        """
        self._starts = self._starts or [snapshot.pose.rotation for snapshot in snapshots]
        tick = snapshots[0].tick
        return Frame(
            tick=tick,
            stamp=stamp,
            snapshots=snapshots,
            before=self.last if self.last and self.last[0].tick == tick - 1 else None,
            boxes=boxes,
            robots=self._robots,
            starts=self._starts,
            contacts=contacts,
        )

    def prepare(self) -> None:
        """Build the surroundings now, because reading meshes takes a long time."""
        self._build(self._robots)

    def world(self, frame: Frame) -> SensedWorld:
        """Return the world at the time of a frame; it is cached for the last frame."""
        if self._placed is None or self._placed.frame is not frame:
            surroundings, painter = self._build(frame.robots)
            states = [(snapshot.pose, snapshot.joints.positions) for snapshot in frame.snapshots]
            placed = Placed(surroundings, frame.boxes, states)
            period = 1.0 / self._cycles
            self._placed = SensedWorld(frame, placed, painter, period, self._gravity)
        return self._placed

    def _build(self, robots: Sequence[SensedRobot]) -> tuple[VisibleSurfaces, Painter]:
        """Return the surroundings of these robots, rebuilt if the robots have changed."""
        if self._built is None or self._built[0] is not robots:
            surroundings = VisibleSurfaces(self._world, robots)
            self._built = robots, surroundings, Painter(surroundings.still)
        return self._built[1:]
