"""Messages that the viewer shows, and what is to be in the recording of them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import onebot_bringup.viewer  # noqa: F401  before Rerun, whose log it quiets

# isort: split
import numpy as np
import rerun as rr
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import Image, JointState, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from onebot_bringup.viewer.core.rerun_limits import SELDOM
from onebot_bringup.viewer.core.transform_stream import TF_ENTITY
from onebot_bringup.viewer.displays import DRAWING_BY_TYPE
from onebot_bringup.viewer.displays.joint_plot import POSITION_ENTITY
from onebot_description.ros.wire.definition import type_name
from onebot_description.ros.wire.messages import transforms_message
from tests.benchmarks.chains import Chain

FIXED, SENSOR = "odom", "sensor"  # frames
# No other bytes of a message are these; see ``Messages.raw``.
STAMP = Time(sec=0x5AB71C5E, nanosec=0x2B67A3C9)

Arrays = Mapping[str, NDArray[Any]]  # what is to be in the file, by Rerun's names


class Drawn(NamedTuple):
    """An entity that the viewer logs."""

    entity: str
    # ``send_columns``'s columns of the concatenated arrays of so many messages.
    columns: Callable[[Arrays, int], Any]
    rows: int = 1  # that a message gives


class Case(NamedTuple):
    """Messages that come together, at one time."""

    name: str
    topics: Mapping[str, str]  # their types, as in ``sample``
    drawn: tuple[Drawn, ...]
    # Returns messages, and what is drawn of each, by a number.
    sample: Callable[[int], tuple[list[Any], list[Arrays]]]
    per_tick: int = 1
    tick_ns: int = 50_000_000  # the viewer logs 20 times a second
    goal: float = 2.0
    urdf: str = f'<robot name="robot"><link name="{FIXED}"/></robot>'


def states(joints: int) -> Case:
    """The states of a robot at 100 Hz: a message of /tf and one of /joint_states."""
    chain = Chain(joints)
    parents, children = zip(*chain.frames, strict=True)
    positions = chain.positions(50)
    transforms = chain.transforms(positions)

    def sample(number: int) -> tuple[list[Any], list[Arrays]]:
        row = number % len(positions)
        messages = [
            transforms_message(STAMP, parents, children, transforms[row]),
            JointState(
                header=Header(stamp=STAMP), name=chain.joints, position=positions[row].tolist()
            ),
        ]
        poses = transforms[row].astype(np.float32)
        tf = {
            "Transform3D:translation": poses[:, :3],
            "Transform3D:quaternion": poses[:, 3:],
            "Transform3D:parent_frame": np.array(parents, object),
            "Transform3D:child_frame": np.array(children, object),
        }
        return messages, [tf, {"Scalars:scalars": positions[row]}]

    return Case(
        f"{joints} joints",
        {"/tf": "tf2_msgs/msg/TFMessage", "joint_states": "sensor_msgs/msg/JointState"},
        (Drawn(TF_ENTITY, tf_columns, joints), Drawn(f"{POSITION_ENTITY}/0", scalar_columns)),
        sample,
        per_tick=5,
        goal=1.5,
        urdf=chain.urdf(),
    )


def tf_columns(arrays: Arrays, _count: int) -> Any:
    """A row for each transform."""
    translations, quaternions, parents, children = arrays.values()
    return rr.Transform3D.columns(
        translation=translations,
        quaternion=quaternions,
        parent_frame=parents.tolist(),
        child_frame=children.tolist(),
    )


def scalar_columns(arrays: Arrays, count: int) -> Any:
    """A row for each message."""
    (scalars,) = arrays.values()
    return rr.Scalars.columns(scalars=scalars).partition([len(scalars) // count] * count)


def laser_scan(number: int) -> tuple[Any, Arrays]:
    """A scan of 1000 rays, with intensities of a byte."""
    noise = np.random.default_rng(number)
    ranges = (3.0 + np.sin(np.arange(1000) / 50) + 0.02 * noise.normal(size=1000)).astype("f4")
    bytes_ = noise.permutation(np.arange(1000) % 256)
    message = LaserScan(angle_min=-np.pi, angle_increment=2 * np.pi / 1000, range_max=30.0)
    message.ranges, message.intensities = ranges.tolist(), bytes_.astype(float).tolist()
    message.header = Header(stamp=STAMP, frame_id=SENSOR)
    angles = np.float32(-np.pi) + np.arange(1000) * np.float32(2 * np.pi / 1000)
    places = [ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(1000)]
    return message, points(np.column_stack(places), bytes_)


def point_cloud(number: int) -> tuple[Any, Arrays]:
    """A cloud of 100,000 points with intensities of a byte."""
    noise = np.random.default_rng(number)
    count = 100_000
    values = np.empty((count, 4), "<f4")
    values[:, :3] = noise.normal(size=(count, 3)) * (10.0, 10.0, 1.0)
    bytes_ = noise.permutation(np.arange(count) % 256)
    values[:, 3] = bytes_
    message = PointCloud2(height=1, width=count, point_step=16, row_step=16 * count, is_dense=True)
    message.fields = [
        PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
        for at, name in enumerate(("x", "y", "z", "intensity"))
    ]
    message.data = values.tobytes()
    message.header = Header(stamp=STAMP, frame_id=SENSOR)
    return message, points(values[:, :3], bytes_)


def points(places: NDArray[Any], intensities: NDArray[np.int64]) -> Arrays:
    """What is drawn of points, the least of whose intensities is 0 and the greatest 255."""
    colors = np.array([rainbow(1.0 - value / 255) for value in range(256)], "u4")[intensities]
    positions = np.ascontiguousarray(places, np.float32)
    return {"Points3D:positions": positions, "Points3D:colors": colors}


def rainbow(value: float) -> int:
    """RViz's color of a value from 0 to 1, 0xRRGGBBAA."""
    part, rest = divmod(5.0 * value + 1.0, 1.0)
    n = 1.0 - (rest if int(part) % 2 else 1.0 - rest)
    rgb = {1: (n, 0, 1), 2: (0, n, 1), 3: (0, 1, n), 4: (n, 1, 0)}.get(int(part), (1, n, 0))
    red, green, blue = (round(255 * channel) for channel in rgb)
    return red << 24 | green << 16 | blue << 8 | 0xFF


def point_columns(arrays: Arrays, count: int) -> Any:
    """Positions and colors, a row for each message."""
    positions, colors = arrays.values()
    lengths = [len(positions) // count] * count
    return rr.Points3D.columns(positions=positions, colors=colors).partition(lengths)


def image(number: int) -> tuple[Any, Arrays]:
    """A picture of 640 x 480 pixels, with noise."""
    noise = np.random.default_rng(number).integers(0, 16, (480, 640, 3))
    pixels = (noise + np.arange(640)[:, None] // 3).astype(np.uint8)
    message = Image(width=640, height=480, encoding="rgb8", step=3 * 640, data=pixels.tobytes())
    message.header = Header(stamp=STAMP, frame_id=SENSOR)
    return message, {"Image:buffer": pixels.ravel()}


def image_columns(arrays: Arrays, _count: int) -> Any:
    """The picture and its format."""
    form = rr.components.ImageFormat(
        width=640, height=480, color_model="RGB", channel_datatype="U8"
    )
    return rr.Image.columns(buffer=[arrays["Image:buffer"]], format=[form])


def occupancy_grid(number: int) -> tuple[Any, Arrays]:
    """A map of 1000 x 1000 cells."""
    cells = np.random.default_rng(number).integers(-1, 101, (1000, 1000), np.int8)
    message = OccupancyGrid(data=cells.ravel().tolist())
    message.info.width, message.info.height, message.info.resolution = 1000, 1000, 0.05
    message.header = Header(stamp=STAMP, frame_id=FIXED)
    return message, {"GridMap:data": np.flipud(cells).view(np.uint8).ravel()}


def map_columns(arrays: Arrays, _count: int) -> Any:
    """The cells, and where they lie."""
    form = rr.components.ImageFormat(1000, 1000, color_model="L", channel_datatype="U8")
    return rr.GridMap.columns(
        data=[arrays["GridMap:data"]],
        format=[form],
        cell_size=[0.05],
        translation=[(0.0, 0.0, 0.0)],
        quaternion=[(0.0, 0.0, 0.0, 1.0)],
    )


def markers(number: int) -> tuple[Any, Arrays]:
    """1000 cubes of any sizes and colors, which move and turn."""
    noise, look = np.random.default_rng(number), np.random.default_rng(0)
    places, turns = noise.normal(size=(1000, 3)), noise.normal(size=(1000, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    scales, colors = look.uniform(0.1, 1.0, (1000, 3)), look.integers(0, 256, (1000, 4))
    rows = zip(places, turns, scales, colors, strict=True)
    message = MarkerArray()
    for index, (place, turn, scale, color) in enumerate(rows):
        marker = Marker(ns="boxes", id=index, type=Marker.CUBE)
        marker.header.frame_id = FIXED
        for part, names, values in (
            (marker.pose.position, "xyz", place),
            (marker.pose.orientation, "xyzw", turn),
            (marker.scale, "xyz", scale),
            (marker.color, "rgba", color / 255),
        ):
            for name, value in zip(names, values.tolist(), strict=True):
                setattr(part, name, value)
        message.markers.append(marker)
    cubes = {
        "InstancePoses3D:translations": places.astype(np.float32),
        "InstancePoses3D:quaternions": turns.astype(np.float32),
        "InstancePoses3D:scales": scales.astype(np.float32),
        "Boxes3D:colors": colors.astype("u1").view(">u4").astype("u4").ravel(),
    }
    return message, cubes


def marker_columns(arrays: Arrays, _count: int) -> Any:
    """Poses, sizes and colors of one row."""
    translations, quaternions, scales, colors = arrays.values()
    poses = rr.InstancePoses3D.columns(
        translations=translations, quaternions=quaternions, scales=scales
    )
    boxes = rr.Boxes3D.columns(colors=colors)
    return [*poses.partition([len(colors)]), *boxes.partition([len(colors)])]


def _display(
    kind: Any,
    what: str,
    topic: str,
    sample: Callable[[int], tuple[Any, Arrays]],
    columns: Callable[[Arrays, int], Any],
    part: str = "",
    **timing: int,
) -> Case:
    """A topic of one display; ``part``: of its entity, what is drawn."""
    name = type_name(kind)

    def samples(number: int) -> tuple[list[Any], list[Arrays]]:
        message, drawn = sample(number)
        return [message], [drawn]

    entity = f"{DRAWING_BY_TYPE[name].key}{topic}{part}"
    topics, drawn = {topic: name}, (Drawn(entity, columns),)
    return Case(f"{kind.__name__}, {what}", topics, drawn, samples, **timing)


CASES = (
    states(10),
    states(100),
    _display(LaserScan, "1000 rays", "/scan", laser_scan, point_columns, per_tick=2),
    _display(PointCloud2, "100,000 points", "/points", point_cloud, point_columns),
    _display(Image, "640x480 rgb8", "/image_raw", image, image_columns),
    _display(OccupancyGrid, "1000x1000", "/map", occupancy_grid, map_columns, tick_ns=SELDOM),
    _display(MarkerArray, "1000 cubes", "/boxes", markers, marker_columns, "/boxes/cubes"),
)
