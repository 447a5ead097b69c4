"""Measures with the sensors of a world's robots, one measurement a call."""

import math
from collections.abc import Sequence, Set
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.driven_robot import Snapshot
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
_INFOS = frozenset({"camera_info", "depth_camera_info"})
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
        rate: measurements a second, Hz.
    """

    def __init__(
        self,
        sensor: Sensor,
        row: int,
        namespace: str,
        cycles: float,
        noisy: bool = True,
        seed: int = 0,
    ) -> None:
        """Prepare to measure at ``cycles`` control cycles a second, with the sensor's noise or not.

        The noise depends on the robot's ``namespace`` and the ``seed``.
        """
        self.sensor, self.row, self._noisy, self._seed = sensor, row, noisy, seed
        self.rate = measuring_rate(sensor, cycles)
        self._name = f"{namespace}/{sensor.link}/{sensor.name}"
        self._mount = matrix(sensor.origin)

    def reseed(self, seed: int) -> None:
        """Draw all noise anew, by another seed."""
        self._seed = seed
        self.__dict__.pop("_offsets", None)

    @cached_property
    def _rays(self) -> Rays:
        model = self.sensor.model
        assert not isinstance(model, Imu)
        return lidar.lidar_rays(model) if isinstance(model, Lidar) else camera.camera_rays(model)

    @cached_property
    def _offsets(self) -> Floats:
        """The offsets of the noise, drawn once: of an IMU of all six values."""
        model, once = self.sensor.model, noise_of(self._name, -1, self._seed)
        if isinstance(model, Camera):
            return np.zeros(1)
        noises = [model.noise] if isinstance(model, Lidar) else imu.noises(model)
        return np.array([bias(noise, once) for noise in noises])

    def pose(self, placed: Placed) -> LinkPose:
        """Return where the sensor is in the world."""
        link = placed.link(self.row, self.sensor.link)
        assert link is not None
        turn, at = self._mount[:3, :3], self._mount[:3, 3]
        return LinkPose(link.rotation @ turn, link.rotation @ at + link.position)

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        """Measure; return arrays by output, of those ``wanted``: keys of ``Sensor.topics``."""
        pose = self.pose(world.placed)
        generator = noise_of(self._name, world.frame.tick, self._seed) if self._noisy else None
        model = self.sensor.model
        if isinstance(model, Imu):
            return self._inertia(model, world, pose, generator)
        if isinstance(model, Lidar):
            return self._ranges(model, world, pose, wanted, generator)
        return self._picture(model, world, pose, wanted, generator)

    def _cast(self, world: SensedWorld, pose: LinkPose, reach: float) -> Hits:
        placed = world.placed
        own = placed.surroundings.target(self.row, self.sensor.link)
        return cast(self._rays, *pose, placed.surroundings.still, placed.targets, reach, [own])

    def _ranges(
        self,
        model: Lidar,
        world: SensedWorld,
        pose: LinkPose,
        wanted: Set[str],
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
        wanted: Set[str],
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


class Sensors:
    """The robots of a world as sensors see them, and what stands around them."""

    def __init__(self, world: Description | None, cycles: float, gravity: float) -> None:
        """Begin without robots.

        Args:
            world: what stands around them.
            cycles: control cycles a second, Hz.
            gravity: m/s^2.
        """
        self._world, self._cycles, self._gravity = world, cycles, gravity
        self._robots: tuple[SensedRobot, ...] = ()
        self._starts: Sequence[Quaternion] = ()
        self._built: tuple[Sequence[SensedRobot], Surroundings, camera.Painter] | None = None
        self._placed: SensedWorld | None = None

    def enter(self, row: int, robot: SensedRobot) -> None:
        """Have this robot in a row from now on."""
        last = self._robots[row] if row < len(self._robots) else None
        if last is None or last.description is not robot.description:  # else what is built stays
            self._robots = (*self._robots[:row], robot, *self._robots[row + 1 :])

    def restart(self) -> None:
        """Have the next frame be the first one."""
        self._starts, self._placed = (), None

    def frame(
        self,
        stamp: int,
        snapshots: Sequence[Snapshot],
        last: Sequence[Snapshot] | None,
        boxes: Sequence[Transform],
    ) -> Frame:
        """Return what can be sensed in a control cycle.

        Args:
            stamp: of the cycle, ns.
            snapshots: of the robots in it.
            last: those that were known last.
            boxes: poses of what can be pushed.
        """
        self._starts = self._starts or [snapshot.pose.rotation for snapshot in snapshots]
        tick = snapshots[0].tick
        before = last if last and last[0].tick == tick - 1 else None
        return Frame(tick, stamp, snapshots, before, boxes, self._robots, self._starts)

    def prepare(self) -> None:
        """Build the surroundings now, which takes long where meshes are read."""
        self._build(self._robots)

    def world(self, frame: Frame) -> SensedWorld:
        """Return the world at the time of a frame; of the same frame the same one."""
        if self._placed is None or self._placed.frame is not frame:
            surroundings, painter = self._build(frame.robots)
            states = [
                RobotState(*snapshot.pose, snapshot.joints.positions)
                for snapshot in frame.snapshots
            ]
            placed = Placed(surroundings, frame.boxes, states)
            period = 1.0 / self._cycles
            self._placed = SensedWorld(frame, placed, painter, period, self._gravity)
        return self._placed

    def _build(self, robots: Sequence[SensedRobot]) -> tuple[Surroundings, camera.Painter]:
        """Return the surroundings with these robots, built where they are other ones."""
        if self._built is None or self._built[0] is not robots:
            surroundings = Surroundings(self._world, robots)
            self._built = robots, surroundings, camera.Painter(surroundings.still)
        return self._built[1:]
