"""Measures with the sensors of a world's robots, in a thread of its own.

The control loop gives a snapshot when a sensor is due, and never waits. What is due while a sensor
still has enough to do is dropped, the newest first.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from onebot_control.control_loop import Divider
from onebot_control.driven_robot import Snapshot
from onebot_control.poses import Transform
from onebot_control.sensing import camera, imu, lidar
from onebot_control.sensing.noise import NoiseSource, add_noise, bias
from onebot_control.sensing.rays import NOTHING, Hits, Rays, cast
from onebot_control.sensing.scene import Placed, Pose, RobotState, Scene, SensedRobot, matrices
from onebot_control.simulation.bodies import matrix
from onebot_description.description import Description
from onebot_description.description.description import Camera, Imu, Lidar, Sensor
from onebot_description.model import quaternions

Floats = NDArray[np.float64]

# z ahead, x to the right, y down (REP-103), of a camera that looks along x.
_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_WAITING = {Imu: 50, Lidar: 4, Camera: 1}  # measurements of a sensor that may wait
_FIRST_REPORT, _REPORT = 10.0, 60.0  # s between reports of dropped measurements
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


class Outlet(Protocol):
    """Where measurements go."""

    def wanted(self) -> frozenset[str]:
        """Return the outputs that somebody wants: keys of ``Sensor.topics``."""

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        """Publish arrays by output, measured at ``stamp``, ns."""


class World(NamedTuple):
    """A scene at the time of a frame."""

    frame: Frame
    scene: Scene
    placed: Placed
    painter: camera.Painter
    period: float  # of a control cycle, s
    gravity: float  # m/s^2


class Instrument:
    """One sensor of one robot.

    Attributes:
        sensor: what it is.
        row: of its robot.
        divider: picks the control cycles in which it is due.
        given: measurements that the control thread has asked for.
        done: those that were made.
        dropped: those that were not asked for.
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
        """Prepare to measure.

        Args:
            sensor: of the description.
            row: of the robot in its fleet.
            namespace: of the robot; noise depends on it.
            outlet: takes the measurements.
            cycles: control cycles a second, Hz.
            noisy: add the noise of the description.
        """
        self.sensor, self.row, self._outlet, self._noisy = sensor, row, outlet, noisy
        self.rate = min(sensor.rate or cycles, cycles)
        self.divider = Divider(self.rate, cycles)
        self.given = self.done = self.dropped = 0
        self.waiting = _WAITING[type(sensor.model)]
        self._source = NoiseSource(f"{namespace}/{sensor.link}/{sensor.name}")
        self._mount = matrix(sensor.origin)

    @cached_property
    def _rays(self) -> Rays:
        model = self.sensor.model
        assert not isinstance(model, Imu)
        return lidar.lidar_rays(model) if isinstance(model, Lidar) else camera.camera_rays(model)

    @cached_property
    def _offsets(self) -> Floats:
        """The offsets of the noise, drawn once: of an IMU of all six values."""
        model, once = self.sensor.model, self._source.at(-1)
        if isinstance(model, Camera):
            return np.zeros(1)
        noises = (
            [model.noise]
            if isinstance(model, Lidar)
            else [*model.angular_velocity, *model.linear_acceleration]
        )
        return np.array([bias(noise, once) for noise in noises])

    def wanted(self) -> frozenset[str]:
        """Return the outputs that somebody wants."""
        return self._outlet.wanted()

    def measure(self, world: World, wanted: frozenset[str]) -> None:
        """Measure, and publish, the outputs ``wanted``."""
        link = world.placed.links[self.row][self.sensor.link]
        turn, at = self._mount[:3, :3], self._mount[:3, 3]
        pose = Pose(link.rotation @ turn, link.rotation @ at + link.position)
        generator = self._source.at(world.frame.tick) if self._noisy else None
        model = self.sensor.model
        if isinstance(model, Imu):
            outputs = self._inertia(model, world, pose, generator)
        elif isinstance(model, Lidar):
            outputs = self._ranges(model, world, pose, generator)
        else:
            outputs = self._picture(model, world, pose, wanted, generator)
        self._outlet.publish(world.frame.stamp, outputs)

    def _cast(self, world: World, pose: Pose, reach: float) -> Hits:
        own = world.scene.target(self.row, self.sensor.link)
        return cast(self._rays, *pose, world.scene.still, world.placed.targets, reach, own)

    def _ranges(
        self, model: Lidar, world: World, pose: Pose, generator: np.random.Generator | None
    ) -> dict[str, Any]:
        hits = self._cast(world, pose, lidar.reach(model))
        hit = hits.surfaces != NOTHING
        found = lidar.ranges(model, hits.distances, hit, self._offsets[0], generator)
        if "scan" in self.sensor.topics:
            return {"scan": found}
        seen = self._seen_from(world, pose, np.eye(3))
        return {"points": lidar.cloud(model, self._rays, found, seen)}

    def _picture(
        self,
        model: Camera,
        world: World,
        pose: Pose,
        wanted: frozenset[str],
        generator: np.random.Generator | None,
    ) -> dict[str, Any]:
        outputs: dict[str, Any] = {"camera_info": None}
        if wanted == {"camera_info"}:
            return outputs
        hits = self._cast(world, pose, camera.reach(model))
        if wanted & {"image", "points"} and "image" in self.sensor.topics:
            outputs["image"] = world.painter.picture(
                model, self._rays, pose.position, hits, world.placed.targets, generator
            )
        if wanted & {"depth", "points"}:
            outputs["depth"] = camera.depths(model, hits, generator)
        if "points" in wanted:
            seen = self._seen_from(world, pose, _OPTICAL)
            picture = outputs.get("image")
            outputs["points"] = camera.cloud(self._rays, outputs["depth"], picture, seen)
        return outputs

    def _seen_from(self, world: World, pose: Pose, otherwise: Floats) -> tuple[Floats, Floats]:
        """Return the sensor's pose in the frame of its messages; ``otherwise`` if it is no link."""
        frame = world.placed.links[self.row].get(self.sensor.frame)
        if frame is None:
            return otherwise, np.zeros(3)
        back = frame.rotation.T
        return back @ pose.rotation, back @ (pose.position - frame.position)

    def _inertia(
        self, model: Imu, world: World, pose: Pose, generator: np.random.Generator | None
    ) -> dict[str, Any]:
        frame = world.frame
        now = frame.snapshots[self.row]
        before = frame.before[self.row] if frame.before else None
        if before and _was_put(before, now, world.period):
            before = None
        body = matrices(now.pose.rotation[None])[0]
        mount = body.T @ pose.rotation, body.T @ (pose.position - now.pose.translation)
        values = np.concatenate(
            imu.measure(
                before and imu.Motion(*before.velocity),
                imu.Motion(*now.velocity),
                world.period,
                body,
                mount,
                world.gravity,
            )
        )
        if generator is not None:
            noises = [*model.angular_velocity, *model.linear_acceleration]
            for axis, noise in enumerate(noises):
                part = values[axis : axis + 1]
                part[:] = add_noise(part, noise, self._offsets[axis], generator)
        orientation = quaternions.from_rpy(quaternions.to_rpy(pose.rotation))
        return {"imu": (orientation, values[:3], values[3:])}


def _was_put(before: Snapshot, now: Snapshot, period: float) -> bool:
    """Whether a robot did not drive from one pose to the next; then it does not feel it."""
    shift = now.pose.translation - before.pose.translation
    speed = max(float(np.linalg.norm(each.velocity.linear)) for each in (before, now))
    return float(np.linalg.norm(shift)) > 2.0 * speed * period + _LEAP


class Sensing:
    """Measures what is due, in a thread.

    ``due``, ``take`` and ``enter`` are the control thread's.
    """

    def __init__(
        self,
        world: Description | None,
        cycles: float,
        gravity: float,
        warn: Callable[[str], object],
        failed: Callable[[BaseException], None],
    ) -> None:
        """Get ready; ``start`` starts the thread.

        Args:
            world: what stands around the robots.
            cycles: control cycles a second, Hz.
            gravity: m/s^2.
            warn: called with a text.
            failed: called with what has ended the thread.
        """
        self._world, self._cycles, self._gravity = world, cycles, gravity
        self._warn, self._failed = warn, failed
        self._robots: tuple[SensedRobot, ...] = ()
        self._instruments: dict[int, list[Instrument]] = {}
        self._due: list[Instrument] = []
        self._last: tuple[int, Sequence[Snapshot]] | None = None
        self._jobs: SimpleQueue[tuple[Instrument, Frame] | None] = SimpleQueue()
        self._reported: WeakKeyDictionary[Instrument, tuple[float, int, int]] = WeakKeyDictionary()
        self._scene: tuple[Sequence[SensedRobot], Scene, camera.Painter] | None = None
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="sensing", daemon=True)

    def start(self) -> None:
        """Start to measure.

        The scene of robots with sensors is built here: reading meshes would hold up the loop.
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
        known = self._robots[row] if row < len(self._robots) else None
        if known is None or known.description is not robot.description:  # else the scene stays
            self._robots = (*self._robots[:row], robot, *self._robots[row + 1 :])
        costs = list(_WAITING)
        self._instruments[row] = sorted(
            instruments, key=lambda each: costs.index(type(each.sensor.model))
        )

    def due(self, tick: int) -> frozenset[int]:
        """Return the rows of the robots of which a sensor is due in a control cycle."""
        self._due = []
        if self._last is None or self._last[0] != tick:  # else simulated time stands still
            for instruments in self._instruments.values():
                self._due += [each for each in instruments if each.divider.due()]
        return frozenset(each.row for each in self._due)

    def take(self, stamp: int, snapshots: Sequence[Snapshot], boxes: Sequence[Transform]) -> None:
        """Have what is due measured.

        Args:
            stamp: of the cycle, ns.
            snapshots: of all robots.
            boxes: poses of what can be pushed.
        """
        tick, last = snapshots[0].tick, self._last
        if self._due:
            before = last[1] if last and last[0] == tick - 1 else None
            frame = Frame(tick, stamp, snapshots, before, boxes, self._robots)
            for each in self._due:
                if each.given - each.done > each.waiting:
                    each.dropped += 1
                else:
                    each.given += 1
                    self._jobs.put((each, frame))
        self._last = tick, snapshots

    def _run(self) -> None:
        try:
            world: World | None = None
            while (job := self._jobs.get()) and not self._stopped:
                instrument, frame = job
                if wanted := instrument.wanted():
                    world = self._at(frame, world)
                    instrument.measure(world, wanted)
                instrument.done += 1
                self._report(instrument)
        except BaseException as error:
            self._failed(error)

    def _build(self, robots: Sequence[SensedRobot]) -> tuple[Scene, camera.Painter]:
        """Return the scene with these robots, which is built where they are other ones."""
        if self._scene is None or self._scene[0] is not robots:
            scene = Scene(self._world, robots)
            self._scene = robots, scene, camera.Painter(scene.still)
        return self._scene[1:]

    def _at(self, frame: Frame, last: World | None) -> World:
        """Return the world of a frame; ``last`` is that of the last one."""
        if last is not None and last.frame is frame:
            return last
        scene, painter = self._build(frame.robots)
        states = [RobotState(*each.pose, each.joints.positions) for each in frame.snapshots]
        placed = scene.place(frame.boxes, states)
        return World(frame, scene, placed, painter, 1.0 / self._cycles, self._gravity)

    def _report(self, instrument: Instrument) -> None:
        """Warn once a minute if measurements were dropped."""
        now, made, dropped = time.monotonic(), instrument.done, instrument.dropped
        self._reported.setdefault(instrument, (now - _REPORT + _FIRST_REPORT, 0, 0))
        since, before, dropped_before = self._reported[instrument]
        if now - since < _REPORT:
            return
        self._reported[instrument] = now, made, dropped
        made, dropped = made - before, dropped - dropped_before
        if dropped:
            reached = instrument.rate * made / (made + dropped)
            name = instrument.sensor.name
            text = f'sensor "{name}" reaches {reached:.3g} of {instrument.rate:g} Hz'
            self._warn(f"{text}: measuring takes too long; lower its rate or its size")
