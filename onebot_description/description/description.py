"""A robot description as plain values: links, joints, shapes, inertials and sensors.

Units are SI and radians, frames follow REP-103. ``reading`` creates these values from the URDF; in
each, ``where`` is the line that it was written at, such as ``robot.urdf:12``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from onebot_description.errors import DescriptionError, listing
from onebot_description.geometry.poses import ZERO, Origin, Triple

Rgba = tuple[float, float, float, float]
Moments = tuple[float, float, float, float, float, float]  # ixx ixy ixz iyy iyz izz, kg m^2

JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
MOVING_KINDS = ("revolute", "continuous", "prismatic")  # kinds with one degree of freedom
MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".stl")


@dataclass(frozen=True)
class Box:
    """A box centred on its origin."""

    size: Triple  # along x, y, z, m


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about z, centred on its origin; metres."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred on its origin; metres."""

    radius: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder of ``length`` about z with a half sphere on either end; metres."""

    radius: float
    length: float


@dataclass(frozen=True)
class Mesh:
    """A mesh file, scaled along its axes; ``meshes.locate_mesh`` finds the file."""

    uri: str  # valid for other programs, too: file://, or package:// of an installed package
    scale: Triple
    path: Path | None = field(default=None, compare=False)  # None if there is no such file
    problem: str = field(default="", compare=False)  # why there is no such file


Shape = Box | Cylinder | Sphere | Capsule | Mesh


@dataclass(frozen=True)
class Material:
    """The material of visuals; without colour and texture it refers to another one by its name."""

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
    color: Rgba | None = None  # of the visual's material, 0 to 1; None if not given
    where: str = field(default="", compare=False)


@dataclass(frozen=True)
class Inertial:
    """Mass and inertia of a link."""

    origin: Origin  # centre of mass and axes of the inertia, in the link's frame
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


@dataclass(frozen=True)
class Mimic:
    """How a joint follows another: position = multiplier * position of ``joint`` + offset."""

    joint: str  # the leader, which may follow another joint itself
    multiplier: float = 1.0  # without unit, or m/rad or rad/m between joints of different kinds
    offset: float = 0.0  # rad, or m for a prismatic joint

    def at(self, position: float) -> float:
        """Return the joint's position, rad or m, when its leader is at ``position``."""
        return self.multiplier * position + self.offset

    def after(self, leader: "Mimic") -> "Mimic":
        """Return how the joint follows the leader of its leader, which follows as ``leader``."""
        return Mimic(leader.joint, self.multiplier * leader.multiplier, self.at(leader.offset))


@dataclass(frozen=True)
class Joint:
    """One joint; positions are in rad, or m for prismatic joints. Limits not given are None."""

    name: str
    kind: str  # one of JOINT_KINDS
    parent: str  # link
    child: str  # link
    origin: Origin = Origin()  # of the joint frame (the child link's frame) in the parent link
    axis: Triple = (1.0, 0.0, 0.0)  # unit vector in the joint frame
    lower: float | None = None  # least position, at most ``upper``; revolute and prismatic only
    upper: float | None = None
    velocity: float | None = None  # greatest speed, rad/s or m/s
    effort: float | None = None  # greatest torque or force, Nm or N
    soft_lower: float | None = None  # <safety_controller>
    soft_upper: float | None = None
    damping: float = 0.0  # <dynamics>, Nm s/rad or N s/m
    friction: float = 0.0  # <dynamics>, Nm or N
    mimic: Mimic | None = None
    where: str = field(default="", compare=False)

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest position, rad or m; infinite where there is no limit."""
        return (
            -math.inf if self.lower is None else self.lower,
            math.inf if self.upper is None else self.upper,
        )


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of one measured value, in its unit."""

    mean: float = 0.0
    stddev: float = 0.0
    bias_mean: float = 0.0  # mean of an offset drawn once, with a random sign
    bias_stddev: float = 0.0
    precision: float = 0.0  # step to which the sum is rounded; 0: no rounding


RADIATIONS = ("ultrasound", "infrared")  # in the order of the constants of sensor_msgs/msg/Range


class Fan(NamedTuple):
    """Ray directions evenly spread over an angle, including both ends."""

    samples: int = 1
    least: float = 0.0  # rad
    greatest: float = 0.0


@dataclass(frozen=True)
class Lidar:
    """A range finder whose rays are in rows; x ahead, z up."""

    horizontal: Fan  # rays of a row, about z
    vertical: Fan  # rows, upwards
    least: float  # range, m
    greatest: float
    noise: Noise = Noise()
    is_organized: bool = True  # whether clouds have points for rays that hit nothing, too
    radiation: str = "infrared"  # for Range messages, one of RADIATIONS
    cone: float = 0.0  # field of view of Range messages, rad; 0: the angle of the rays

    @property
    def field_of_view(self) -> float:
        """Field of view of Range messages: as set, or the greatest angle between rays, rad."""
        spans = (fan.greatest - fan.least for fan in (self.horizontal, self.vertical))
        return self.cone or max(spans)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion, looking along x."""

    field_of_view: float  # horizontal, rad
    width: int  # pixels
    height: int
    near: float  # m along the axis
    far: float
    depth_near: float  # near clip of depths, m along the axis
    depth_far: float  # far clip of depths
    noise: Noise = Noise()  # of colours (0 to 1), or of depths (m)
    baseline: float = 0.0  # m, from the left camera of a pair to this one
    blank: float = math.inf  # x, y and z of a point without a depth, as in gz sim


class Reference(NamedTuple):
    """The reference axes of an IMU's orientation."""

    rpy: Triple = ZERO  # fixed-axis roll, pitch, yaw in the world: x east, y north, z up; rad
    at_start: bool = False  # relative to the root link's initial frame instead of the world


@dataclass(frozen=True)
class Imu:
    """An inertial measurement unit, with the noise of each axis."""

    angular_velocity: tuple[Noise, Noise, Noise] = (Noise(), Noise(), Noise())  # rad/s
    linear_acceleration: tuple[Noise, Noise, Noise] = (Noise(), Noise(), Noise())  # m/s^2
    reference: Reference | None = Reference()  # None: it measures no orientation


MESSAGE_TYPES = {
    "scan": "sensor_msgs/msg/LaserScan",
    "range": "sensor_msgs/msg/Range",
    "point_cloud": "sensor_msgs/msg/PointCloud",
    "imu": "sensor_msgs/msg/Imu",
    "image": "sensor_msgs/msg/Image",
    "depth": "sensor_msgs/msg/Image",
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "depth_camera_info": "sensor_msgs/msg/CameraInfo",
    "points": "sensor_msgs/msg/PointCloud2",
}
"""The message type of each sensor output."""


@dataclass(frozen=True)
class Sensor:
    """One simulated <sensor>, or what one of its plugins publishes."""

    name: str
    link: str
    origin: Origin  # relative to the link
    rate: float  # measurements per simulated second, Hz; 0: one in each control cycle
    topics: Mapping[str, str]  # relative or absolute names, by output
    frame: str  # frame_id of the messages, usually a link
    model: Lidar | Camera | Imu
    where: str = field(default="", compare=False)


def clashes(first: Mapping[str, str], second: Mapping[str, str]) -> list[str]:
    """Return the topics that two sensors have in common; CameraInfo topics may be shared."""
    kinds = {topic: MESSAGE_TYPES[output] for output, topic in first.items()}
    info = MESSAGE_TYPES["camera_info"]
    return [
        topic
        for output, topic in second.items()
        if topic in kinds and {kinds[topic], MESSAGE_TYPES[output]} != {info}
    ]


class JointInterfaces(NamedTuple):
    """The interfaces of a joint in ``<ros2_control>``."""

    commands: tuple[str, ...]  # command interfaces, such as "position"; empty: it is not driven
    start: float | None = None  # initial_value of its position, rad or m


@dataclass(frozen=True)
class Description:
    """A robot, or a world, as read from URDF; everything in it can be published.

    Elements with ``problems`` were left out or replaced, so that a node can use the rest.
    """

    urdf: str  # xacro expanded, axes of unit length, mesh paths absolute, indented, no comments
    robot_name: str
    source: str  # absolute path of the file loaded, or the name given to parse_description
    files: tuple[Path, ...]  # absolute paths of all files read, the loaded one first (to watch)
    root_link: str  # the link that is no joint's child; the first of them if there are several
    links: tuple[Link, ...]  # in the order of the XML
    joints: tuple[Joint, ...]  # in the order of the XML
    problems: tuple[str, ...]  # ``onebot check`` refuses these, nodes only warn
    warnings: tuple[str, ...]  # these work, but are probably not intended
    # File and line of each element of ``urdf``, in document order.
    places: tuple[str, ...] = field(default=(), compare=False, repr=False)
    sensors: tuple[Sensor, ...] = ()
    bad_sensors: tuple[str, ...] = ()  # names of unreadable sensors
    # From <ros2_control>, by joint.
    interfaces: Mapping[str, JointInterfaces] = field(default_factory=dict, hash=False)

    @property
    def notices(self) -> tuple[str, ...]:
        """The problems, then the warnings, which a node logs when it uses the description."""
        return (*self.problems, *self.warnings)

    def raise_problems(self) -> None:
        """Raise a DescriptionError with all problems and warnings, if there are problems."""
        if self.problems:
            raise DescriptionError(self.problems, self.warnings)

    def require_tree(self) -> None:
        """Raise a DescriptionError if the links are not all connected."""
        if len(self.roots) > 1:
            raise DescriptionError(
                [
                    f"{self.source}: the robot falls into {len(self.roots)} parts, whose roots are "
                    f"{listing(self.roots)}; connect them by joints"
                ]
            )

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
