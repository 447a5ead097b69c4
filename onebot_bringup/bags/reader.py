"""Reads recordings of ROS 2, ours or anyone's: MCAP files, SQLite files, and folders of them."""

import heapq
import io
import math
import os
import shutil
import sqlite3
import struct
import tempfile
import weakref
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Set
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, NamedTuple

import lz4.frame
import yaml
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from onebot_bringup.bags.writer import METADATA, Qos
from onebot_bringup.introspection.interfaces import full_definition
from onebot_description.errors import OneBotError, natural_order
from onebot_description.parameters import bounded_yaml
from onebot_description.wire.cdr import NANO

MAX_SIZE = 256_000_000  # bytes
_FILE_RATIO = 100  # a file that is compressed as a whole becomes larger by at most as much

# rosbag2's own compression, of files or of each message, beside that of the chunks in an MCAP file.
_ZSTD = "zstd"
_COMPRESSED = f".{_ZSTD}"
_FRAME = b"\x28\xb5\x2f\xfd"  # how zstd's data begins, and no CDR does
_ROS1 = ".bag"
# What mcap, the decompressors and sqlite3 raise for damaged files.
_DAMAGE = (
    McapError, OSError, struct.error, zstandard.ZstdError, sqlite3.Error, ValueError, KeyError,
    EOFError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
_CDR = "cdr"
_MSG = "ros2msg"  # the encoding of definitions that are .msg text, not IDL
_OFFERED = "offered_qos_profiles"
_INFINITE_S = 2**31 - 1  # s: this or more stands for an infinite duration; in Foxy it is this

_RECORD = struct.Struct("<BQ")  # how a record of MCAP begins: what it is, and its length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, time of receipt and of publishing
_FOOTER = struct.Struct("<Q12x8s")  # where the summary starts, and the magic bytes
_READ = {
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHUNK_INDEX,
    Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER,
}  # fmt: skip
_OVERHEAD = 300  # bytes of a message in memory beside its data

_LOGGED = b"\2\2"  # in the header of a SQLite file: it is written by way of a log
_STEPS = 100_000  # of SQLite, some milliseconds, between two moments at which Ctrl-C counts
# A view may have rows without end, and so may what is computed: only what is stored is read.
_TABLES = """
    SELECT name FROM sqlite_master
    WHERE type = 'table' AND rootpage > 0 AND name IN ('topics', 'messages', 'message_definitions')
        AND NOT EXISTS (SELECT 1 FROM pragma_table_xinfo(sqlite_master.name) WHERE hidden)
"""
_TOPICS = "SELECT * FROM topics WHERE serialization_format = 'cdr'"
_DEFINITIONS = """
    SELECT topic_type, encoded_message_definition FROM message_definitions
    WHERE encoding = 'ros2msg' AND encoded_message_definition NOTNULL
"""  # from Iron on
_EXTENTS = """
    SELECT topic_id, count(*), CAST(min(timestamp) AS INTEGER), CAST(max(timestamp) AS INTEGER)
    FROM messages WHERE timestamp NOTNULL GROUP BY topic_id
"""
_MESSAGES = """
    SELECT topic_id, CAST(timestamp AS INTEGER), length(data),
        CASE WHEN length(data) <= ? THEN CAST(data AS BLOB) END
    FROM messages WHERE topic_id IN ({}) AND data NOTNULL AND timestamp NOTNULL
    ORDER BY timestamp, id
"""


class BagMessage(NamedTuple):
    """A recorded message."""

    topic: str
    type: str  # package/msg/Type
    time: int  # when it was received, nanoseconds
    data: bytes  # CDR, as on the wire


class Bag:
    """A recording that exists.

    Attributes:
        source: the file or folder.
        files: those with the messages, in their order.
        storage: how they are stored, as rosbag2 names it: mcap or sqlite3.
        distro: of the ROS that recorded it, in lower case; "" if that is not known.
        topics: the type of each topic, ``package/msg/Type``; the first one, if it has several.
        definitions: of the types, as far as they are in the files in .msg text.
        counts: of the messages of each topic.
        offered: what the publishers of each topic offered; empty if that was not recorded.
        count: of all messages; 0 where that is not known without reading them.
        start_ns, end_ns: times of the first and the last message; 0 without messages.
        warnings: problems in spite of which it can be read; reading may add some.
    """

    def __init__(self, source: Path, max_size: int = MAX_SIZE) -> None:
        """Open a recording.

        Args:
            source: its file or folder.
            max_size: bytes that are read or unpacked at once, of a message or a chunk, at most.

        Raises:
            OneBotError: there is none, or it cannot be read.
        """
        self.source = source
        self._max_size = max_size
        self.warnings: list[str] = []
        self._left_out: set[str] = set()  # topics with messages that cannot be decompressed
        self.distro = ""
        try:
            self.files = self._find()
        except OSError as error:  # a folder may not be listed, or a name cannot be that of a file
            raise OneBotError(f"{source} cannot be read: {error.strerror}") from error
        self._readable = [self._decompressed(file) for file in self.files]
        self.storage = _FORMATS[self._readable[0].suffix].storage
        self.topics: dict[str, str] = {}
        self.definitions: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.offered: dict[str, list[Qos]] = {}
        found = [_FORMATS[file.suffix].contents(file, max_size) for file in self._readable]
        for contents in found:
            self.definitions = {**contents.definitions, **self.definitions}
            for name, topic in contents.topics.items():
                self.topics.setdefault(name, topic.type)
                self.counts[name] = self.counts.get(name, 0) + topic.count
                self.offered.setdefault(name, []).extend(_offered(topic.offered))
        self.count = sum(contents.count for contents in found)
        filled = [contents for contents in found if contents.count]
        self.start_ns = min((contents.start_ns for contents in filled), default=0)
        self.end_ns = max((contents.end_ns for contents in filled), default=0)

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Return the messages of ``topics``, file by file, in the order of their times.

        Of a damaged file, the messages before the damage are returned, with a warning.
        """
        for file in self._readable:
            try:
                for message in _FORMATS[file.suffix].read(file, topics, self._max_size):
                    if not message.data.startswith(_FRAME):
                        yield message
                    elif (data := self._decompressed_message(message)) is not None:
                        yield message._replace(data=data)
            except _DAMAGE as error:
                name = f"{file} ({_megabytes(file.stat().st_size)})"
                self.warnings.append(f"{name}: {_reason(error)}; what comes before is read")

    def definition(self, type_name: str) -> str:
        """Return the definition of a message type: the recording's, or else the installed one.

        Args:
            type_name: ``package/msg/Type``.

        Raises:
            OneBotError: it is neither in the recording, as .msg text, nor installed.
        """
        if type_name in self.definitions:
            return self.definitions[type_name]
        try:
            return full_definition(type_name)
        except (OneBotError, ValueError) as error:  # ValueError: a name that is none of ROS 2
            raise OneBotError(
                f"the definition of {type_name} is neither in {self.source} nor installed"
            ) from error

    def _decompressed(self, file: Path) -> Path:
        """The file, or what is in it in a temporary folder that goes away with the bag."""
        if file.suffix != _COMPRESSED:
            return file
        folder = tempfile.mkdtemp(prefix="onebot-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        target = Path(folder, file.stem)
        most = max(self._max_size, _FILE_RATIO * file.stat().st_size)
        try:
            with _opened(file) as source, target.open("wb") as plain:

                def read(size: int) -> bytes:  # in Python: Ctrl-C counts between two calls
                    _check_size("a gap", source.tell() - plain.tell(), self._max_size)
                    return source.read(size)

                reader: Any = SimpleNamespace(read=read)
                for part in zstandard.ZstdDecompressor().read_to_iter(reader):
                    plain.write(part)
                    _check_size("its content", plain.tell(), most)
        except (OSError, zstandard.ZstdError, ValueError) as error:
            raise OneBotError(f"{file} cannot be decompressed into {folder}: {error}") from error
        return target

    def _decompressed_message(self, message: BagMessage) -> bytes | None:
        """Its data; None, with a warning for each topic, if they are damaged."""
        try:
            return _decompressed(message.data, self._max_size)
        except (zstandard.ZstdError, ValueError) as error:
            if message.topic not in self._left_out:
                self._left_out.add(message.topic)
                self.warnings.append(
                    f"{self.source} has messages of {message.topic} that cannot be decompressed: "
                    f"{error}"
                )
        return None

    def _find(self) -> list[Path]:
        source = self.source
        if source.is_dir():
            return self._in_folder()
        if not source.exists():
            raise OneBotError(f"there is no recording {source}")
        if source.suffix == _ROS1:
            raise OneBotError(
                f"{source} is a recording of ROS 1: convert it to ROS 2 by pip install rosbags and "
                f"rosbags-convert --src {source} --dst {source.stem}"
            )
        if not _is_storage(source):
            raise OneBotError(
                f"{source} is no recording: its name must end in .mcap, .db3 or .rrd, or be that "
                "of a folder that ros2 bag has made"
            )
        return [source]

    def _in_folder(self) -> list[Path]:
        """The files that metadata.yaml names, or else those that are there."""
        there = {path.name: path for path in self.source.iterdir()}
        information = self._metadata()
        if information is None:
            files = [path for path in there.values() if _is_storage(path)]
            if not files:
                raise OneBotError(
                    f"{self.source} is no recording: it holds neither {METADATA} nor a .mcap or "
                    ".db3 file"
                )
            return sorted(files, key=lambda path: natural_order(path.name))
        compression = str(information.get("compression_format") or _ZSTD)
        if compression != _ZSTD:
            raise OneBotError(
                f"{self.source} is compressed by {compression}, not {_ZSTD}: decompress it by "
                "ros2 bag convert"
            )
        paths = information["relative_file_paths"] or ()
        names = dict.fromkeys(Path(path).name for path in paths)
        missing = [name for name in names if name not in there]
        files = [there[name] for name in names if name in there and _is_storage(there[name])]
        if not files:
            raise OneBotError(f"{self.source} lacks its files: {', '.join(missing) or 'none'}")
        if missing:
            self.warnings.append(f"{self.source} lacks {', '.join(missing)}; the others are read")
        return files

    def _metadata(self) -> Mapping[str, Any] | None:
        path = self.source / METADATA
        try:
            text = bounded_yaml.read_text(path)
            found = bounded_yaml.load(text)["rosbag2_bagfile_information"]
            names = found["relative_file_paths"] or []
            if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
                raise TypeError("no list of names")
        except OSError:
            self.warnings.append(f"{self.source} has no {METADATA}; the files that it has are read")
            return None
        except (yaml.YAMLError, TypeError, KeyError, AttributeError, ValueError):
            self.warnings.append(f"{path} is damaged; the files beside it are read")
            return None
        information: Mapping[str, Any] = found
        self.distro = str(information.get("ros_distro") or "")
        return information


def _is_storage(path: Path) -> bool:
    """Whether its name is that of a file with messages, compressed or not."""
    return (Path(path.stem) if path.suffix == _COMPRESSED else path).suffix in _FORMATS


def _opened(path: Path) -> IO[bytes]:
    try:
        return bounded_yaml.open_regular(path)
    except OSError as error:
        raise OneBotError(f"{path} cannot be read: {error.strerror}") from error


def _check_size(what: str, size: int, max_size: int) -> None:
    """Raise a ValueError for what is too large to be read, before it is."""
    if size > max_size:
        raise ValueError(
            f"{what} of {_megabytes(size)} is above {_megabytes(max_size)}, which max_size sets"
        )


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"


def _decompressed(data: bytes, max_size: int) -> bytes:
    """Return what a frame of zstd holds, if that is not too large."""
    _check_size("a message or chunk", zstandard.frame_content_size(data), max_size)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max_size)


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyError):
        return f"it lacks the channel {error}"
    return str(error) or "it ends too early"


@dataclass
class _Topic:
    """A topic in a file."""

    type: str
    offered: str = ""  # its publishers' QoS in YAML, as rosbag2 writes it
    count: int = 0  # of messages


@dataclass
class _Contents:
    """What is in a file."""

    topics: dict[str, _Topic] = field(default_factory=dict)  # by name
    definitions: dict[str, str] = field(default_factory=dict)  # in .msg text, by type
    count: int = 0  # of messages, those that are not in CDR too
    start_ns: int = 0  # of the first message
    end_ns: int = 0  # of the last

    def add(self, name: str, count: int, start_ns: int, end_ns: int) -> None:
        """Count messages of a topic, or of none that is in CDR."""
        if name in self.topics:
            self.topics[name].count += count
        self.start_ns = min(self.start_ns, start_ns) if self.count else start_ns
        self.end_ns = max(self.end_ns, end_ns)
        self.count += count


def _offered(text: str) -> list[Qos]:
    """What publishers offer, of that YAML; empty if it is none."""
    with suppress(yaml.YAMLError, ValueError, TypeError, AttributeError, OverflowError):
        return [
            Qos(  # in words, or the numbers of rmw
                reliability="best_effort"
                if one.get("reliability") in ("best_effort", 2)
                else "reliable",
                durability="transient_local"
                if one.get("durability") in ("transient_local", 1)
                else "volatile",
                depth=int(one.get("depth", 0)),
                liveliness="manual_by_topic"
                if one.get("liveliness") in ("manual_by_topic", 3)
                else "automatic",
                deadline=_limit(one.get("deadline")),
                lifespan=_limit(one.get("lifespan")),
                lease=_limit(one.get("liveliness_lease_duration")),
            )
            for one in bounded_yaml.load(text) or ()
        ]
    return []


def _limit(duration: Mapping[str, Any] | None) -> int | None:
    """A duration, ns; None for an infinite one, or none."""
    if duration is None:
        return None
    seconds, rest = int(duration.get("sec", 0)), int(duration.get("nsec", 0))
    limit = seconds * NANO + rest
    return limit if seconds < _INFINITE_S and 0 < limit < _INFINITE_S * NANO else None


# --- MCAP -----------------------------------------------------------------------------------------


@dataclass
class _Declared:
    """What the records of an MCAP file declare, in its summary or between its messages."""

    room: int  # bytes of records that may still be kept
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    statistics: Statistics | None = None

    def add(self, opcode: int, data: bytes) -> None:
        """Keep what a record declares; records of other kinds are passed over."""
        number = int.from_bytes(data[:2], "little")  # of a schema or channel; they may be repeated
        if (opcode == Opcode.SCHEMA and number in self.schemas) or (
            opcode == Opcode.CHANNEL and number in self.channels
        ):
            return
        self.room -= len(data)
        if self.room < 0:
            raise ValueError("more definitions and indexes than max_size allows")
        stream = ReadDataStream(io.BytesIO(data))
        if opcode == Opcode.SCHEMA:
            self.schemas[number] = Schema.read(stream)
        elif opcode == Opcode.CHANNEL:
            self.channels[number] = Channel.read(stream)
        elif opcode == Opcode.CHUNK_INDEX:
            self.chunks.append(ChunkIndex.read(stream))
        elif opcode == Opcode.STATISTICS:
            self.statistics = Statistics.read(stream)

    def type_of(self, number: int) -> tuple[str, str]:
        """Return the topic and the type of a channel; empty if its messages are not in CDR."""
        channel = self.channels[number]
        schema = self.schemas.get(channel.schema_id)
        if channel.message_encoding != _CDR or schema is None:
            return "", ""
        package, _, kind = schema.name.partition("/")
        return channel.topic, schema.name if "/" in kind else f"{package}/msg/{kind}"

    @property
    def is_index(self) -> bool:
        """Whether it has statistics, channels, schemas, and chunks that do not overlap."""
        if self.statistics is None or not self.chunks:
            return False
        counts, schemas = self.statistics.channel_message_counts, {0, *self.schemas}  # 0: none
        chunks = sorted((chunk.chunk_start_offset, chunk.chunk_length) for chunk in self.chunks)
        return (
            all(a + length <= b for (a, length), (b, _) in zip(chunks, chunks[1:], strict=False))
            and self.statistics.message_count == sum(counts.values())
            and counts.keys() <= self.channels.keys()
            and all(channel.schema_id in schemas for channel in self.channels.values())
        )


def _opened_mcap(path: Path) -> IO[bytes]:
    file = _opened(path)
    start = file.read(len(MCAP0_MAGIC))
    if start != MCAP0_MAGIC:
        file.close()
        what = "is empty" if not start else "is no MCAP file"
        raise OneBotError(f"{path} {what}")
    return file


def _index(file: IO[bytes], max_size: int) -> _Declared | None:
    """The summary; None where the file has to be read in order.

    It was cut off or ends in a damaged one, or it was written without an index of its chunks,
    without statistics, or without channels or schemas in its summary, all of which are optional.
    """
    index = _Declared(max_size)
    try:
        file.seek(-_FOOTER.size, os.SEEK_END)
        start, magic = _FOOTER.unpack(file.read(_FOOTER.size))
        if magic != MCAP0_MAGIC or not start:
            return None
        file.seek(start)
        for opcode, data in _records(file, max_size):
            if opcode == Opcode.FOOTER:
                break
            index.add(opcode, data)
    except _DAMAGE:
        return None
    return index if index.is_index else None


def _records(file: IO[bytes], max_size: int) -> Iterator[tuple[int, bytes]]:
    """Yield the records from here on: what they are, and their content."""
    place = file.tell()
    end = file.seek(0, os.SEEK_END)
    file.seek(place)
    while place < end:
        opcode, length = _RECORD.unpack(file.read(_RECORD.size))
        place += _RECORD.size + length
        if opcode == 0 or place > end:
            raise EOFError("a record is damaged" if opcode == 0 else "it ends within a record")
        if opcode in _READ:
            _check_size("a record", length, max_size)
            yield opcode, file.read(length)
        else:
            file.seek(place)


def _records_of_chunk(data: bytes, max_size: int) -> Iterator[tuple[int, bytes]]:
    chunk = Chunk.read(ReadDataStream(io.BytesIO(data)))
    size, packed = chunk.uncompressed_size, chunk.data
    _check_size("a chunk", size, max_size)
    if chunk.compression == "zstd":
        packed = _decompressed(packed, size)
    elif chunk.compression == "lz4":
        packed = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    elif chunk.compression:
        raise ValueError(f"its chunks are compressed by {chunk.compression}, not zstd or lz4")
    if chunk.uncompressed_crc and zlib.crc32(packed) != chunk.uncompressed_crc:
        raise ValueError("a checksum is wrong")
    return _records(io.BytesIO(packed), max_size)


def _in_file_order(
    file: IO[bytes], declared: _Declared, max_size: int
) -> Iterator[tuple[int, int, bytes]]:
    """Yield channel, time and data of each message, after what declares it."""
    file.seek(len(MCAP0_MAGIC))
    for opcode, data in _records(file, max_size):
        if opcode == Opcode.DATA_END:
            return
        records = ((opcode, data),)
        for kind, part in _records_of_chunk(data, max_size) if opcode == Opcode.CHUNK else records:
            if kind == Opcode.MESSAGE:
                yield _message(part)
            else:
                declared.add(kind, part)
    raise EOFError("it ends too early")


def _message(record: bytes) -> tuple[int, int, bytes]:
    channel, _, time, _ = _MESSAGE.unpack_from(record)
    return channel, time, record[_MESSAGE.size :]


def _by_time(
    file: IO[bytes], index: _Declared, channels: Collection[int], max_size: int
) -> Iterator[tuple[int, int, bytes]]:
    """Yield channel, time and data of the messages of ``channels``; chunks overlap in time."""
    waiting: list[tuple[int, int, int, int, bytes]] = []
    held = 0

    def before(time: float) -> Iterator[tuple[int, int, bytes]]:
        nonlocal held
        while waiting and waiting[0][0] < time:
            stamp, _, _, channel, data = heapq.heappop(waiting)
            held -= len(data) + _OVERHEAD
            yield channel, stamp, data

    for chunk in sorted(index.chunks, key=lambda chunk: chunk.message_start_time):
        if chunk.message_index_offsets and not chunk.message_index_offsets.keys() & channels:
            continue
        yield from before(chunk.message_start_time)
        file.seek(chunk.chunk_start_offset)
        opcode, data = next(_records(file, max_size))
        if opcode != Opcode.CHUNK or _RECORD.size + len(data) != chunk.chunk_length:
            raise ValueError("its index is none of its chunks")
        for number, (kind, record) in enumerate(_records_of_chunk(data, max_size)):
            if kind == Opcode.MESSAGE and int.from_bytes(record[:2], "little") in channels:
                channel, time, content = _message(record)
                held += len(content) + _OVERHEAD
                _check_size("what overlaps in time", held, max_size)
                place = chunk.chunk_start_offset
                heapq.heappush(waiting, (time, place, number, channel, content))
    yield from before(math.inf)


def _mcap_contents(path: Path, max_size: int) -> _Contents:
    """What is in the file by its summary, or else by reading all of it."""
    contents = _Contents()
    with _opened_mcap(path) as file:
        declared = _index(file, max_size)
        if declared is not None and (found := declared.statistics) is not None:
            extent = found.message_start_time, found.message_end_time
            counts = found.channel_message_counts
            extents = {number: (count, *extent) for number, count in counts.items()}
        else:
            declared = _Declared(max_size)
            extents = _counted(file, declared, max_size)
    for number, channel in declared.channels.items():
        topic, kind = declared.type_of(number)
        if topic:
            contents.topics.setdefault(topic, _Topic(kind, channel.metadata.get(_OFFERED, "")))
            schema = declared.schemas[channel.schema_id]
            if schema.encoding == _MSG and kind not in contents.definitions:
                contents.definitions[kind] = schema.data.decode(errors="replace")
    for number, values in extents.items():
        contents.add(declared.channels[number].topic, *values)
    if not contents.topics and contents.count:
        raise OneBotError(f"{path} holds no messages of ROS 2 (in CDR)")
    return contents


def _counted(
    file: IO[bytes], declared: _Declared, max_size: int
) -> dict[int, tuple[int, int, int]]:
    """Number of messages, first and last time of each channel, up to the first damage."""
    extents: dict[int, tuple[int, int, int]] = {}
    with suppress(*_DAMAGE):
        for number, time, _ in _in_file_order(file, declared, max_size):
            declared.channels[number]  # or it is damage
            count, start, end = extents.get(number, (0, time, time))
            extents[number] = count + 1, min(start, time), max(end, time)
    return extents


def _read_mcap(path: Path, topics: Collection[str], max_size: int) -> Iterator[BagMessage]:
    """Yield messages by time; of a file without a sound index, in the file's order."""
    with _opened_mcap(path) as file:
        declared = _index(file, max_size)
        if declared is not None:
            channels = {n for n, channel in declared.channels.items() if channel.topic in topics}
            found = _by_time(file, declared, channels, max_size)
        else:
            declared = _Declared(max_size)
            found = _in_file_order(file, declared, max_size)
        types: dict[int, tuple[str, str]] = {}
        for number, time, data in found:
            if number not in types:
                types[number] = declared.type_of(number)
            topic, kind = types[number]
            if topic in topics:
                yield BagMessage(topic, kind, time, data)


# --- SQLite ---------------------------------------------------------------------------------------


def _sqlite_contents(path: Path, max_size: int) -> _Contents:
    contents = _Contents()
    try:
        with _database(path) as (database, tables):
            topics = _sqlite_topics(database)
            for topic in topics.values():
                offered = str(topic.get(_OFFERED) or "")
                contents.topics.setdefault(topic["name"], _Topic(topic["type"], offered))
            if "message_definitions" in tables:
                contents.definitions.update(database.execute(_DEFINITIONS))
            for number, *extent in database.execute(_EXTENTS):
                if number in topics:
                    contents.add(topics[number]["name"], *extent)
    except _DAMAGE as error:
        raise OneBotError(f"{path} is no recording of rosbag2: {error}") from error
    return contents


def _sqlite_topics(database: sqlite3.Connection) -> dict[Any, dict[str, Any]]:
    """The rows of its topics, by id."""
    found = database.execute(_TOPICS)
    columns = [column[0] for column in found.description]
    rows = (dict(zip(columns, row, strict=True)) for row in found)
    return {row["id"]: {**row, "name": str(row["name"]), "type": str(row["type"])} for row in rows}


def _read_sqlite(path: Path, topics: Collection[str], max_size: int) -> Iterator[BagMessage]:
    with _database(path) as (database, _):
        names = {
            number: (topic["name"], topic["type"])
            for number, topic in _sqlite_topics(database).items()
            if topic["name"] in topics
        }
        query = _MESSAGES.format(", ".join("?" * len(names)))
        for number, stamp, size, data in database.execute(query, [max_size, *names]):
            _check_size("a message", size, max_size)
            yield BagMessage(*names[number], stamp, data)


@contextmanager
def _database(path: Path) -> Iterator[tuple[sqlite3.Connection, Set[str]]]:
    """Open a recording in SQLite, with those of its tables that are known.

    Ctrl-C works while it is searched.

    Raises:
        sqlite3.Error, ValueError: it is none.
    """
    options = "mode=ro"  # or a file that is missing would be made
    with _opened(path) as file:
        # A log beside it would be made, too, where one can be: Foxy's files have one while written.
        if file.read(20)[-2:] == _LOGGED and not Path(f"{path}-wal").is_file():
            options += "&immutable=1"
    url = f"{path.absolute().as_uri()}?{options}"
    with closing(sqlite3.connect(url, uri=True)) as database:
        database.set_progress_handler(lambda: 0, _STEPS)
        try:
            tables = {name for (name,) in database.execute(_TABLES)}
            if not {"topics", "messages"} <= tables:
                raise ValueError("it has no tables topics and messages")
            yield database, tables
        except sqlite3.OperationalError as error:
            if str(error) == "interrupted":  # SQLite ends, but drops the handler's exception
                raise KeyboardInterrupt from error
            raise


class _Format(NamedTuple):
    storage: str
    contents: Callable[[Path, int], _Contents]
    read: Callable[[Path, Collection[str], int], Iterator[BagMessage]]


_FORMATS: Mapping[str, _Format] = {
    ".mcap": _Format("mcap", _mcap_contents, _read_mcap),
    ".db3": _Format("sqlite3", _sqlite_contents, _read_sqlite),
}
