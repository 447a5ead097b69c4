"""A robot description: its links, joints, shapes and inertials as plain values.

SI units and radians, frames as REP-103 has them. ``reading`` makes these values in the one parse of
the URDF; each has the line it was written at, as ``robot.urdf:12``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from onebot_description.errors import DescriptionError, listing

Triple = tuple[float, float, float]
Rgba = tuple[float, float, float, float]
Moments = tuple[float, float, float, float, float, float]  # ixx ixy ixz iyy iyz izz, kg m^2

JOINT_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
MOVING_KINDS = ("revolute", "continuous", "prismatic")  # their position is one number
MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".stl")

ZERO: Triple = (0.0, 0.0, 0.0)


class Origin(NamedTuple):
    """Where something lies in the frame of its parent."""

    xyz: Triple = ZERO  # m
    rpy: Triple = ZERO  # roll, pitch, yaw about the parent's fixed axes, rad


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
    """A mesh file, its axes scaled by ``scale``; ``meshes.locate_mesh`` finds it."""

    uri: str  # valid for other programs, too: file://, or package:// of an installed package
    scale: Triple
    path: Path | None = field(default=None, compare=False)  # None if there is no such file
    problem: str = field(default="", compare=False)  # why there is none


Shape = Box | Cylinder | Sphere | Capsule | Mesh


@dataclass(frozen=True)
class Material:
    """How visuals look; one with neither colour nor texture refers by its name to another."""

    name: str | None
    color: Rgba | None = None  # 0 to 1
    texture: str | None = None  # its file, as written

    @property
    def is_reference(self) -> bool:
        """Whether it defines nothing itself."""
        return self.color is None and self.texture is None


@dataclass(frozen=True)
class Geometry:
    """One <visual> or <collision> of a link."""

    shape: Shape
    origin: Origin  # frame: the link's
    color: Rgba | None = None  # the visual's material, 0 to 1; None if it gives none
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
    friction: float | None  # <contact><lateral_friction>, which PyBullet has added to URDF
    where: str = field(default="", compare=False)
    # What is wrong with the visuals and collisions that could not be read.
    left_out: tuple[str, ...] = field(default=(), compare=False)


@dataclass(frozen=True)
class Mimic:
    """A joint follows another: position = multiplier * position of ``joint`` + offset."""

    joint: str  # it may follow another one itself
    multiplier: float = 1.0  # no unit, or m/rad and rad/m between kinds
    offset: float = 0.0  # rad, or m for a prismatic joint


@dataclass(frozen=True)
class Joint:
    """One joint; positions in rad, of prismatic joints in m. Absent limits are None."""

    name: str
    kind: str  # one of JOINT_KINDS
    parent: str  # link
    child: str  # link
    origin: Origin = Origin()  # the joint frame (the child link's) in the parent link's
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
    """Gaussian noise of one value, in its unit."""

    mean: float = 0.0
    stddev: float = 0.0
    bias_mean: float = 0.0  # mean of an offset drawn once, with a random sign
    bias_stddev: float = 0.0
    precision: float = 0.0  # step to which the sum is rounded; 0: no rounding


RADIATIONS = ("ultrasound", "infrared")  # in the order of the constants of sensor_msgs/msg/Range


class Fan(NamedTuple):
    """Directions evenly spread over an angle, both ends included."""

    samples: int = 1
    least: float = 0.0  # rad
    greatest: float = 0.0


@dataclass(frozen=True)
class Lidar:
    """A range finder whose rays lie in rows; x ahead, z up."""

    horizontal: Fan  # rays of a row, about z
    vertical: Fan  # rows, upwards
    least: float  # range, m
    greatest: float
    noise: Noise = Noise()
    is_organized: bool = True  # clouds have a point for each ray, also where it meets nothing
    radiation: str = "infrared"  # of a Range: one of RADIATIONS
    cone: float = 0.0  # of a Range: its field of view, rad; 0: the angle of the rays

    @property
    def field_of_view(self) -> float:
        """The greatest angle between rays, or the one that was set, rad."""
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
    depth_near: float  # the same of the depth
    depth_far: float
    noise: Noise = Noise()  # unit: 1 for colours (0 to 1), m for the depth
    baseline: float = 0.0  # m, from the left camera of a pair to this one
    blank: float = math.inf  # x, y and z of a point without a depth, as in gz sim


class Reference(NamedTuple):
    """The axes in which an IMU gives its orientation."""

    rpy: Triple = ZERO  # fixed-axis roll, pitch, yaw in the world: x east, y north, z up; rad
    at_start: bool = False  # they are those in the root link's frame instead, as it was at first


@dataclass(frozen=True)
class Imu:
    """An inertial measurement unit."""

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
"""The type of each output of sensors."""


@dataclass(frozen=True)
class Sensor:
    """One <sensor> that is simulated; of one with several plugins, what one of them publishes."""

    name: str
    link: str
    origin: Origin  # relative to the link
    rate: float  # measurements a simulated second, Hz; 0: one in each control cycle
    topics: Mapping[str, str]  # by output: a name, relative or absolute
    frame: str  # frame_id of the messages; a link, unless set otherwise on purpose
    model: Lidar | Camera | Imu
    where: str = field(default="", compare=False)


def clashes(first: Mapping[str, str], second: Mapping[str, str]) -> list[str]:
    """Return the topics of two sensors that they cannot share, as cameras share a CameraInfo."""
    kinds = {topic: MESSAGE_TYPES[output] for output, topic in first.items()}
    info = MESSAGE_TYPES["camera_info"]
    return [
        topic
        for output, topic in second.items()
        if topic in kinds and {kinds[topic], MESSAGE_TYPES[output]} != {info}
    ]


class JointInterfaces(NamedTuple):
    """What ``<ros2_control>`` says of a joint."""

    commands: tuple[str, ...]  # command interfaces, such as "position"; none: it is not driven
    start: float | None = None  # initial_value of its position, rad or m


@dataclass(frozen=True)
class Description:
    """A robot description; everything in it can be published.

    What is in its ``problems`` was left out or replaced, so that a node can use the rest.
    """

    urdf: str  # xacro expanded, axes of unit length, mesh paths absolute, indented, no comments
    robot_name: str
    source: str  # absolute path of the file loaded, or the name given to parse_description
    files: tuple[Path, ...]  # absolute paths of all files read, the loaded one first (to watch)
    root_link: str  # the link that is no joint's child; the first one of a robot in parts
    links: tuple[Link, ...]  # order of the XML
    joints: tuple[Joint, ...]  # likewise
    problems: tuple[str, ...]  # ``onebot check`` refuses them, nodes warn of them
    warnings: tuple[str, ...]  # it works but is probably not meant
    # Where each element of ``urdf`` was written, in document order.
    places: tuple[str, ...] = field(default=(), compare=False, repr=False)
    sensors: tuple[Sensor, ...] = ()
    bad_sensors: tuple[str, ...] = ()  # names of unreadable sensors
    # Of <ros2_control>, by joint.
    interfaces: Mapping[str, JointInterfaces] = field(default_factory=dict, hash=False)

    @property
    def notices(self) -> tuple[str, ...]:
        """What a node logs as warnings when it uses the description: problems, then warnings."""
        return (*self.problems, *self.warnings)

    def raise_problems(self) -> None:
        """Raise a DescriptionError with all problems and warnings, if there are problems."""
        if self.problems:
            raise DescriptionError(self.problems, self.warnings)

    def require_tree(self) -> None:
        """Raise a DescriptionError if the robot is in parts, which TF cannot have."""
        if len(self.roots) > 1:
            raise DescriptionError(
                [
                    f"{self.source}: the robot falls into {len(self.roots)} parts, whose roots are "
                    f"{listing(self.roots)}; connect them by joints"
                ]
            )

    @cached_property
    def roots(self) -> tuple[str, ...]:
        """The links that are no joint's child: one, unless the robot is in parts."""
        children = {joint.child for joint in self.joints}
        return tuple(name for name in self.link_names if name not in children)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links in the order of the XML."""
        return tuple(link.name for link in self.links)

    @cached_property
    def moving_joints(self) -> tuple[Joint, ...]:
        """The joints whose position is one number: no fixed, floating or planar ones."""
        return tuple(joint for joint in self.joints if joint.kind in MOVING_KINDS)
