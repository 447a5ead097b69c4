"""Measures with the sensors of a world's robots, one measurement per call."""

import math
from collections.abc import Sequence, Set
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from onebot_control.controlled_robot import Snapshot
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
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.description.description import Camera, Imu, Lidar, Sensor
from onebot_description.geometry import matrices, quaternions
from onebot_description.geometry.poses import Quaternion, Transform

# Rotation of a camera that looks along x, in its optical frame: z ahead, x right, y down (REP-103).
_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_INFOS = frozenset({"camera_info", "depth_camera_info"})
_LEAP = 0.01  # m; a robot that has moved this much farther than by its speed was teleported


class Frame(NamedTuple):
    """The state of a world in one control cycle, for its sensors."""

    tick: int  # control cycles done before this one
    stamp: int  # of the cycle, ns
    snapshots: Sequence[Snapshot]  # of the robots
    before: Sequence[Snapshot] | None  # one cycle ago; None if not known
    boxes: Sequence[Transform]  # poses of movable boxes
    robots: Sequence[SensedRobot]
    starts: Sequence[Quaternion]  # rotations of the robots in the first cycle


class SensedWorld(NamedTuple):
    """The surroundings at the time of a frame, to measure in."""

    frame: Frame
    placed: Placed
    painter: camera.Painter
    period: float  # control cycle, s
    gravity: float  # m/s^2


def measuring_rate(sensor: Sensor, cycles: float) -> float:
    """Return how often a sensor measures, Hz: at its rate, or in each of ``cycles`` per second."""
    return min(sensor.rate or cycles, cycles)


class Instrument:
    """Measures with one sensor of one robot.

    Attributes:
        sensor: the sensor's description.
        row: index of the robot in its fleet.
        rate: measurements per simulated second, Hz.
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
        """Prepare to measure.

        Args:
            sensor: the sensor's description.
            row: index of the robot in its fleet.
            namespace: of the robot; the noise depends on it.
            cycles: control cycles per second, Hz.
            noisy: whether measurements have the sensor's noise.
            seed: of the noise.
        """
        self.sensor, self.row, self._noisy, self._seed = sensor, row, noisy, seed
        self.rate = measuring_rate(sensor, cycles)
        self._name = f"{namespace}/{sensor.link}/{sensor.name}"
        self._mount = matrices.of_origin(sensor.origin)

    def reseed(self, seed: int) -> None:
        """Use another seed for all noise from now on."""
        self._seed = seed
        self.__dict__.pop("_offsets", None)

    @cached_property
    def _rays(self) -> Rays:
        model = self.sensor.model
        assert not isinstance(model, Imu)
        return lidar.lidar_rays(model) if isinstance(model, Lidar) else camera.camera_rays(model)

    @cached_property
    def _offsets(self) -> Floats:
        """The constant offsets of the noise: one, or six for the values of an IMU."""
        model, once = self.sensor.model, noise_of(self._name, -1, self._seed)
        if isinstance(model, Camera):
            return np.zeros(1)
        noises = [model.noise] if isinstance(model, Lidar) else imu.noises(model)
        return np.array([bias(noise, once) for noise in noises])

    def pose(self, placed: Placed) -> LinkPose:
        """Return the pose of the sensor in the world."""
        link = placed.link(self.row, self.sensor.link)
        assert link is not None
        turn, at = self._mount[:3, :3], self._mount[:3, 3]
        return LinkPose(link.rotation @ turn, link.rotation @ at + link.position)

    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        """Measure with the sensor.

        Args:
            world: to measure in.
            wanted: the outputs to compute, keys of ``Sensor.topics``.

        Returns:
            At least the wanted outputs, by name.
        """
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
        """Return the sensor's pose in its messages' frame; if that is no link, ``otherwise``."""
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
    """Return whether a robot was teleported between two cycles, which its IMU does not feel."""
    shift = math.dist(now.pose.translation, before.pose.translation)
    speed = max(math.hypot(*snapshot.velocity.linear) for snapshot in (before, now))
    return shift > 2.0 * speed * period + _LEAP


class Sensors:
    """Keeps the robots and surroundings of a world up to date for its sensors."""

    def __init__(self, world: Description | None, cycles: float, gravity: float) -> None:
        """Begin without robots.

        Args:
            world: the scene around the robots; None on bare ground.
            cycles: control cycles per second, Hz.
            gravity: downwards, m/s^2.
        """
        self._world, self._cycles, self._gravity = world, cycles, gravity
        self._robots: tuple[SensedRobot, ...] = ()
        self._starts: Sequence[Quaternion] = ()
        self._built: tuple[Sequence[SensedRobot], Surroundings, camera.Painter] | None = None
        self._placed: SensedWorld | None = None

    def enter(self, row: int, robot: SensedRobot) -> None:
        """Set the robot of a row; the surroundings are built again only if it is a new one."""
        last = self._robots[row] if row < len(self._robots) else None
        if last is None or last.description is not robot.description:
            self._robots = (*self._robots[:row], robot, *self._robots[row + 1 :])

    def restart(self) -> None:
        """Start again: the next frame is the first one."""
        self._starts, self._placed = (), None

    def frame(
        self,
        stamp: int,
        snapshots: Sequence[Snapshot],
        last: Sequence[Snapshot] | None,
        boxes: Sequence[Transform],
    ) -> Frame:
        """Return the frame of a control cycle.

        Args:
            stamp: of the cycle, ns.
            snapshots: of the robots in this cycle.
            last: the last snapshots before; used if they are from one cycle ago.
            boxes: poses of movable boxes in the world.
        """
        self._starts = self._starts or [snapshot.pose.rotation for snapshot in snapshots]
        tick = snapshots[0].tick
        before = last if last and last[0].tick == tick - 1 else None
        return Frame(tick, stamp, snapshots, before, boxes, self._robots, self._starts)

    def prepare(self) -> None:
        """Build the surroundings now, because reading meshes takes long."""
        self._build(self._robots)

    def world(self, frame: Frame) -> SensedWorld:
        """Return the world at the time of a frame; it is cached for the last frame."""
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
        """Return the surroundings of these robots, built again if the robots have changed."""
        if self._built is None or self._built[0] is not robots:
            surroundings = Surroundings(self._world, robots)
            self._built = robots, surroundings, camera.Painter(surroundings.still)
        return self._built[1:]
