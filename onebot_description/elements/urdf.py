"""A robot description as plain values: links, joints, shapes and inertials.

Units are SI and radians, frames follow REP-103. ``reading`` creates these values from the URDF;
their ``where`` is the file and line of the element, such as ``robot.urdf:12``. The values of
sensors are in ``sensor``.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from onebot_description.elements.sensor import Sensor
from onebot_description.errors import DescriptionError, listing
from onebot_description.geometry.poses import Origin, Triple

Rgba = tuple[float, float, float, float]
Moments = tuple[float, float, float, float, float, float]  # ixx ixy ixz iyy iyz izz, kg m^2

JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
MOVING_KINDS = ("revolute", "continuous", "prismatic")  # kinds with one degree of freedom
# Gazebo uses the smaller of two coefficients of friction; here those of ground and boxes are 1.
MAX_FRICTION = 1.0
_ROUNDING = 1e-4  # rad or m by which a rounded start position may be beyond a limit
MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".stl")


@dataclass(frozen=True)
class Box:
    """A box centered on its origin."""

    size: Triple  # along x, y, z, m


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, centered on its origin; meters."""

    radius: float
    length: float

    @property
    def size(self) -> Triple:
        """Its size along x, y, z, m."""
        return 2.0 * self.radius, 2.0 * self.radius, self.length


@dataclass(frozen=True)
class Sphere:
    """A sphere centered on its origin; meters."""

    radius: float

    @property
    def size(self) -> Triple:
        """Its size along x, y, z, m."""
        return 2.0 * self.radius, 2.0 * self.radius, 2.0 * self.radius


@dataclass(frozen=True)
class Capsule:
    """A cylinder of ``length`` about z with a half sphere on either end; meters."""

    radius: float
    length: float

    @property
    def size(self) -> Triple:
        """Its size along x, y, z, m."""
        return 2.0 * self.radius, 2.0 * self.radius, self.length + 2.0 * self.radius


@dataclass(frozen=True)
class Mesh:
    """A mesh file, scaled along its axes; ``meshes.locate_mesh`` finds the file."""

    uri: str  # valid in other programs, too: file://, or package:// of an installed package
    scale: Triple
    path: Path | None = field(default=None, compare=False)  # None if there is no such file
    problem: str = field(default="", compare=False)  # why there is no such file


Shape = Box | Cylinder | Sphere | Capsule | Mesh


@dataclass(frozen=True)
class Material:
    """The material of visuals; without color and texture, it refers to another by its name."""

    name: str | None
    color: Rgba | None = None  # 0 to 1
    texture: str | None = None  # file name, as written

    @property
    def is_reference(self) -> bool:
        """Whether it refers to another material, because it defines nothing itself."""
        return self.color is None and self.texture is None


@dataclass(frozen=True)
class Geometry:
    """One <visual> or <collision> of a link."""

    shape: Shape
    origin: Origin  # frame: the link's
    color: Rgba | None = None  # color of the visual's material, 0 to 1; None if not given
    where: str = field(default="", compare=False)


@dataclass(frozen=True)
class Inertial:
    """Mass and inertia of a link."""

    origin: Origin  # center of mass and axes of the inertia, in the link's frame
    mass: float  # kg
    inertia: Moments


@dataclass(frozen=True)
class Link:
    """One link."""

    name: str
    visuals: tuple[Geometry, ...]
    collisions: tuple[Geometry, ...]
    inertial: Inertial | None
    friction: float | None  # <contact><lateral_friction>, PyBullet's extension of URDF
    where: str = field(default="", compare=False)
    # Problems of visuals and collisions that could not be read.
    left_out: tuple[str, ...] = field(default=(), compare=False)
    gravity: bool = True  # whether gravity acts on it, from <gazebo>
    mu: float | None = None  # coefficient of friction, from <gazebo>


@dataclass(frozen=True)
class Mimic:
    """How a joint follows another: position = multiplier * position of ``joint`` + offset."""

    joint: str  # the leader, which may follow another joint itself
    multiplier: float = 1.0  # no unit, or m/rad or rad/m between joints of different kinds
    offset: float = 0.0  # rad, or m for a prismatic joint

    def at(self, position: float) -> float:
        """Return the joint's position, rad or m, when its leader is at ``position``."""
        return self.multiplier * position + self.offset

    def after(self, leader: "Mimic") -> "Mimic":
        """Return how the joint follows the leader of its leader, given its leader's mimic."""
        return Mimic(leader.joint, self.multiplier * leader.multiplier, self.at(leader.offset))


def reduced_mimics(
    joints: Iterable[str], mimics: Mapping[str, Mimic], given: Iterable[str]
) -> dict[str, Mimic]:
    """Reduce chains of mimic joints.

    Args:
        joints: names of joints.
        mimics: how joints follow the next joint of their chain; there is no cycle.
        given: the joints with their own position, even if they are in ``mimics``.

    Returns:
        For each of ``joints`` how it follows one of the given joints, which may be the joint
        itself. Joints that follow none of them are left out.
    """
    mimic_by_joint = {name: Mimic(name) for name in given}
    reduced = {}
    for joint in joints:
        chain, name = [], joint
        while name not in mimic_by_joint and name in mimics:
            chain.append(name)
            name = mimics[name].joint
        if name not in mimic_by_joint:
            continue
        for follower in reversed(chain):
            mimic_by_joint[follower] = mimics[follower].after(mimic_by_joint[name])
            name = follower
        reduced[joint] = mimic_by_joint[joint]
    return reduced


@dataclass(frozen=True)
class Joint:
    """One joint; positions are in rad, or m for prismatic joints. Limits not given are None."""

    name: str
    kind: str  # one of JOINT_KINDS
    parent: str  # link
    child: str  # link
    origin: Origin = Origin()  # the joint frame (the child link's frame) in the parent link
    axis: Triple = (1.0, 0.0, 0.0)  # unit vector in the joint frame
    lower: float | None = None  # minimum position; revolute and prismatic only
    upper: float | None = None
    velocity: float | None = None  # maximum speed, rad/s or m/s
    effort: float | None = None  # maximum torque or force, Nm or N
    acceleration: float | None = None  # rad/s^2 or m/s^2 (URDF 1.2); nothing here enforces it
    deceleration: float | None = None  # the same
    jerk: float | None = None  # the same, rad/s^3 or m/s^3
    soft_lower: float | None = None  # <safety_controller>
    soft_upper: float | None = None
    damping: float = 0.0  # <dynamics>, Nm s/rad or N s/m
    friction: float = 0.0  # <dynamics>, Nm or N
    mimic: Mimic | None = None
    where: str = field(default="", compare=False)

    @property
    def range(self) -> tuple[float, float]:
        """The minimum and maximum position, rad or m; infinite where there is no limit."""
        return (
            -math.inf if self.lower is None else self.lower,
            math.inf if self.upper is None else self.upper,
        )

    def start_fault(
        self, position: float, minimum: float = -math.inf, maximum: float = math.inf
    ) -> str:
        """Return a message if a start position, rad or m, is beyond the limits; "" if it is not.

        ``minimum`` and ``maximum`` are the limits of the command interface, rad or m.
        """
        lower, upper = max(self.range[0], minimum), min(self.range[1], maximum)
        if lower - _ROUNDING <= position <= upper + _ROUNDING:
            return ""
        return f"{position:g} is beyond the joint's limits, {lower:g} to {upper:g}"


class JointInterfaces(NamedTuple):
    """The interfaces of a joint in ``<ros2_control>``."""

    commands: tuple[str, ...]  # command interfaces, such as "position"; empty: it is not driven
    start: float | None = None  # initial_value of its position, rad or m
    # Minimum and maximum command by command interface, rad, m or per second; infinite: no limit.
    limits: Mapping[str, tuple[float, float]] = MappingProxyType({})
    mimics: bool = True  # whether it follows the joint that its <mimic> names
    faults: tuple[str, ...] = ()  # problems with which ros2_control would not start


DriveKind = Literal["mecanum", "ackermann", "planar"]


class DrivePlugin(NamedTuple):
    """A Gazebo plugin that drives a robot, without the joints that the robot lacks."""

    kind: DriveKind  # planar: it moves the base as a whole, whatever its wheels
    where: str  # file and line, and the plugin's file
    # Joints by role. Mecanum: front_left, front_right, rear_right, rear_left. Ackermann: left and
    # right (driven), left_steering, right_steering.
    joints: Mapping[str, tuple[str, ...]]
    steering_limit: float = math.inf  # the maximum steering angle, rad; infinite: not given


@dataclass(frozen=True)
class Description:
    """A robot, or a world, as read from URDF; everything in it can be published.

    Elements with ``problems`` were left out or replaced, so that a node can use the rest.
    """

    urdf: str  # xacro expanded, axes of unit length, mesh paths absolute, indented, no comments
    robot_name: str
    source: str  # absolute path of the file loaded, or the name given to parse_description
    files: tuple[Path, ...]  # absolute paths of all files read, the loaded one first (to watch)
    root_link: str  # the link that is no joint's child; if there are several, the first
    links: tuple[Link, ...]  # all links, in the order of the XML
    joints: tuple[Joint, ...]  # all joints, in the order of the XML
    problems: tuple[str, ...]  # ``onebot check`` rejects these, nodes only warn
    warnings: tuple[str, ...]  # about elements that work, but are probably not intended
    # File and line of each element of ``urdf``, in document order.
    places: tuple[str, ...] = field(default=(), compare=False, repr=False)
    sensors: "tuple[Sensor, ...]" = ()
    bad_sensors: tuple[str, ...] = ()  # names of unreadable sensors
    # From <ros2_control>, by joint.
    interfaces: Mapping[str, JointInterfaces] = field(default_factory=dict, hash=False)
    # For links with rollers around them, such as mecanum wheels: the angle of the axle of the
    # roller at the ground to the left of forward, rad, in (-pi/2, pi/2], with all joints at 0.
    rollers: Mapping[str, float] = field(default_factory=dict, hash=False)
    drive_plugin: DrivePlugin | None = field(default=None, hash=False)

    @property
    def notices(self) -> tuple[str, ...]:
        """The problems, then the warnings; a node logs them when it uses the description."""
        return (*self.problems, *self.warnings)

    def raise_problems(self) -> None:
        """Raise a DescriptionError with all problems and warnings, if there are problems."""
        if self.problems:
            raise DescriptionError(self.problems, self.warnings)

    def independent(self) -> "Description":
        """Return it with joints of mimic="false" in ``<ros2_control>`` following no other joint."""
        free = {name for name, listed in self.interfaces.items() if not listed.mimics}
        joints = [replace(each, mimic=None) if each.name in free else each for each in self.joints]
        return replace(self, joints=tuple(joints)) if free else self

    @property
    def positioned(self) -> set[str]:
        """The joints with a position command interface in ``<ros2_control>``."""
        listed = self.interfaces.items()
        return {name for name, interfaces in listed if "position" in interfaces.commands}

    def interface_fault(self, commanded: Collection[str] = (), *, stands: bool) -> str:
        """Return why ``<ros2_control>`` cannot be simulated; "" if it can.

        Args:
            commanded: the joints of controllers; each needs a position command interface.
            stands: whether the base is fixed; then at least one of the driven joints needs one.
        """
        positioned = self.positioned
        others = {
            name: joint.commands
            for name, joint in self.interfaces.items()
            if joint.commands and name not in positioned
        }
        none = stands and not positioned
        joints = [name for name in others if name in commanded or none]
        if not joints:
            return ""
        kinds = listing(kind for name in joints for kind in others[name])
        return (
            f"{self.source}: joint {listing(joints)}: <ros2_control> has only the command "
            f"interface {kinds}, which cannot be simulated yet; add position"
        )

    def require_tree(self) -> None:
        """Raise a DescriptionError if the links are not all connected."""
        if len(self.roots) > 1:
            raise DescriptionError(
                [
                    f"{self.source}: the robot is in {len(self.roots)} separate parts, with the "
                    f"roots {listing(self.roots)}; connect them by joints"
                ]
            )

    @cached_property
    def derived(self) -> dict[type, Any]:
        """A cache of values that are derived from the description, by class."""
        return {}

    @cached_property
    def roots(self) -> tuple[str, ...]:
        """The links that are no joint's child; more than one if not all links are connected."""
        children = {joint.child for joint in self.joints}
        return tuple(name for name in self.link_names if name not in children)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links in the order of the XML."""
        return tuple(link.name for link in self.links)

    @cached_property
    def moving_joints(self) -> tuple[Joint, ...]:
        """The joints with one degree of freedom: all but fixed, floating and planar ones."""
        return tuple(joint for joint in self.joints if joint.kind in MOVING_KINDS)
