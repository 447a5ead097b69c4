"""Reads recordings of ROS 2, ours or anyone's: MCAP files, SQLite files, and folders of them."""

import os
import shutil
import sqlite3
import struct
import tempfile
import weakref
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from onebot_bringup.bags.writer import METADATA, Qos
from onebot_bringup.introspection.interfaces import full_definition
from onebot_description.errors import OneBotError, natural_order
from onebot_description.parameters import bounded_yaml
from onebot_description.wire.cdr import NANO

# rosbag2's own compression, of files or of each message, beside that of the chunks in an MCAP file.
_ZSTD = "zstd"
_COMPRESSED = f".{_ZSTD}"
_FRAME = b"\x28\xb5\x2f\xfd"  # how zstd's data begins, and no CDR does
_ROS1 = ".bag"
# What sqlite3 raises for bytes that are no SQLite; UnicodeError: an error that quotes damaged text.
_SQLITE_DAMAGE = (sqlite3.Error, UnicodeError, MemoryError)
# What mcap raises for bytes that are no MCAP.
_DAMAGE = (
    McapError, OSError, struct.error, zstandard.ZstdError, ValueError, KeyError, EOFError,
    RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
_CDR = "cdr"
_MSG = "ros2msg"  # the encoding of definitions that are .msg text, not IDL
_MOST = 1 << 30  # bytes of a record: more is taken to be damage
_INFINITE_S = 2**31 - 1  # s: this or more stands for an infinite duration; in Foxy it is this
_LOGGED = b"\2\2"  # in the header of a SQLite file: it is written by way of a log
_FOOTER = struct.Struct("<QQI8s")  # start of the summary and of its offsets, checksum, magic
_CRC_OFFSET = 16  # bytes; the checksum is of all from the summary's start to here
# SQLite takes values of any type in any column.
_TOPICS = """
    SELECT * FROM topics
    WHERE serialization_format = 'cdr' AND typeof(name) = 'text' AND typeof(type) = 'text'
"""
# From Iron on; in SQLite they have a table of their own.
_HAS_DEFINITIONS = "SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'"
_DEFINITIONS = """
    SELECT topic_type, encoded_message_definition FROM message_definitions
    WHERE encoding = 'ros2msg' AND typeof(topic_type) = 'text'
        AND typeof(encoded_message_definition) = 'text'
"""
_EXTENTS = """
    SELECT topics.name, count(*), min(messages.timestamp), max(messages.timestamp)
    FROM messages JOIN topics ON messages.topic_id = topics.id
    WHERE typeof(messages.timestamp) = 'integer' GROUP BY topics.name
"""
_MESSAGES = """
    SELECT topics.name, topics.type, messages.timestamp, messages.data
    FROM messages JOIN topics ON messages.topic_id = topics.id
    WHERE topics.name IN ({})
        AND typeof(messages.data) = 'blob' AND typeof(messages.timestamp) = 'integer'
    ORDER BY messages.timestamp, messages.id
"""
_Found = Iterator[tuple[Schema | None, Channel, Message]]


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

    def __init__(self, source: Path) -> None:
        """Open the recording at ``source``.

        Raises:
            OneBotError: there is none, or it cannot be read.
        """
        self.source = source
        self.warnings: list[str] = []
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
        found = [_FORMATS[file.suffix].contents(file) for file in self._readable]
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
            for message in _FORMATS[file.suffix].read(file, topics, self.warnings.append):
                if not message.data.startswith(_FRAME):
                    yield message
                elif (data := self._decompressed_message(message)) is not None:
                    yield message._replace(data=data)

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
        try:
            with file.open("rb") as source, target.open("wb") as plain:
                zstandard.ZstdDecompressor().copy_stream(source, plain)
        except (OSError, zstandard.ZstdError) as error:
            raise OneBotError(f"{file} cannot be decompressed into {folder}: {error}") from error
        return target

    def _decompressed_message(self, message: BagMessage) -> bytes | None:
        """Its data; None, with a warning for each topic, if they are damaged."""
        try:
            if 0 <= zstandard.frame_content_size(message.data) <= _MOST:
                return zstandard.ZstdDecompressor().decompress(message.data)
        except zstandard.ZstdError:
            pass
        warning = f"{self.source} has messages of {message.topic} that cannot be decompressed"
        if warning not in self.warnings:
            self.warnings.append(warning)
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


def _mcap_contents(path: Path) -> _Contents:
    """What is in the file by its summary, or else by reading all of it."""
    with _opened_mcap(path) as file:
        summary = _summary(file)
        contents = _summarized(summary) if summary is not None else _counted(file)
    if not contents.topics and contents.count:
        raise OneBotError(f"{path} holds no messages of ROS 2 (in CDR)")
    return contents


def _summarized(summary: Summary) -> _Contents:
    contents = _Contents()
    for channel in summary.channels.values():
        _add_channel(contents, channel, summary.schemas.get(channel.schema_id))
    statistics = summary.statistics
    assert statistics is not None
    extent = statistics.message_start_time, statistics.message_end_time
    for number, count in statistics.channel_message_counts.items():
        contents.add(summary.channels[number].topic, count, *extent)
    return contents


def _add_channel(contents: _Contents, channel: Channel, schema: Schema | None) -> None:
    if channel.message_encoding == _CDR and schema is not None:
        offered, kind = str(channel.metadata.get("offered_qos_profiles", "")), _full(schema.name)
        contents.topics.setdefault(channel.topic, _Topic(kind, offered))
        if schema.encoding == _MSG and kind not in contents.definitions:
            contents.definitions[kind] = schema.data.decode(errors="replace")


def _opened(path: Path) -> IO[bytes]:
    try:
        return path.open("rb")
    except OSError as error:
        raise OneBotError(f"{path} cannot be read: {error.strerror}") from error


def _opened_mcap(path: Path) -> IO[bytes]:
    file = _opened(path)
    start = file.read(len(MCAP0_MAGIC))
    if start != MCAP0_MAGIC:
        file.close()
        what = "is empty" if not start else "is no MCAP file"
        raise OneBotError(f"{path} {what}")
    return file


def _summary(file: IO[bytes]) -> Summary | None:
    """The summary; None where the file has to be read in order.

    It was cut off or ends in a damaged one, or it was written without an index of its chunks,
    without statistics, or without channels or schemas in its summary, all of which are optional.
    """
    try:
        if not _ends_sound(file):
            return None
        file.seek(0)
        summary = SeekingReader(file, record_size_limit=_MOST).get_summary()
    except _DAMAGE:
        return None
    return summary if summary is not None and _is_complete(summary) else None


def _is_complete(summary: Summary) -> bool:
    """Whether it has all that is asked of it: statistics, channels, schemas, chunks."""
    statistics, channels = summary.statistics, summary.channels
    if statistics is None or not summary.chunk_indexes:
        return False
    counts, schemas = statistics.channel_message_counts, {0, *summary.schemas}  # 0: it has none
    return (
        statistics.message_count == sum(counts.values())
        and counts.keys() <= channels.keys()
        and all(channel.schema_id in schemas for channel in channels.values())
    )


def _ends_sound(file: IO[bytes]) -> bool:
    """Whether the end is there, with the right checksum (which mcap's reader ignores) or none."""
    file.seek(-_FOOTER.size, os.SEEK_END)
    end = file.tell() + _CRC_OFFSET
    start, _, crc, magic = _FOOTER.unpack(file.read(_FOOTER.size))
    if magic != MCAP0_MAGIC:
        return False
    file.seek(start)
    return not start or not crc or zlib.crc32(file.read(end - start)) == crc


def _full(name: str) -> str:
    """``package/msg/Type``, of the short name too that some writers use."""
    package, _, kind = name.partition("/")
    return name if "/" in kind else f"{package}/msg/{kind}"


def _counted(file: IO[bytes]) -> _Contents:
    contents = _Contents()
    for schema, channel, message in _in_file_order(file, lambda _: None):
        _add_channel(contents, channel, schema)
        contents.add(channel.topic, 1, message.log_time, message.log_time)
    return contents


def _read_mcap(
    path: Path, topics: Collection[str], warn: Callable[[str], None]
) -> Iterator[BagMessage]:
    """Yield messages by time; of a damaged file, those before the damage, in the file's order."""
    with _opened_mcap(path) as file:
        if _summary(file) is not None:
            file.seek(0)
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=_MOST)
            found = _guarded(reader.iter_messages(topics=list(topics)), path, warn)
        else:
            found = _in_file_order(file, lambda why: warn(f"{path} is damaged or cut off: {why}"))
        for schema, channel, message in found:
            usable = channel.message_encoding == _CDR and schema is not None
            if usable and channel.topic in topics:
                assert schema is not None
                yield BagMessage(
                    channel.topic, _full(schema.name), message.log_time, bytes(message.data)
                )


def _guarded(found: _Found, path: Path, warn: Callable[[str], None]) -> _Found:
    try:
        yield from found
    except _DAMAGE as error:
        warn(f"{path} is damaged: {_reason(error)}; what comes before is read")


def _in_file_order(file: IO[bytes], warn: Callable[[str], None]) -> _Found:
    """Yield messages in the order of the file, up to its end or the first damage."""
    file.seek(0)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    try:
        for record in StreamReader(file, validate_crcs=True, record_size_limit=_MOST).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                yield schemas.get(channel.schema_id), channel, record
    except _DAMAGE as error:
        warn(f"{_reason(error)}; what comes before is read")


def _reason(error: BaseException) -> str:
    if isinstance(error, CRCValidationError):
        return "a checksum is wrong"
    return str(error) or "it ends too early"


def _sqlite_contents(path: Path) -> _Contents:
    contents = _Contents()
    try:
        with closing(_connect(path)) as database:
            found = database.execute(_TOPICS)
            columns = [column[0] for column in found.description]
            for row in found:
                topic = dict(zip(columns, row, strict=True))
                offered = str(topic.get("offered_qos_profiles") or "")
                contents.topics.setdefault(topic["name"], _Topic(topic["type"], offered))
            if database.execute(_HAS_DEFINITIONS).fetchone():
                contents.definitions.update(database.execute(_DEFINITIONS))
            for extent in database.execute(_EXTENTS):
                contents.add(*extent)
    except _SQLITE_DAMAGE as error:
        raise OneBotError(f"{path} is no recording of rosbag2: {error}") from error
    return contents


def _read_sqlite(
    path: Path, topics: Collection[str], warn: Callable[[str], None]
) -> Iterator[BagMessage]:
    """Yield messages by time; of a damaged file, those before the damage."""
    query = _MESSAGES.format(", ".join("?" * len(topics)))
    try:
        with closing(_connect(path)) as database:
            for topic, kind, stamp, data in database.execute(query, list(topics)):
                yield BagMessage(topic, kind, stamp, data)
    except _SQLITE_DAMAGE as error:
        warn(f"{path} is damaged: {error}; what comes before is read")


def _connect(path: Path) -> sqlite3.Connection:
    # Read-only, or a file that is missing would be made.
    options = "mode=ro"
    with _opened(path) as file:
        # A log beside it would be made, too, where one can be: Foxy's files have one while written.
        if file.read(20)[-2:] == _LOGGED and not Path(f"{path}-wal").exists():
            options += "&immutable=1"
    return sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True)


class _Format(NamedTuple):
    storage: str
    contents: Callable[[Path], _Contents]
    read: Callable[[Path, Collection[str], Callable[[str], None]], Iterator[BagMessage]]


_FORMATS: Mapping[str, _Format] = {
    ".mcap": _Format("mcap", _mcap_contents, _read_mcap),
    ".db3": _Format("sqlite3", _sqlite_contents, _read_sqlite),
}
