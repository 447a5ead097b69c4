"""Finds the wheels of a drive among a robot's joints, by their geometry.

A wheel turns about a level axis and reaches the ground with a round shape. Wheels on two sides turn
about a lateral axis, are on the left or the right, and no joint swivels them. Names matter only if
several sets of wheels remain.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from onebot_control.conventions import WORLD_FRAME
from onebot_control.drive.wheels.rolling_shapes import Tyre, Tyres, lowest_point
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import Description, Joint, Mesh
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.model import RobotModel
from onebot_description.model.rigid_bodies import rigid_frames

_MIDDLE = 0.005  # m; a wheel closer to the middle line is on neither side
_GROUND = 0.1  # a wheel on the ground is at most this fraction of its radius above the lowest one
_ALIKE = 0.01  # relative difference of radii in a set; also m above the lowest wheel
_ACROSS = math.cos(math.radians(1.0))  # cosine of the maximum angle of an axle to the lateral axis
_LEVEL = math.sin(math.radians(1.0))  # sine of the maximum angle of an axle to the ground
_TRAIL = 0.1  # a caster's wheel trails its swivel by at least this fraction of its radius
_VERTICAL = 0.9  # cosine of the maximum angle of a swivel joint to the vertical
_PASSIVE = re.compile(r"cast[eo]r|passive|free|idler|support|omni|dummy", re.IGNORECASE)
# Matches the names of omnidirectional wheels and of their meshes.
_SKEW = math.sin(math.radians(5.0))  # sine of the minimum angle of a mecanum wheel's rollers
_MIN_OMNI = 3  # wheels of an omni drive
_MIN_OBLIQUE = 2  # wheels of an omni drive that are not lateral
_ROLLERS = re.compile(r"mec+anum|omni|swedish", re.IGNORECASE)


class Axle(NamedTuple):
    """A rotating joint, in the root link's frame with all joints at 0."""

    joint: Joint
    pose: Floats  # (4, 4) of the joint's frame
    axis: Floats  # (3,), unit vector

    @property
    def across(self) -> bool:
        """Whether it points to the left or to the right within a degree, like a wheel's axle."""
        return abs(float(self.axis[1])) >= _ACROSS

    @property
    def level(self) -> bool:
        """Whether it is level within a degree, like every wheel's axle."""
        return abs(float(self.axis[2])) <= _LEVEL

    @property
    def direction(self) -> float:
        """1 if a positive velocity of a wheel on it drives forward, -1 if backward."""
        return 1.0 if self.axis[1] > 0.0 else -1.0

    def middle(self, tyre: Tyre | None) -> Floats:
        """Return the center of the wheel, (3,), m; without a tyre, the joint's origin."""
        position: Floats = self.pose[:3, 3]
        return position if tyre is None else position + tyre.offset * self.axis


class Wheel(NamedTuple):
    """A rolling part, in the root link's frame with all joints at 0."""

    name: str  # name of the joint
    x: float  # position of its center in the root link's frame, m
    y: float  # the same
    bottom: float  # z where it touches the ground, m
    radius: float  # m
    link: str


class RunningGear:
    """The parts that a robot may roll on: its rotating joints, and the round shapes of their links.

    Attributes:
        description: the robot.
        rigid: for each link the first link of its rigid body, and its pose (4, 4) in that frame.
        places: the pose (4, 4) of each link in the root link's frame, with all joints at 0.
        tyres: the round shapes of the robot's links.
        axles: the continuous and revolute joints, by name.
    """

    def __init__(self, description: Description) -> None:
        """Read the joints; ``of`` does so once for each description."""
        self.description, self.rigid = description, rigid_frames(description)
        self.tyres = Tyres(description, self.rigid)
        self.places = RobotModel.from_description(description).link_matrices({})
        self.axles = {
            joint.name: Axle(joint, place, place[:3, :3] @ joint.axis)
            for joint in description.joints
            for place in (self.places[joint.child],)
            if joint.kind in ("continuous", "revolute")
        }

    @classmethod
    def of(cls, description: Description) -> "RunningGear":
        """Return the running gear of a robot; the result is cached."""
        gear = description.derived.get(cls) or cls(description)
        description.derived[cls] = gear
        return gear

    @cached_property
    def rolling(self) -> Sequence[Wheel]:
        """All rolling parts, at any height: continuous joints with a level axis."""
        wheels = []
        for name, axle in self.axles.items():
            if axle.joint.kind != "continuous" or not axle.level:
                continue
            if (tyre := self.tyres.tyre(name)) is not None:
                x, y, z = axle.middle(tyre).tolist()
                wheels.append(Wheel(name, x, y, z - tyre.radius, tyre.radius, axle.joint.child))
        return wheels

    @cached_property
    def lateral(self) -> Sequence[Wheel]:
        """All rolling parts with a lateral axis, at any height."""
        return [wheel for wheel in self.rolling if self.axles[wheel.name].across]

    @cached_property
    def on_ground(self) -> Sequence[Wheel]:
        """All rolling parts on the ground that no joint swivels."""
        return [wheel for wheel in _on_ground(self.rolling) if self.swivel(wheel.name) is None]

    @cached_property
    def omni(self) -> Sequence[Wheel]:
        """At least three similar wheels, at least two of them not lateral; empty if not found."""
        groups = [
            group
            for group in _alike(self.on_ground)
            if len(group) >= _MIN_OMNI
            and sum(not self.axles[wheel.name].across for wheel in group) >= _MIN_OBLIQUE
        ]
        return groups[-1] if groups else ()

    @cached_property
    def steered(self) -> Mapping[str, str]:
        """The steering joint of each steered wheel on the ground, by the wheel's joint."""
        steered = {}
        for wheel in _on_ground(self.lateral):
            joint = self.swivel(wheel.name)
            if joint and _is_steered(wheel, self.axles[wheel.name], self.axles[joint.name]):
                steered[wheel.name] = joint.name
        return steered

    @cached_property
    def front_driven(self) -> bool:
        """Whether ``<ros2_control>`` commands only steered wheels by velocity."""
        commanded = {
            name
            for name, listed in self.description.interfaces.items()
            if "velocity" in listed.commands
        }
        free = {wheel.name for wheel in self.on_ground}
        return not commanded.isdisjoint(self.steered) and commanded.isdisjoint(free)

    @property
    def has_rollers(self) -> bool:
        """Whether the wheels that no joint swivels have rollers, as in a mecanum drive.

        It follows from their names, from a plugin that drives sideways, or from ``<fdir1>``.
        """
        wheels, plugin = self.on_ground, self.description.drive_plugin
        return len(wheels) > 2 and (
            all(_has_rollers(self.description, wheel) for wheel in wheels)
            or (plugin is not None and plugin.kind in ("mecanum", "planar"))
            or any(abs(math.sin(angle)) > _SKEW for angle in self.description.rollers.values())
        )

    @cached_property
    def drives(self) -> bool:
        """Whether the robot has wheels on the ground; otherwise its base is fixed.

        A rolling part counts as a wheel if its lowest point is at most its radius above the
        robot's; higher up it belongs to an arm. A robot with the root link ``world`` is fixed.

        Raises:
            OneBotError: the mesh of a collision shape cannot be read.
        """
        if self.description.root_link == WORLD_FRAME:
            return False
        wheels = self.lateral or self.on_ground
        if not self.lateral and len(wheels) < _MIN_OMNI:
            return False
        bottoms = [
            lowest_point(shape.shape, self.places[link.name] @ matrices.of_origin(shape.origin))
            for link in self.description.links
            for shape in link.collisions
        ]
        lowest = min(bottoms, default=math.inf)
        return any(wheel.bottom - wheel.radius <= lowest for wheel in wheels)

    def swivel(self, name: str) -> Joint | None:
        """Return the vertical joint that swivels the wheel of a joint; None if there is none."""
        above = {joint.child: joint for joint in self.description.joints}
        link = self.axles[name].joint.parent
        while joint := above.get(link):
            if joint.name in self.axles and abs(self.axles[joint.name].axis[2]) > _VERTICAL:
                return joint
            link = joint.parent
        return None

    def sides(self, *, rollers: bool = False) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Find the wheels on two sides that drive the robot.

        Args:
            rollers: whether they may have rollers, as in a mecanum drive; otherwise an error.

        Returns:
            The joints of the left wheels, and of the right wheels, from front to rear.

        Raises:
            OneBotError: there are no such wheels, or several sets of them, or they are steered or
                omnidirectional; the text lists the rotating joints.
        """
        for wheel, joint in self.steered.items():
            raise self._not_differential(
                f'joint "{joint}" steers the wheel of "{wheel}"; if it is a caster, name it so',
                "ackermann_steering_controller/AckermannSteeringController",
            )
        wheels = [wheel for wheel in _on_ground(self.lateral) if self.swivel(wheel.name) is None]
        sets = _sets(wheel for wheel in wheels if abs(wheel.y) > _MIDDLE)
        sets = [group for group in sets if not any(map(_is_passive, group))] or sets
        if len(sets) != 1:
            raise self._not_driven(_why_not_one_set(sets))
        [drive] = sets
        if not rollers and len(drive) > 2 and self.has_rollers:
            raise self._not_differential(
                "its wheels are omnidirectional, with rollers around them",
                "mecanum_drive_controller/MecanumDriveController",
            )
        drive.sort(key=lambda wheel: -wheel.x)
        left = tuple(wheel.name for wheel in drive if wheel.y > 0.0)
        return left, tuple(wheel.name for wheel in drive if wheel.y < 0.0)

    def _not_differential(self, reason: str, kind: str) -> OneBotError:
        text = f"let the control file name the type of its drive, such as {kind}, or none"
        return self._not_driven(f"it is not a differential drive: {reason}; {text}")

    def _not_driven(self, reason: str) -> OneBotError:
        joints = [f"{axle.joint.name} {_seen(axle)}" for axle in self.axles.values()]
        return OneBotError(
            f'robot "{self.description.robot_name}" cannot be driven: {reason}. Wheels are '
            "continuous joints whose axes point to the left, (0 1 0), in the frame of "
            f"{self.description.root_link}, with a round shape on the ground. Name them: "
            "left_wheel:=JOINT right_wheel:=JOINT, or left_wheel_names and right_wheel_names in "
            "params_file (or start without a simulation: sim:=false). "
            f"Its rotating joints: {'; '.join(joints) or 'none'}"
        )


def _why_not_one_set(sets: Sequence[Sequence[Wheel]]) -> str:
    if sets:
        names = " or ".join(", ".join(wheel.name for wheel in group) for group in sets)
        return f"it is not clear which of its wheels drive it: {names}"
    return "its joints include no wheel on the left with a matching wheel on the right"


def _seen(axle: Axle) -> str:
    x, y, z = (f"{value:.3g}" for value in np.round(axle.pose[:3, 3], 3) + 0.0)
    pointing = " ".join(f"{value:.3g}" for value in np.round(axle.axis, 3) + 0.0)
    return f"({axle.joint.kind}, at {x} {y} {z}, axis {pointing})"


def _on_ground(wheels: Sequence[Wheel]) -> list[Wheel]:
    ground = min((wheel.bottom for wheel in wheels), default=0.0)
    return [w for w in wheels if w.bottom - ground <= max(_ALIKE, _GROUND * w.radius)]


def _is_steered(wheel: Wheel, axle: Axle, swivel: Axle) -> bool:
    """Return whether a wheel is steered; a caster's swivel is continuous, and its wheel trails."""
    if _PASSIVE.search(f"{swivel.joint.name} {wheel.name} {wheel.link}"):
        return False
    x, y, _ = np.cross(axle.axis, (0.0, 0.0, 1.0))
    trail = x * (wheel.x - swivel.pose[0, 3]) + y * (wheel.y - swivel.pose[1, 3])
    return swivel.joint.kind == "revolute" or abs(float(trail)) < _TRAIL * wheel.radius


def _sets(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Group wheels of similar radius; keep groups with equal numbers on the left and right."""
    alike = _alike(wheels)
    return [group for group in alike if sum(1 if wheel.y > 0.0 else -1 for wheel in group) == 0]


def _alike(wheels: Iterable[Wheel]) -> list[list[Wheel]]:
    """Group wheels of similar radius, the smallest first."""
    sets: list[list[Wheel]] = []
    for wheel in sorted(wheels, key=lambda wheel: wheel.radius):
        if sets and wheel.radius <= sets[-1][0].radius * (1.0 + _ALIKE) + 1e-6:
            sets[-1].append(wheel)
        else:
            sets.append([wheel])
    return sets


def _is_passive(wheel: Wheel) -> bool:
    return bool(_PASSIVE.search(f"{wheel.name} {wheel.link}"))


def _has_rollers(description: Description, wheel: Wheel) -> bool:
    link = next(link for link in description.links if link.name == wheel.link)
    shapes = [geometry.shape for geometry in (*link.collisions, *link.visuals)]
    # Only the folders next to the file; folders above may belong to the user.
    files = ["/".join(shape.uri.split("/")[-3:]) for shape in shapes if isinstance(shape, Mesh)]
    return any(map(_ROLLERS.search, (wheel.name, wheel.link, *files)))
