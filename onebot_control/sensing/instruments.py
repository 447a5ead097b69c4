"""Measures with the sensors of a world's robots, in a thread of its own.

The control loop gives a snapshot when a measurement is due that somebody subscribes to, and never
waits. What is due while a sensor still has enough to do is dropped, the newest first.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_control.driven_robot import Snapshot
from onebot_control.nodes.control_loop import Divider
from onebot_control.physics.bodies import matrix
from onebot_control.poses import Quaternion, Transform
from onebot_control.sensing import camera, imu, lidar
from onebot_control.sensing.noise import add_noise, bias, noise_of
from onebot_control.sensing.rays import NOTHING, Hits, Rays, cast
from onebot_control.sensing.surroundings import (
    LinkPose,
    Placed,
    RobotState,
    SensedRobot,
    Surroundings,
)
from onebot_description.description import Description
from onebot_description.description.description import Camera, Imu, Lidar, Sensor
from onebot_description.model import quaternions

Floats = NDArray[np.float64]

# z ahead, x to the right, y down (REP-103), of a camera that looks along x.
_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
# Measurements of a sensor that may wait, in the order in which those of a robot are made.
_WAITING = {Imu: 50, Lidar: 4, Camera: 1}
_INFOS = frozenset({"camera_info", "depth_camera_info"})
_FIRST_REPORT, _REPORT = 10.0, 60.0  # s between reports of dropped measurements
_ENOUGH = 0.95  # share of the measurements due; a smaller one is reported
_PATIENCE = 10.0  # s for the thread to end
_LEAP = 0.01  # m: a robot that has moved farther than by its speed was put there


class Frame(NamedTuple):
    """All that can be sensed in one control cycle."""

    tick: int
    stamp: int  # ns
    snapshots: Sequence[Snapshot]
    before: Sequence[Snapshot] | None  # a cycle ago; None if that is not known
    boxes: Sequence[Transform]
    robots: Sequence[SensedRobot]
    starts: Sequence[Quaternion]  # rotations of the robots in the first cycle


class Outlet(Protocol):
    """Where measurements go."""

    def wanted(self) -> frozenset[str]:
        """Return the outputs that somebody wants: keys of ``Sensor.topics``."""

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish arrays by output, measured at ``stamp``, ns."""


class SensedWorld(NamedTuple):
    """A world at the time of a frame."""

    frame: Frame
    placed: Placed
    painter: camera.Painter
    period: float  # control cycle, s
    gravity: float  # m/s^2


def measuring_rate(sensor: Sensor, cycles: float) -> float:
    """Return how often a sensor measures, Hz; one without a rate does in each control cycle."""
    return min(sensor.rate or cycles, cycles)


class Instrument:
    """One sensor of one robot.

    Attributes:
        sensor: what it is.
        row: the robot's in its fleet.
        outlet: takes the measurements.
        divider: picks the control cycles in which it is due.
        given: measurements that the control thread has asked for.
        done: those that were made.
        dropped: those that were not asked for, although somebody subscribes to them.
    """

    def __init__(
        self,
        sensor: Sensor,
        row: int,
        namespace: str,
        outlet: Outlet,
        cycles: float,
        noisy: bool = True,
    ) -> None:
        """Prepare to measure at ``cycles`` control cycles a second, with the sensor's noise or not.

        The noise depends on the robot's ``namespace``.
        """
        self.sensor, self.row, self.outlet, self._noisy = sensor, row, outlet, noisy
        self._rate = measuring_rate(sensor, cycles)
        self.divider = Divider(self._rate, cycles)
        self.given = self.done = self.dropped = 0
        self._next_report, self._reported = 0.0, (0, 0)  # monotonic s; done and dropped before
        self._name = f"{namespace}/{sensor.link}/{sensor.name}"
        self._mount = matrix(sensor.origin)

    @property
    def busy(self) -> bool:
        """Whether no more measurements may wait."""
        return self.given - self.done > _WAITING[type(self.sensor.model)]

    def warning(self, now: float) -> str:
        """Return what to warn of at a time, s: once a minute, if too few measurements were made."""
        self._next_report = self._next_report or now + _FIRST_REPORT
        if now < self._next_report:
            return ""
        done, dropped = self.done - self._reported[0], self.dropped - self._reported[1]
        self._next_report, self._reported = now + _REPORT, (self.done, self.dropped)
        share = done / (done + dropped)
        if share >= _ENOUGH:
            return ""
        text = f'sensor "{self.sensor.name}" reaches {share * self._rate:.3g} of {self._rate:g} Hz'
        return f"{text}: measuring takes too long; lower its rate or its size"

    @cached_property
    def _rays(self) -> Rays:
        model = self.sensor.model
        assert not isinstance(model, Imu)
        return lidar.lidar_rays(model) if isinstance(model, Lidar) else camera.camera_rays(model)

    @cached_property
    def _offsets(self) -> Floats:
        """The offsets of the noise, drawn once: of an IMU of all six values."""
        model, once = self.sensor.model, noise_of(self._name, -1)
        if isinstance(model, Camera):
            return np.zeros(1)
        noises = [model.noise] if isinstance(model, Lidar) else imu.noises(model)
        return np.array([bias(noise, once) for noise in noises])

    def measure(self, world: SensedWorld, wanted: frozenset[str]) -> None:
        """Measure, and publish, the outputs ``wanted``."""
        link = world.placed.link(self.row, self.sensor.link)
        assert link is not None
        turn, at = self._mount[:3, :3], self._mount[:3, 3]
        pose = LinkPose(link.rotation @ turn, link.rotation @ at + link.position)
        generator = noise_of(self._name, world.frame.tick) if self._noisy else None
        model = self.sensor.model
        if isinstance(model, Imu):
            outputs = self._inertia(model, world, pose, generator)
        elif isinstance(model, Lidar):
            outputs = self._ranges(model, world, pose, wanted, generator)
        else:
            outputs = self._picture(model, world, pose, wanted, generator)
        self.outlet.publish(world.frame.stamp, outputs)

    def _cast(self, world: SensedWorld, pose: LinkPose, reach: float) -> Hits:
        placed = world.placed
        own_target = placed.surroundings.target(self.row, self.sensor.link)
        return cast(self._rays, *pose, placed.surroundings.still, placed.targets, reach, own_target)

    def _ranges(
        self,
        model: Lidar,
        world: SensedWorld,
        pose: LinkPose,
        wanted: frozenset[str],
        generator: "np.random.Generator | None",
    ) -> dict[str, Any]:
        hits = self._cast(world, pose, lidar.reach(model))
        hit = hits.surfaces != NOTHING
        ranges = lidar.ranges(model, hits.distances, hit, self._offsets[0], generator)
        outputs = dict[str, Any]()
        if "scan" in wanted:
            outputs["scan"] = lidar.middle_row(model, ranges)
        if "range" in wanted:
            outputs["range"] = ranges.min()
        for output in wanted & {"points", "point_cloud"}:
            seen_from = self._seen_from(world, pose, np.eye(3))
            outputs[output] = lidar.cloud(model, self._rays, ranges, seen_from)
        return outputs

    def _picture(
        self,
        model: Camera,
        world: SensedWorld,
        pose: LinkPose,
        wanted: frozenset[str],
        generator: "np.random.Generator | None",
    ) -> dict[str, Any]:
        outputs: dict[str, Any] = dict.fromkeys(self.sensor.topics.keys() & _INFOS)
        if wanted <= _INFOS:
            return outputs
        hits = self._cast(world, pose, camera.reach(model))
        if wanted & {"image", "points"} and "image" in self.sensor.topics:
            outputs["image"] = world.painter.picture(
                model, self._rays, pose.position, hits, world.placed.targets, generator
            )
        if wanted & {"depth", "points"}:
            outputs["depth"] = camera.depths(model, hits, generator)
        if "points" in wanted:
            seen_from = self._seen_from(world, pose, _OPTICAL)
            picture = outputs.get("image")
            outputs["points"] = camera.cloud(
                self._rays, outputs["depth"], picture, seen_from, model.blank
            )
        return outputs

    def _seen_from(
        self, world: SensedWorld, pose: LinkPose, otherwise: Floats
    ) -> tuple[Floats, Floats]:
        """Return the sensor's pose in the frame of its messages; ``otherwise`` if it is no link."""
        frame = world.placed.link(self.row, self.sensor.frame)
        if frame is None:
            return otherwise, np.zeros(3)
        back = frame.rotation.T
        return back @ pose.rotation, back @ (pose.position - frame.position)

    def _inertia(
        self,
        model: Imu,
        world: SensedWorld,
        pose: LinkPose,
        generator: "np.random.Generator | None",
    ) -> dict[str, Any]:
        frame = world.frame
        now = frame.snapshots[self.row]
        previous = frame.before[self.row] if frame.before else None
        if previous and _was_put(previous, now, world.period):
            previous = None
        motion = _motion(now)
        body = motion.rotation
        mount = body.T @ pose.rotation, body.T @ (pose.position - np.array(now.pose.translation))
        values = np.concatenate(
            imu.measure(previous and _motion(previous), motion, world.period, mount, world.gravity)
        )
        if generator is not None:
            for axis, noise in enumerate(imu.noises(model)):
                part = values[axis : axis + 1]
                part[:] = add_noise(part, noise, self._offsets[axis], generator)
        start = frame.starts[self.row]
        return {"imu": (imu.orientation(model, pose.rotation, start), values[:3], values[3:])}


def _motion(snapshot: Snapshot) -> imu.Motion:
    linear, angular = map(np.array, snapshot.velocity)
    return imu.Motion(linear, angular, quaternions.to_matrix(snapshot.pose.rotation))


def _was_put(before: Snapshot, now: Snapshot, period: float) -> bool:
    """Whether a robot did not drive from one pose to the next; then it does not feel it."""
    shift = math.dist(now.pose.translation, before.pose.translation)
    speed = max(math.hypot(*snapshot.velocity.linear) for snapshot in (before, now))
    return shift > 2.0 * speed * period + _LEAP


class Sensing:
    """Measures in a thread; ``due``, ``take`` and ``enter`` are the control thread's."""

    def __init__(
        self,
        world: Description | None,
        cycles: float,
        gravity: float,
        warn: Callable[[str], object],
        failed: Callable[[BaseException], None],
    ) -> None:
        """Get ready; ``start`` starts the thread, and ``failed`` gets the error that ends it.

        ``world`` is what stands around the robots; ``cycles`` is in Hz, ``gravity`` in m/s^2.
        """
        self._world, self._cycles, self._gravity = world, cycles, gravity
        self._warn, self._failed = warn, failed
        self._robots: tuple[SensedRobot, ...] = ()
        self._instruments: dict[int, list[Instrument]] = {}
        self._due: list[tuple[Instrument, frozenset[str]]] = []
        self._last: tuple[int, Sequence[Snapshot]] | None = None
        self._starts: Sequence[Quaternion] = ()
        self._jobs: SimpleQueue[tuple[Instrument, frozenset[str], Frame] | None] = SimpleQueue()
        self._built: tuple[Sequence[SensedRobot], Surroundings, camera.Painter] | None = None
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="sensing", daemon=True)

    def start(self) -> None:
        """Start to measure.

        The surroundings of robots with sensors are built here: reading meshes would hold up the
        loop.
        """
        if any(self._instruments.values()):
            self._build(self._robots)
        self._thread.start()

    def stop(self) -> None:
        """End the thread after what it is measuring."""
        self._stopped = True
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def enter(self, row: int, robot: SensedRobot, instruments: Sequence[Instrument]) -> None:
        """Sense with these ``instruments`` of the robot of ``row`` from now on."""
        last = self._robots[row] if row < len(self._robots) else None
        if last is None or last.description is not robot.description:  # else what is built stays
            self._robots = (*self._robots[:row], robot, *self._robots[row + 1 :])
        order = list(_WAITING)
        self._instruments[row] = sorted(
            instruments, key=lambda instrument: order.index(type(instrument.sensor.model))
        )

    def due(self, tick: int) -> frozenset[int]:
        """Return the rows of the robots of which measurements are due in a control cycle."""
        self._due = []
        if self._last is None or self._last[0] != tick:  # else simulated time stands still
            for instruments in self._instruments.values():
                for instrument in instruments:
                    if instrument.divider.due() and (topics := instrument.outlet.wanted()):
                        self._due.append((instrument, topics))
        return frozenset(instrument.row for instrument, _ in self._due)

    def take(self, stamp: int, snapshots: Sequence[Snapshot], boxes: Sequence[Transform]) -> None:
        """Have what is due measured at a stamp, ns; ``boxes`` are poses of what can be pushed."""
        tick, last = snapshots[0].tick, self._last
        self._starts = self._starts or [snapshot.pose.rotation for snapshot in snapshots]
        if self._due:
            previous = last[1] if last and last[0] == tick - 1 else None
            frame = Frame(tick, stamp, snapshots, previous, boxes, self._robots, self._starts)
            for instrument, topics in self._due:
                if instrument.busy:
                    instrument.dropped += 1
                else:
                    instrument.given += 1
                    self._jobs.put((instrument, topics, frame))
        self._last = tick, snapshots

    def _run(self) -> None:
        try:
            world: SensedWorld | None = None
            while (job := self._jobs.get()) and not self._stopped:
                instrument, topics, frame = job
                if world is None or world.frame is not frame:
                    world = self._world_of(frame)
                instrument.measure(world, topics)
                instrument.done += 1
                if text := instrument.warning(time.monotonic()):
                    self._warn(text)
        except BaseException as error:
            self._failed(error)

    def _build(self, robots: Sequence[SensedRobot]) -> tuple[Surroundings, camera.Painter]:
        """Return the surroundings with these robots, built where they are other ones."""
        if self._built is None or self._built[0] is not robots:
            surroundings = Surroundings(self._world, robots)
            self._built = robots, surroundings, camera.Painter(surroundings.still)
        return self._built[1:]

    def _world_of(self, frame: Frame) -> SensedWorld:
        surroundings, painter = self._build(frame.robots)
        states = [
            RobotState(*snapshot.pose, snapshot.joints.positions) for snapshot in frame.snapshots
        ]
        placed = Placed(surroundings, frame.boxes, states)
        return SensedWorld(frame, placed, painter, 1.0 / self._cycles, self._gravity)
