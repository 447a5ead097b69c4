"""Recordings of other people's robots, as rosbag2 of several distros writes them."""

import sqlite3
from contextlib import closing

from geometry_msgs.msg import TransformStamped
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from onebot_description.ros.wire.definition import type_name
from onebot_description.ros.wire.interfaces import TFMessage

SECOND = 10**9
START = 1_700_000_000 * SECOND
# One of Autoware's, not installed here.
VELOCITY_REPORT = "autoware_vehicle_msgs/msg/VelocityReport"
_DEFINITION = """\
std_msgs/Header header
float32 longitudinal_velocity
float32 lateral_velocity
float32 heading_rate
"""


def transform(parent, child, x=0.0, time=0.0):
    """A message of /tf with one transform."""
    found = TransformStamped(child_frame_id=child)
    found.header.frame_id = parent
    found.header.stamp.sec, found.header.stamp.nanosec = divmod(START + int(time * SECOND), SECOND)
    found.transform.translation.x = x
    return TFMessage(transforms=[found])


class OtherRobot:
    """Writes a recording: a context, which closes it."""

    def __init__(
        self,
        folder,
        distro=Stores.ROS2_HUMBLE,
        plugin=StoragePlugin.SQLITE3,
        compression=CompressionMode.NONE,
    ):
        self._folder, self._distro = folder, distro
        self._sqlite = plugin == StoragePlugin.SQLITE3
        self._types = get_typestore(distro)
        self._types.register(get_types_from_msg(_DEFINITION, VELOCITY_REPORT))
        self._writer = Writer(folder, version=8, storage_plugin=plugin)
        self._writer.set_compression(compression, CompressionFormat.ZSTD)
        self._topics = {}

    def __enter__(self):
        self._writer.open()
        return self

    def __exit__(self, *_):
        self._writer.close()
        if self._sqlite and self._distro in (Stores.ROS2_FOXY, Stores.ROS2_HUMBLE):
            (path,) = self._folder.glob("*.db3")
            _make_older(path)

    def add(self, topic, kind, definition=None):
        """Add a topic; the definition of its type is the distro's, unless given."""
        known = {"typestore": self._types} if definition is None else {"msgdef": definition}
        self._topics[topic] = self._writer.add_connection(
            topic, kind, rihs01="RIHS01_" + "0" * 64, **known
        )

    def write(self, topic, message, time=0.0, *, stamp=None, frame="", kind="", definition=None):
        """Write a message received ``time`` seconds after the start, with that stamp or another.

        Args:
            topic: its full name.
            message: of a class of rclpy; or its bytes, with ``kind``.
            time: seconds.
            stamp: seconds since 1970; by default, when it was received.
            frame: of its header, if it has one.
            kind: the type of bytes.
            definition: of the type, if not the distro's.
        """
        time_ns = START + round(time * SECOND)
        if not isinstance(message, bytes):
            kind = type_name(message)
            if hasattr(message, "header"):
                message.header.frame_id = frame
                stamp_ns = time_ns if stamp is None else round(stamp * SECOND)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND)
            message = bytes(serialize_message(message))
        if topic not in self._topics:
            self.add(topic, kind, definition)
        self._writer.write(self._topics[topic], time_ns, message)

    def write_velocity(self, topic, speed, time=0.0):
        """Write a ``VELOCITY_REPORT``."""
        header, report = (
            self._types.types[name] for name in ("std_msgs/msg/Header", VELOCITY_REPORT)
        )
        stamp = self._types.types["builtin_interfaces/msg/Time"](
            *divmod(START + round(time * SECOND), SECOND)
        )
        message = report(header(stamp, "base_link"), speed, 0.0, 0.0)
        data = bytes(self._types.serialize_cdr(message, VELOCITY_REPORT))
        self.write(topic, data, time, kind=VELOCITY_REPORT)


def _make_older(path):
    """Remove what SQLite files have only from Iron on."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("DROP TABLE message_definitions")
        database.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
        database.execute("UPDATE schema SET schema_version = 3")
