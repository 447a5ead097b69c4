"""A rosbag2 being recorded: a folder with metadata.yaml and an MCAP file, readable at any time."""

import contextlib
import json
import os
import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from onebot_bringup.introspection.interfaces import definition_file
from onebot_description.errors import OneBotError

# Messages packed into the chunks of an MCAP file, and the summary that a file ends with.

MAGIC = b"\x89MCAP0\r\n"
_ZSTD = "zstd"


def packed(records: Iterable[McapRecord]) -> bytes:
    """Return ``records`` as bytes, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return _taken(builder)


def _taken(builder: RecordBuilder) -> bytes:
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


@dataclass(frozen=True)
class PackedChunk:
    """A chunk as it stands in a file.

    Attributes:
        data: the chunk and the indexes of its messages.
        index: the record that leads to it from the summary.
    """

    data: bytes
    index: bytes


class OpenChunk:
    """Messages on their way into a file. It can be packed at any time, and goes on growing."""

    def __init__(self) -> None:
        """Hold nothing."""
        self._builder = RecordBuilder()
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        self._start = self._end = 0

    @property
    def size(self) -> int:
        """Bytes, before compression."""
        return self._builder.count

    @property
    def empty(self) -> bool:
        """There is no message in it."""
        return not self._indexes

    def add_record(self, record: Schema | Channel) -> None:
        """Add what messages refer to."""
        record.write(self._builder)

    def add_message(self, message: Message) -> None:
        """Add a message; its channel was added before, to this chunk or an earlier one."""
        time = message.log_time
        self._start = min(time, self._start) if self._indexes else time
        self._end = max(time, self._end)
        entry = (time, self._builder.count)
        self._indexes.setdefault(message.channel_id, []).append(entry)
        message.write(self._builder)

    def packed(self, offset: int, compress: bool) -> PackedChunk:
        """Return the chunk as it is now.

        Args:
            offset: of the chunk in the file, bytes.
            compress: with zstd.
        """
        plain = _taken(self._builder)
        self._builder.write(plain)  # taking it out had emptied the builder
        # Its fastest level: what is not full yet is packed again every second.
        stored = zstandard.compress(plain, 1) if compress else plain
        compression = _ZSTD if compress else ""
        crc = zlib.crc32(plain)
        chunk = Chunk(compression, stored, self._end, self._start, crc, len(plain))
        data = packed([chunk])
        indexes, offsets = [], {}
        place = offset + len(data)
        for channel, entries in self._indexes.items():
            offsets[channel] = place
            indexes.append(packed([MessageIndex(channel, entries)]))
            place += len(indexes[-1])
        index = ChunkIndex(
            chunk_length=len(data),
            chunk_start_offset=offset,
            compression=compression,
            compressed_size=len(stored),
            message_end_time=self._end,
            message_index_length=place - offset - len(data),
            message_index_offsets=offsets,
            message_start_time=self._start,
            uncompressed_size=len(plain),
        )
        return PackedChunk(b"".join((data, *indexes)), packed([index]))


def ending(
    offset: int, schemas: bytes, channels: bytes, statistics: Statistics, chunk_indexes: bytes
) -> bytes:
    """Return what follows the last chunk: the summary and all else that makes a file complete.

    Args:
        offset: where it will stand in the file, bytes.
        schemas: all of them, packed.
        channels: all of them, packed.
        statistics: of the whole file.
        chunk_indexes: of all chunks, packed.
    """
    data_end = packed([DataEnd(0)])
    start = place = offset + len(data_end)
    groups = {
        Opcode.SCHEMA: schemas,
        Opcode.CHANNEL: channels,
        Opcode.STATISTICS: packed([statistics]),
        Opcode.CHUNK_INDEX: chunk_indexes,
    }
    offsets = []
    for opcode, group in groups.items():
        if group:
            offsets.append(SummaryOffset(opcode, place, len(group)))
            place += len(group)
    summary = b"".join((*groups.values(), packed(offsets)))
    # The checksum covers the footer up to itself: opcode, length (20) and the two offsets.
    head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, place)
    footer = Footer(start, place, zlib.crc32(head, zlib.crc32(summary)))
    return b"".join((data_end, summary, packed([footer]), MAGIC))


# An MCAP file that is complete at (almost) every moment, whatever ends its writer.

CHUNK_SIZE = 768 * 1024  # bytes, rosbag2's
_MOST_PENDING = 16 * 1024 * 1024  # bytes kept in memory between two checkpoints


class McapFile:
    """A new MCAP file of ROS 2 messages.

    Attributes:
        path: of the file.
        statistics: of all messages added.
    """

    def __init__(
        self, path: Path, *, compress: bool = True, library: str = "", chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Create the file ``path``, complete but without a message.

        Args:
            path: must not exist.
            compress: chunks, with zstd.
            library: who writes it, for the header.
            chunk_size: bytes, before compression.

        Raises:
            OSError: it cannot be created or written.
        """
        self.path = path
        self.statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self._compress = compress
        self._chunk_size = chunk_size
        self._schemas = self._channels = b""
        self._chunk = OpenChunk()
        self._chunk_indexes = bytearray()
        self._pending = bytearray(MAGIC + packed([Header("ros2", library)]))
        self._end = 0  # where ``_pending`` goes in the file
        self._ending = b""  # what the file holds from there on
        self._changed = True
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self.checkpoint()

    def add_schema(self, name: str, definition: str) -> int:
        """Add a message type and return its id.

        Args:
            name: such as ``std_msgs/msg/String``.
            definition: its .msg file and those it refers to, as rosbag2 joins them.
        """
        self.statistics.schema_count += 1
        schema = Schema(self.statistics.schema_count, definition.encode(), "ros2msg", name)
        self._schemas += packed([schema])
        self._chunk.add_record(schema)
        self._changed = True
        return schema.id

    def add_channel(self, topic: str, schema_id: int, metadata: dict[str, str]) -> int:
        """Add a topic and return its id."""
        self.statistics.channel_count += 1
        channel = Channel(self.statistics.channel_count, topic, "cdr", metadata, schema_id)
        self._channels += packed([channel])
        self._chunk.add_record(channel)
        self.statistics.channel_message_counts[channel.id] = 0
        self._changed = True
        return channel.id

    def add_message(self, channel_id: int, log_time: int, publish_time: int, data: bytes) -> None:
        """Add a message, to be written by the next checkpoint at the latest.

        Args:
            channel_id: of its topic.
            log_time: when it was received, nanoseconds.
            publish_time: when it was sent, nanoseconds.
            data: as on the wire, CDR.

        Raises:
            OSError: so much was added that it had to be written, and could not be.
        """
        statistics = self.statistics
        counts = statistics.channel_message_counts
        counts[channel_id] += 1
        first = not statistics.message_count
        statistics.message_count += 1
        start = log_time if first else min(log_time, statistics.message_start_time)
        statistics.message_start_time = start
        statistics.message_end_time = max(log_time, statistics.message_end_time)
        message = Message(channel_id, log_time, data, publish_time, counts[channel_id])
        self._chunk.add_message(message)
        self._changed = True
        if self._chunk.size >= self._chunk_size:
            self._close_chunk()
            if len(self._pending) > _MOST_PENDING:
                self.checkpoint()

    def _close_chunk(self) -> None:
        chunk = self._chunk.packed(self._end + len(self._pending), self._compress)
        self._pending += chunk.data
        self._chunk_indexes += chunk.index
        self.statistics.chunk_count += 1
        self._chunk = OpenChunk()

    def checkpoint(self) -> bool:
        """Write all that was added, so that the file is complete; False if there was nothing.

        Raises:
            OSError: it cannot be written (the disk is full, say); the file is left, complete, as
                the checkpoint before it.
        """
        if not self._changed:
            return False
        end = self._end + len(self._pending)
        tail = self._tail(end)
        try:
            self._write(self._pending + tail, self._end)
        except OSError:
            with contextlib.suppress(OSError):  # the error that counts is the first
                self._write(self._ending, self._end)
            raise
        self._end, self._ending = end, tail
        self._pending = bytearray()
        self._changed = False
        return True

    def _tail(self, offset: int) -> bytes:
        """What the file ends with for now: the open chunk as it is, and the ending."""
        data = index = b""
        statistics = self.statistics
        if not self._chunk.empty:
            chunk = self._chunk.packed(offset, self._compress)
            data, index = chunk.data, chunk.index
            statistics.chunk_count += 1
        indexes = bytes(self._chunk_indexes) + index
        last = ending(offset + len(data), self._schemas, self._channels, statistics, indexes)
        statistics.chunk_count -= bool(data)
        return data + last

    def _write(self, data: bytes | bytearray, offset: int) -> None:
        """Let the file end with ``data`` from ``offset`` on."""
        view, place = memoryview(data), offset
        while view:  # once, unless the disk is full
            written = os.pwrite(self._file, view, place)
            view, place = view[written:], place + written
        if os.fstat(self._file).st_size > place:
            os.ftruncate(self._file, place)

    @property
    def vanished(self) -> bool:
        """The file was deleted or moved away: nobody would find what is still written."""
        try:
            return not os.path.samestat(os.stat(self.path), os.fstat(self._file))
        except OSError:
            return True

    def close(self) -> None:
        """Write what is left and close the file.

        Raises:
            OSError: it cannot be written.
        """
        try:
            self.checkpoint()
        finally:
            os.close(self._file)


# The text that defines a message type: its .msg file, and those of all types in it.

_TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_DELIMITER = "=" * 80
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z0-9_/]+)(?:<=\d+)?(?:\[[^]]*\])?\s", re.MULTILINE)
_PRIMITIVE = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 string "
    "wstring".split()
)


@cache
def full_definition(name: str) -> str:
    """Return the definition of a message type as rosbag2 keeps it with the messages.

    The .msg file comes first; those it refers to follow, each once and under a line of its own.

    Args:
        name: such as ``geometry_msgs/msg/Twist``.

    Raises:
        OneBotError: a .msg file is not installed.
    """
    return _joined(name, set())


def _joined(name: str, seen: set[str]) -> str:
    text = _own(name)
    package = name.partition("/")[0]
    parts = [text]
    for kind in sorted({*_FIELD_TYPE.findall(text)} - _PRIMITIVE):
        full = kind if "/" in kind else f"{package}/{kind}"
        if full not in seen:
            seen.add(full)
            home, _, short = full.rpartition("/")
            nested = _joined(f"{home.partition('/')[0]}/msg/{short}", seen)
            parts.append(f"\n{_DELIMITER}\nMSG: {full}\n{nested}")
    return "".join(parts)


def _own(name: str) -> str:
    try:
        return definition_file(name).read_text()
    except OneBotError:
        if name == _TF_MESSAGE:  # ours, where tf2_msgs is not installed
            return "geometry_msgs/TransformStamped[] transforms\n"
        raise


# rosbag2's metadata.yaml, version 9 (Jazzy's): what is in a recording's folder.

FILE_NAME = "metadata.yaml"
_INFINITE = 2**63 - 1  # ns; what rosbag2 writes for an infinite duration, and for no start


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers, in rosbag2's words.

    Attributes:
        reliability: ``reliable`` or ``best_effort``.
        durability: ``volatile`` or ``transient_local``.
        liveliness: ``automatic`` or ``manual_by_topic``.
        history: ``unknown``, because DDS does not tell it; or ``keep_last``, ``keep_all``.
        depth: of the history.
        deadline: nanoseconds; None for infinite.
        lifespan: nanoseconds; None for infinite.
        lease: of the liveliness, nanoseconds; None for infinite.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    liveliness: str = "automatic"
    history: str = "unknown"
    depth: int = 0
    deadline: int | None = None
    lifespan: int | None = None
    lease: int | None = None


@dataclass(frozen=True)
class Topic:
    """A topic in a recording: its name, full type name, type hash (RIHS01_...) and publishers."""

    name: str
    type: str
    hash: str = ""
    offered: tuple[Qos, ...] = ()


def qos_yaml(offered: Iterable[Qos], indent: str = "") -> str:
    """Return profiles as the YAML list that rosbag2 writes; ``[]`` of none."""
    lines = []
    for qos in offered:
        lines += [
            f"- history: {qos.history}",
            f"  depth: {qos.depth}",
            f"  reliability: {qos.reliability}",
            f"  durability: {qos.durability}",
            *_duration("deadline", qos.deadline),
            *_duration("lifespan", qos.lifespan),
            f"  liveliness: {qos.liveliness}",
            *_duration("liveliness_lease_duration", qos.lease),
            "  avoid_ros_namespace_conventions: false",
        ]
    return "\n".join(indent + line for line in lines) or f"{indent}[]"


def _duration(name: str, nanoseconds: int | None) -> list[str]:
    sec, nsec = divmod(_INFINITE if nanoseconds is None else nanoseconds, 10**9)
    return [f"  {name}:", f"    sec: {sec}", f"    nsec: {nsec}"]


@dataclass(frozen=True)
class Extent:
    """How much a recording holds: messages, and when the first and the last came (ns)."""

    count: int
    start: int
    end: int


def metadata_yaml(file: str, extent: Extent, topics: Mapping[Topic, int]) -> str:
    """Return the text of metadata.yaml for a recording of one MCAP file.

    Args:
        file: the file's name.
        extent: of all messages.
        topics: the number of messages of each.
    """
    start = extent.start if extent.count else _INFINITE
    duration = extent.end - extent.start
    name = json.dumps(file, ensure_ascii=False)  # whatever it contains
    head = f"""\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: {duration}
  starting_time:
    nanoseconds_since_epoch: {start}
  message_count: {extent.count}
  topics_with_message_count:"""
    body = "".join(_topic_yaml(topic, count) for topic, count in topics.items())
    tail = f"""\
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - {name}
  files:
    - path: {name}
      starting_time:
        nanoseconds_since_epoch: {start}
      duration:
        nanoseconds: {duration}
      message_count: {extent.count}
  custom_data: ~
  ros_distro: jazzy
"""
    return f"{head}\n{body}{tail}" if body else f"{head} []\n{tail}"


def _topic_yaml(topic: Topic, count: int) -> str:
    return f"""\
    - topic_metadata:
        name: {topic.name}
        type: {topic.type}
        serialization_format: cdr
        offered_qos_profiles:
{qos_yaml(topic.offered, " " * 10)}
        type_description_hash: {topic.hash or '""'}
      message_count: {count}
"""


class BagWriter:
    """Writes messages into a new folder; see ``McapFile`` for what is safe when.

    Attributes:
        folder: the recording.
        open: messages are taken; False once closed, or after a failure.
    """

    def __init__(
        self, folder: Path, *, compress: bool = True, chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Make the folder, with a recording of no messages.

        Args:
            folder: must not exist, as ``ros2 bag record`` wants it; the one above it must.
            compress: the messages, with zstd.
            chunk_size: bytes that are compressed together.

        Raises:
            OneBotError: it cannot be made.
        """
        self.folder = folder
        self._topics: dict[Topic, int] = {}
        self._schemas: dict[str, int] = {}
        self.open = False
        with self._explained():
            try:
                folder.mkdir()
            except FileExistsError:
                raise OneBotError(f"{folder} exists already: name a new folder") from None
            path = folder / f"{folder.name}_0.mcap"
            self._file = McapFile(path, compress=compress, library="onebot", chunk_size=chunk_size)
            self.open = True
            self._write_metadata()

    @property
    def message_count(self) -> int:
        """Of all topics."""
        return self._file.statistics.message_count

    @property
    def topic_count(self) -> int:
        """Topics added so far."""
        return len(self._topics)

    def add_topic(self, topic: Topic) -> int:
        """Add a topic, and return what ``write`` calls it.

        Raises:
            OneBotError: the definition of its type is not installed.
        """
        schema = self._schema(topic.type)
        metadata = {"offered_qos_profiles": qos_yaml(topic.offered), "topic_type_hash": topic.hash}
        number = self._file.add_channel(topic.name, schema, metadata)
        self._topics[topic] = number
        return number

    def _schema(self, type_name: str) -> int:
        if type_name not in self._schemas:
            definition = full_definition(type_name)
            self._schemas[type_name] = self._file.add_schema(type_name, definition)
        return self._schemas[type_name]

    def write(self, topic: int, time_ns: int, data: bytes, publish_ns: int | None = None) -> None:
        """Add a message.

        Args:
            topic: from ``add_topic``.
            time_ns: when it was received, nanoseconds.
            data: CDR, as on the wire.
            publish_ns: when it was sent, nanoseconds; None where that is not known.

        Raises:
            OneBotError: it cannot be written; what was written before is kept.
        """
        if self.open:
            with self._explained():
                sent = time_ns if publish_ns is None else publish_ns
                self._file.add_message(topic, time_ns, sent, data)

    def checkpoint(self) -> None:
        """Make the folder hold all that was added; about once a second.

        Raises:
            OneBotError: it cannot be written, or the folder is gone.
        """
        if not self.open:
            return
        with self._explained():
            if self._file.vanished:
                raise OneBotError(f"{self._file.path} was deleted or moved while recording")
            if self._file.checkpoint():
                self._write_metadata()

    def _write_metadata(self) -> None:
        statistics = self._file.statistics
        extent = Extent(
            statistics.message_count, statistics.message_start_time, statistics.message_end_time
        )
        counts = statistics.channel_message_counts
        topics = {topic: counts[number] for topic, number in self._topics.items()}
        text = metadata_yaml(self._file.path.name, extent, topics)
        # Replaced as a whole: a reader, or a kill, never meets half of it.
        new = self.folder / f".{FILE_NAME}"
        try:
            new.write_text(text)
            os.replace(new, self.folder / FILE_NAME)
        except OSError:
            new.unlink(missing_ok=True)
            raise

    def close(self) -> None:
        """Write what is left.

        Raises:
            OneBotError: it cannot be written.
        """
        if self.open:
            try:
                self.checkpoint()
            finally:
                self._stop()

    def _stop(self) -> None:
        if self.open:
            self.open = False
            with contextlib.suppress(OSError):  # of a second attempt; the first one told why
                self._file.close()

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn a failure to write into one sentence, and end the recording."""
        try:
            yield
        except OSError as error:
            self._stop()
            raise OneBotError(f"cannot record to {self.folder}: {error.strerror}") from error
        except OneBotError:
            self._stop()
            raise
