"""The base class of instruments, which measure with one sensor, and the world for measurements."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import cached_property
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from onebot_control.controlled_robot import Snapshot
from onebot_control.physics.contacts import Contact
from onebot_control.sensing.noise import bias, noise_generator
from onebot_control.sensing.painter import Painter
from onebot_control.sensing.rays import Hits, Rays, cast
from onebot_control.sensing.surroundings import LinkPose, Placed, SensedRobot
from onebot_description.arrays import Floats
from onebot_description.description.sensors.noise import Noise
from onebot_description.elements.sensor import Sensor, SensorModel
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Quaternion, Transform
from onebot_description.model.rigid_bodies import rigid_frames

M = TypeVar("M", bound=SensorModel)

_TRIED = 1000  # maximum number of rays for the detection of a sensor's housing


class Frame(NamedTuple):
    """The state of a world in one control cycle, for its sensors."""

    tick: int  # number of control cycles before this one
    stamp: int  # time of the cycle, ns
    snapshots: Sequence[Snapshot]  # states of the robots
    before: Sequence[Snapshot] | None  # states one cycle ago; None if unknown
    boxes: Sequence[Transform]  # poses of movable boxes
    robots: Sequence[SensedRobot]
    starts: Sequence[Quaternion]  # rotations of the robots in the first cycle
    # Contacts in the last cycle, by row, of robots with an instrument that ``needs_contacts``.
    contacts: Mapping[int, Sequence[Contact]]


class SensedWorld(NamedTuple):
    """The surroundings at the time of a frame, for measurements."""

    frame: Frame
    placed: Placed
    painter: Painter
    period: float  # duration of a control cycle, s
    gravity: float  # m/s^2


class Instrument(ABC, Generic[M]):
    """Measures with one sensor of one robot; each kind of sensor has a subclass.

    Attributes:
        waiting: maximum number of waiting measurements; instruments with more measure first.
        needs_embree: whether it cannot measure without Embree.
        needs_contacts: whether it needs the robot's contacts in a frame.
        sensor: the sensor's description.
        model: the model of the sensor.
        row: index of the robot in its fleet.
        rate: measurements per simulated second, Hz: the sensor's rate, or one per control cycle.
    """

    waiting: ClassVar[int]
    needs_embree: ClassVar[bool] = False
    needs_contacts: ClassVar[bool] = False

    def __init__(
        self,
        sensor: Sensor,
        row: int,
        namespace: str,
        cycles: float,
        *,
        noisy: bool = True,
        seed: int = 0,
    ) -> None:
        """Prepare to measure.

        Args:
            sensor: the sensor's description.
            row: index of the robot in its fleet.
            namespace: namespace of the robot; the noise depends on it.
            cycles: control cycles per second, Hz.
            noisy: whether measurements have the sensor's noise.
            seed: seed of the noise.
        """
        self.sensor, self.row, self._noisy, self._seed = sensor, row, noisy, seed
        model: Any = sensor.model  # the table of instruments determines its type
        self.model: M = model
        self.rate = min(sensor.rate or cycles, cycles)
        self._name = f"{namespace}/{sensor.link}/{sensor.name}"
        self._mount = matrices.of_origin(sensor.origin)
        self._unseen: list[str] = []  # links that rays pass through; found at the first measurement

    @abstractmethod
    def measure(self, world: SensedWorld, wanted: Set[str]) -> dict[str, Any]:
        """Measure with the sensor.

        Args:
            world: world to measure in.
            wanted: the outputs to compute, keys of ``Sensor.topics``.

        Returns:
            At least the wanted outputs, by name.
        """

    @property
    def noises(self) -> Sequence[Noise]:
        """The noises that have constant ``offsets``; the noise of pictures has none."""
        return ()

    @cached_property
    def offsets(self) -> Floats:
        """The constant offsets of the noises."""
        once = noise_generator(self._name, -1, self._seed)
        return np.array([bias(noise, once) for noise in self.noises])

    def generator(self, frame: Frame) -> "np.random.Generator | None":
        """Return the generator of the noise in a frame; None for no noise."""
        return noise_generator(self._name, frame.tick, self._seed) if self._noisy else None

    def reseed(self, seed: int) -> None:
        """Use another seed for all noise from now on."""
        self._seed = seed
        self.__dict__.pop("offsets", None)

    def pose(self, placed: Placed) -> LinkPose:
        """Return the pose of the sensor in the world."""
        link = placed.link(self.row, self.sensor.link)
        assert link is not None
        return self.mounted(link)

    def mounted(self, link: LinkPose) -> LinkPose:
        """Return the pose, or poses, of the sensor for the pose(s) of its link."""
        turn, at = self._mount[:3, :3], self._mount[:3, 3]
        return LinkPose(link.rotation @ turn, link.rotation @ at + link.position)

    def hits(
        self, world: SensedWorld, pose: LinkPose, rays: Rays, minimum: float, reach: float
    ) -> Hits:
        """Return the hits of the sensor's rays, which pass through its own link and its housing.

        Args:
            world: world to measure in.
            pose: pose of the sensor.
            rays: rays of the sensor.
            minimum: minimum measured distance, in lengths of the directions.
            reach: maximum distance, in lengths of the directions.
        """
        placed = world.placed
        if not self._unseen:
            self._unseen = [self.sensor.link, *self._housing(world, pose, rays, minimum)]
        skipped = [placed.surroundings.target(self.row, link) for link in self._unseen]
        return cast(rays, *pose, placed.surroundings.still, placed.targets, reach, skipped)

    def _housing(
        self, world: SensedWorld, pose: LinkPose, rays: Rays, minimum: float
    ) -> Iterator[str]:
        """Yield the links around the sensor, which would hide everything else.

        They are fixed to its link, and more than half of its rays hit them below the minimum
        distance: of a ring of rays, less than half can hit a convex shape beside it.
        """
        targets, surroundings = world.placed.targets, world.placed.surroundings
        some = rays.singles[:: len(rays.singles) // _TRIED + 1]
        bodies = rigid_frames(world.frame.robots[self.row].description)
        for link, (first, _) in bodies.items():
            index = surroundings.target(self.row, link) - 1
            if first != bodies[self.sensor.link][0] or index < 0:
                continue
            back = targets.rotations[index].T
            start = (back @ (pose.position - targets.positions[index])).astype(np.float32)
            directions = some @ (back @ pose.rotation).T.astype(np.float32)
            limits = np.full(len(some), minimum, np.float32)
            hits = targets.surfaces[index].cast(np.tile(start, (len(some), 1)), directions, limits)
            if (hits.faces >= 0).mean() > 0.5:
                yield link

    def seen_from(
        self, world: SensedWorld, pose: LinkPose, otherwise: Floats
    ) -> tuple[Floats, Floats]:
        """Return the sensor's pose in its messages' frame; ``otherwise`` if it is not a link."""
        frame = world.placed.link(self.row, self.sensor.frame)
        if frame is None:
            return otherwise, np.zeros(3)
        back = frame.rotation.T
        return back @ pose.rotation, back @ (pose.position - frame.position)
