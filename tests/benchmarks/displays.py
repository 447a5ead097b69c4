"""What a display costs for each message, against bare calls of Rerun with the same data.

The viewer receives raw messages as its node does, decodes and draws them, 20 times a second. The
floor is a ``send_columns`` a message of arrays that lie ready, with columns as Rerun's own makers
make them. Both write a file; then both files are read again, and must hold what was to be shown.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import onebot_bringup.viewer  # noqa: F401  before Rerun, whose log it quiets

# isort: split
import numpy as np
import rerun as rr
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from onebot_bringup.viewer.columns import TIMELINE
from onebot_bringup.viewer.display_server import Recording, open_recording
from onebot_bringup.viewer.displays.tf_display import TF
from onebot_bringup.viewer.inbox import DESCRIPTION
from onebot_bringup.viewer.robot_view import RobotView
from onebot_description.wire.messages import transforms_message
from tests.benchmarks.measuring import WrongAnswer, in_turn, median
from tests.benchmarks.recorded import batches
from tests.benchmarks.report import Goal, Options, Report, Value, at_most
from tests.benchmarks.viewer import Logger, bare_recording

FLOOR, OURS = "bare send_columns", "viewer"
_START_NS = 1_700_000_000_000_000_000
_STAMP = slice(4, 12)  # of a message whose first field is a header
_TICKS = 20  # of the viewer, a second
_GOAL = 2.0
_ROUNDING = 1e-5  # of numbers of 32 bits
_VARIANTS = 4  # messages that differ
_BYTES = 20_000_000  # that a round logs, about
_FIXED, _FRAME = "odom", "sensor"  # frames

Arrays = Mapping[str, NDArray[Any]]  # what is to be in the file, by Rerun's names


class Case(NamedTuple):
    """Messages of one kind."""

    name: str
    hertz: float
    entity: str  # to which the viewer logs them
    type: str
    # Returns a message, and what is drawn of it, by a number.
    sample: Callable[[int], tuple[Any, Arrays]]
    columns: Callable[[Arrays], Any]  # of ``send_columns``
    stamped: bool = True  # its first field is a header
    part: str = ""  # of the entity, below that of its topic

    @property
    def topic(self) -> str:
        """On which the messages come."""
        return "/" + self.entity.strip("/").removesuffix(self.part).partition("/")[2].rstrip("/")


# --- what is drawn --------------------------------------------------------------------------------


def laser_scan(number: int) -> tuple[LaserScan, Arrays]:
    """A scan of 1000 rays, with intensities of a byte."""
    noise = np.random.default_rng(number)
    ranges = (3.0 + np.sin(np.arange(1000) / 50) + 0.02 * noise.normal(size=1000)).astype("f4")
    bytes_ = noise.permutation(np.arange(1000) % 256)
    message = LaserScan(angle_min=-np.pi, angle_increment=2 * np.pi / 1000, range_max=30.0)
    message.ranges, message.intensities = ranges.tolist(), bytes_.astype(float).tolist()
    message.header.frame_id = _FRAME
    angles = np.float32(-np.pi) + np.arange(1000) * np.float32(2 * np.pi / 1000)
    places = [ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(1000)]
    return message, points(np.column_stack(places), bytes_)


def point_cloud(number: int) -> tuple[PointCloud2, Arrays]:
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
    message.header.frame_id = _FRAME
    return message, points(values[:, :3], bytes_)


def points(places: NDArray[Any], intensities: NDArray[np.int64]) -> Arrays:
    """What is drawn of points, the least of whose intensities is 0 and the greatest 255."""
    colors = np.array([rainbow(1.0 - value / 255) for value in range(256)], "u4")[intensities]
    positions = np.ascontiguousarray(places, np.float32)
    return {"Points3D:positions": positions, "Points3D:colors": colors}


def rainbow(value: float) -> int:
    """RViz's colour of a value from 0 to 1, 0xRRGGBBAA."""
    part, rest = divmod(5.0 * value + 1.0, 1.0)
    n = 1.0 - (rest if int(part) % 2 else 1.0 - rest)
    rgb = {1: (n, 0, 1), 2: (0, n, 1), 3: (0, 1, n), 4: (n, 1, 0)}.get(int(part), (1, n, 0))
    red, green, blue = (round(255 * channel) for channel in rgb)
    return red << 24 | green << 16 | blue << 8 | 0xFF


def point_columns(arrays: Arrays) -> Any:
    """Positions and colours of one row."""
    positions, colors = arrays.values()
    return rr.Points3D.columns(positions=positions, colors=colors).partition([len(positions)])


def image(number: int) -> tuple[Image, Arrays]:
    """A picture of 640 x 480 pixels, with noise."""
    noise = np.random.default_rng(number).integers(0, 16, (480, 640, 3))
    pixels = (noise + np.arange(640)[:, None] // 3).astype(np.uint8)
    message = Image(width=640, height=480, encoding="rgb8", step=3 * 640, data=pixels.tobytes())
    message.header.frame_id = _FRAME
    return message, {"Image:buffer": pixels.ravel()}


def image_columns(arrays: Arrays) -> Any:
    """The picture and its format."""
    form = rr.components.ImageFormat(
        width=640, height=480, color_model="RGB", channel_datatype="U8"
    )
    return rr.Image.columns(buffer=[arrays["Image:buffer"]], format=[form])


def occupancy_grid(number: int) -> tuple[OccupancyGrid, Arrays]:
    """A map of 1000 x 1000 cells."""
    cells = np.random.default_rng(number).integers(-1, 101, (1000, 1000), np.int8)
    message = OccupancyGrid(data=cells.ravel().tolist())
    message.info.width, message.info.height, message.info.resolution = 1000, 1000, 0.05
    message.header.frame_id = _FIXED
    return message, {"GridMap:data": np.flipud(cells).view(np.uint8).ravel()}


def map_columns(arrays: Arrays) -> Any:
    """The cells, and where they lie."""
    form = rr.components.ImageFormat(1000, 1000, color_model="L", channel_datatype="U8")
    return rr.GridMap.columns(
        data=[arrays["GridMap:data"]],
        format=[form],
        cell_size=[0.05],
        translation=[(0.0, 0.0, 0.0)],
        quaternion=[(0.0, 0.0, 0.0, 1.0)],
    )


def markers(number: int) -> tuple[MarkerArray, Arrays]:
    """1000 cubes of any sizes and colours, which move and turn."""
    noise, look = np.random.default_rng(number), np.random.default_rng(0)
    places, turns = noise.normal(size=(1000, 3)), noise.normal(size=(1000, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    scales, colors = look.uniform(0.1, 1.0, (1000, 3)), look.integers(0, 256, (1000, 4))
    rows = zip(places, turns, scales, colors, strict=True)
    message = MarkerArray()
    for index, (place, turn, scale, color) in enumerate(rows):
        marker = Marker(ns="boxes", id=index, type=Marker.CUBE)
        marker.header.frame_id = _FIXED
        for part, names, values in (
            (marker.pose.position, "xyz", place),
            (marker.pose.orientation, "xyzw", turn),
            (marker.scale, "xyz", scale),
            (marker.color, "rgba", color / 255),
        ):
            for name, value in zip(names, values.tolist(), strict=True):
                setattr(part, name, value)
        message.markers.append(marker)
    return message, {
        "InstancePoses3D:translations": places.astype(np.float32),
        "InstancePoses3D:quaternions": turns.astype(np.float32),
        "InstancePoses3D:scales": scales.astype(np.float32),
        "Boxes3D:colors": colors.astype("u1").view(">u4").astype("u4").ravel(),
    }


def marker_columns(arrays: Arrays) -> Any:
    """Poses, sizes and colours of one row."""
    translations, quaternions, scales, colors = arrays.values()
    poses = rr.InstancePoses3D.columns(
        translations=translations, quaternions=quaternions, scales=scales
    )
    boxes = rr.Boxes3D.columns(colors=colors)
    return [*poses.partition([len(colors)]), *boxes.partition([len(colors)])]


CASES = (
    Case(
        "LaserScan, 1000 rays",
        40.0,
        "/laser_scan/scan",
        "sensor_msgs/msg/LaserScan",
        laser_scan,
        point_columns,
    ),
    Case(
        "PointCloud2, 100,000 points",
        10.0,
        "/point_cloud2/points",
        "sensor_msgs/msg/PointCloud2",
        point_cloud,
        point_columns,
    ),
    Case(
        "Image, 640x480 rgb8",
        30.0,
        "/image/image_raw",
        "sensor_msgs/msg/Image",
        image,
        image_columns,
    ),
    Case(
        "OccupancyGrid, 1000x1000",
        5.0,
        "/map/map",
        "nav_msgs/msg/OccupancyGrid",
        occupancy_grid,
        map_columns,
    ),
    Case(
        "MarkerArray, 1000 cubes",
        20.0,
        "/marker/boxes/boxes/cubes",
        "visualization_msgs/msg/MarkerArray",
        markers,
        marker_columns,
        stamped=False,
        part="/boxes/cubes",
    ),
)


# --- who logs it ----------------------------------------------------------------------------------


class Messages:
    """Messages of a case, over and over the same but for their stamps."""

    def __init__(self, case: Case) -> None:
        samples = [case.sample(number) for number in range(_VARIANTS)]
        self.arrays = [arrays for _, arrays in samples]
        self._raw = [bytearray(serialize_message(message)) for message, _ in samples]
        self._stamped = case.stamped
        self._period = round(1e9 / case.hertz)
        self.in_a_round = min(200, max(10, _BYTES // len(self._raw[0])))

    def raw(self, number: int) -> bytes:
        """Return a message as it comes."""
        data = self._raw[number % _VARIANTS]
        if self._stamped:
            stamp = divmod(self.stamp(number), 10**9)
            data[_STAMP] = np.array(stamp, "<u4").tobytes()
        return bytes(data)

    def stamp(self, number: int) -> int:
        """When a message is, nanoseconds."""
        return _START_NS + number * self._period


class Viewer:
    """Receives raw messages and logs them as the viewer's node does."""

    def __init__(self, case: Case, messages: Messages, file: Path) -> None:
        self._case, self._messages = case, messages
        self._per_tick = max(1, round(case.hertz / _TICKS))
        self.recording: Recording = open_recording(save=file)
        self._view = RobotView(self.recording.stream)
        self._view.offer({case.topic: case.type})
        urdf = String(data=f'<robot name="robot"><link name="{_FIXED}"/></robot>')
        described = bytes(serialize_message(urdf))
        self._view.take("robot_description", DESCRIPTION.name, described, _START_NS)
        place = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
        data = bytes(serialize_message(transforms_message(Time(), [_FIXED], [_FRAME], place)))
        self._view.take("/tf_static", TF.name, data, _START_NS)

    def prepare(self, first: int, count: int) -> list[tuple[int, bytes]]:
        """Return messages, and when each comes."""
        numbers = range(first, first + count)
        return [(self._messages.stamp(number), self._messages.raw(number)) for number in numbers]

    def log(self, messages: Sequence[tuple[int, bytes]]) -> None:
        """Take in messages, and log them."""
        for number, (now_ns, data) in enumerate(messages, 1):
            self._view.take(self._case.topic, self._case.type, data, now_ns)
            if not number % self._per_tick:
                self._view.tick(now_ns)
        self._view.finish()


class Bare:
    """Logs the same by nothing but Rerun's own calls."""

    def __init__(self, case: Case, messages: Messages, file: Path) -> None:
        self._case, self._messages = case, messages
        self.recording = bare_recording(file)

    def prepare(self, first: int, count: int) -> list[tuple[int, Arrays]]:
        """Return the arrays of messages, and when each is."""
        return [
            (self._messages.stamp(number), self._messages.arrays[number % _VARIANTS])
            for number in range(first, first + count)
        ]

    def log(self, rows: Sequence[tuple[int, Arrays]]) -> None:
        """Log the arrays."""
        for stamp_ns, arrays in rows:
            index = rr.TimeColumn(TIMELINE, timestamp=np.array([stamp_ns], "datetime64[ns]"))
            columns = self._case.columns(arrays)
            self.recording.stream.send_columns(self._case.entity, indexes=[index], columns=columns)


# --- the measurement ------------------------------------------------------------------------------


def run(options: Options) -> Report:
    """Measure all cases."""
    rows: list[dict[str, Value]] = []
    goals: list[Goal] = []
    for case in CASES:
        options.say(f"displays: {case.name}")
        taken = measure(case, options)
        over = median([a / b for a, b in zip(taken[OURS], taken[FLOOR], strict=True)])
        ours, floor = median(taken[OURS]), median(taken[FLOOR])
        busy = 1e-4 * ours * case.hertz  # us a second, as percent
        names = ("Message", "Hz", "CPU us/message", "bare", "over bare", "% of a core")
        values = (case.name, case.hertz, ours, floor, over, busy)
        rows.append(dict(zip(names, values, strict=True)))
        goals.append(at_most(f"{case.name}: CPU per message over bare calls", over, _GOAL))
    notes = [
        "Bare calls have their arrays ready, and columns as Rerun's own makers make them; the "
        "viewer decodes messages and computes points and colours. Processor time of all threads, "
        "Rerun's too, which write a file. All that was logged was read from the files again, and "
        "is what was to be shown."
    ]
    return Report("displays", rows, goals, notes)


def measure(case: Case, options: Options) -> dict[str, list[float]]:
    """Log messages in turn; return the time of each, a number a round.

    Raises:
        WrongAnswer: a file does not hold what was to be shown.
    """
    messages = Messages(case)
    count = options.choose(messages.in_a_round, 4)
    with TemporaryDirectory() as folder:
        files = {name: Path(folder) / f"{number}.rrd" for number, name in enumerate((OURS, FLOOR))}
        whats = {
            OURS: Viewer(case, messages, files[OURS]),
            FLOOR: Bare(case, messages, files[FLOOR]),
        }
        loggers = {name: Logger(what) for name, what in whats.items()}
        for logger in loggers.values():
            logger.log(count)  # to get warm
        variants = {name: (lambda it=it: it.log(count)) for name, it in loggers.items()}
        taken = in_turn(variants, options.choose(9, 1))
        for name, logger in loggers.items():
            logger.what.recording.close()
            check(case, messages, logger.logged, files[name], name)
    return taken


def check(case: Case, messages: Messages, count: int, file: Path, name: str) -> None:
    """Compare what is in a file with what was to be shown.

    Raises:
        WrongAnswer: it is not the same.
    """
    number = 0
    for stamp_ns, found in _rows(file, case.entity, messages.arrays[0]):
        if stamp_ns != messages.stamp(number):
            raise WrongAnswer(f"{name}, {case.name}: message {number} is at {stamp_ns} ns")
        for column, expected in messages.arrays[number % _VARIANTS].items():
            if not _alike(found[column], expected):
                raise WrongAnswer(f"{name}, {case.name}: {column} of message {number} differs")
        number += 1
    if number != count:
        raise WrongAnswer(f"{name}, {case.name}: {number} messages in the file, {count} logged")


def _rows(file: Path, entity: str, columns: Arrays) -> Iterator[tuple[int, Arrays]]:
    """Yield the time of each row of an entity, and what some of its columns are from then on."""
    known: dict[str, NDArray[Any]] = {}
    for batch in batches(file, entity):
        stamps = batch.column(TIMELINE).cast("int64").to_numpy()
        for row, stamp_ns in enumerate(stamps.tolist()):
            for name in set(columns).intersection(batch.schema.names):
                if batch.column(name)[row].values is not None:
                    known[name] = _numbers(batch.column(name)[row].values)
            yield stamp_ns, known


def _numbers(array: Any) -> NDArray[Any]:
    while hasattr(array, "flatten") and array.type.num_fields:
        array = array.flatten()
    found: NDArray[Any] = array.to_numpy()
    return found


def _alike(found: NDArray[Any], expected: NDArray[Any]) -> bool:
    """Whether numbers are the same, and the bytes of colours within a step of rounding."""
    if found.size != expected.size or found.dtype != expected.dtype:
        return False
    if found.dtype.kind == "f":
        return bool(np.abs(found - expected.ravel()).max(initial=0.0) <= _ROUNDING)
    steps = found.view(np.uint8).astype(np.int16) - expected.ravel().view(np.uint8)
    return bool(np.abs(steps).max(initial=0) <= (1 if found.dtype == np.uint32 else 0))
