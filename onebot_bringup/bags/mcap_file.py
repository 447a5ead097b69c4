"""Reads MCAP files, truncated ones up to their last whole record; limits the size of records."""

import heapq
import io
import math
import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from onebot_bringup.bags.contents import (
    DAMAGE,
    OFFERED,
    BagMessage,
    Contents,
    check_size,
    decompressed,
    open_file,
)
from onebot_description.errors import OneBotError

_CDR = "cdr"
_MSG = "ros2msg"  # the encoding of definitions that are .msg text, not IDL
_RECORD = struct.Struct("<BQ")  # the head of a record: opcode and length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, receive and publish times
_FOOTER = struct.Struct("<Q12x8s")  # the start of the summary, and the magic bytes
_READ = {
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHUNK_INDEX,
    Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER,
}  # fmt: skip
_OVERHEAD = 300  # bytes of memory per message besides its data

_Found = Iterator[tuple[int, int, bytes]]  # channel, time and data of each message


@dataclass
class _Declared:
    """The declarations in a file, from its summary or between its messages."""

    room: int  # bytes of memory left for declarations
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    statistics: Statistics | None = None

    def add(self, opcode: int, data: bytes) -> None:
        """Store a record that declares something; ignore records of other kinds."""
        number = int.from_bytes(data[:2], "little")  # a schema or channel may be repeated
        if opcode == Opcode.SCHEMA and number in self.schemas:
            return
        if opcode == Opcode.CHANNEL and number in self.channels:
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
        """Return the topic and the type of a channel; "" for both if it is not in CDR."""
        channel = self.channels[number]
        schema = self.schemas.get(channel.schema_id)
        if channel.message_encoding != _CDR or schema is None:
            return "", ""
        package, _, kind = schema.name.partition("/")
        return channel.topic, schema.name if "/" in kind else f"{package}/msg/{kind}"

    @property
    def is_index(self) -> bool:
        """Whether there are statistics, channels, schemas, and indexes of disjoint chunks."""
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


class McapFile:
    """An open MCAP file."""

    def __init__(self, path: Path, max_size: int) -> None:
        """Open a file.

        Args:
            path: the file.
            max_size: the maximum number of bytes in memory at once.

        Raises:
            OneBotError: it cannot be read, or is not an MCAP file.
        """
        self._path, self._max_size = path, max_size
        self._file = open_file(path)
        start = self._file.read(len(MCAP0_MAGIC))
        if start != MCAP0_MAGIC:
            self._file.close()
            raise OneBotError(f"{path} {'is not an MCAP file' if start else 'is empty'}")
        index = self._summary()
        self._indexed = index is not None
        self._declared = index or _Declared(max_size)

    def close(self) -> None:
        self._file.close()

    def describe(self, contents: Contents) -> None:
        """Add the file's contents, from its summary or else by reading all of it."""
        declared, extents = self._declared, self._extents()
        for number, channel in declared.channels.items():
            topic, kind = declared.type_of(number)
            if topic:
                contents.add_topic(topic, kind, channel.metadata.get(OFFERED, ""))
                schema = declared.schemas[channel.schema_id]
                if schema.encoding == _MSG and kind not in contents.definitions:
                    contents.definitions[kind] = schema.data.decode(errors="replace")
        for number, extent in extents.items():
            contents.add_messages(declared.channels[number].topic, *extent)

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield messages by time, or in file order without an index.

        Raises:
            DAMAGE: one of these errors, if the file is damaged.
        """
        channels = {n for n, channel in self._declared.channels.items() if channel.topic in topics}
        types: dict[int, tuple[str, str]] = {}
        for number, time, data in self._by_time(channels) if self._indexed else self._in_order():
            if number not in types:
                types[number] = self._declared.type_of(number)
            topic, kind = types[number]
            if topic in topics:
                yield BagMessage(topic, kind, time, data)

    def _summary(self) -> _Declared | None:
        """Read the summary; None if it is missing or incomplete."""
        index = _Declared(self._max_size)
        try:
            self._file.seek(-_FOOTER.size, os.SEEK_END)
            start, magic = _FOOTER.unpack(self._file.read(_FOOTER.size))
            if magic != MCAP0_MAGIC or not start:
                return None
            self._file.seek(start)
            for opcode, data in self._records(self._file):
                if opcode == Opcode.FOOTER:
                    break
                index.add(opcode, data)
        except DAMAGE:
            return None
        return index if index.is_index else None

    def _extents(self) -> dict[int, tuple[int, int, int]]:
        """Return each channel's number of messages, first and last time, up to any damage."""
        extents: dict[int, tuple[int, int, int]] = {}
        if (statistics := self._declared.statistics) is not None:
            times = statistics.message_start_time, statistics.message_end_time
            return {n: (count, *times) for n, count in statistics.channel_message_counts.items()}
        with suppress(*DAMAGE):
            for number, time, _ in self._in_order():
                self._declared.channels[number]  # a KeyError counts as damage
                count, start, end = extents.get(number, (0, time, time))
                extents[number] = count + 1, min(start, time), max(end, time)
        return extents

    def _records(self, file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
        place = file.tell()
        end = file.seek(0, os.SEEK_END)
        file.seek(place)
        while place < end:
            opcode, length = _RECORD.unpack(file.read(_RECORD.size))
            place += _RECORD.size + length
            if opcode == 0 or place > end:
                raise EOFError("it ends within a record" if opcode else "a record is damaged")
            if opcode in _READ:
                check_size("a record", length, self._max_size)
                yield opcode, file.read(length)
            else:
                file.seek(place)

    def _unpacked(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(data)))
        size, content = chunk.uncompressed_size, chunk.data
        check_size("a chunk", size, self._max_size)
        if chunk.compression == "zstd":
            content = decompressed(content, size)
        elif chunk.compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(content, max_length=size)
        elif chunk.compression:
            raise ValueError(f"its chunks are compressed with {chunk.compression}, not zstd or lz4")
        if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
            raise ValueError("a checksum is wrong")
        return self._records(io.BytesIO(content))

    def _in_order(self) -> _Found:
        """Yield the messages in file order, and store their declarations."""
        self._file.seek(len(MCAP0_MAGIC))
        for opcode, data in self._records(self._file):
            if opcode == Opcode.DATA_END:
                return
            chunked = opcode == Opcode.CHUNK
            for kind, record in self._unpacked(data) if chunked else ((opcode, data),):
                if kind == Opcode.MESSAGE:
                    yield _message(record)
                else:
                    self._declared.add(kind, record)
        raise EOFError("it ends too early")

    def _by_time(self, channels: set[int]) -> _Found:
        """Yield the messages of ``channels``; chunks may overlap in time."""
        waiting: list[tuple[int, int, int, int, bytes]] = []
        held = 0
        chunks = (
            (chunk.message_start_time, chunk.chunk_start_offset, chunk.chunk_length)
            for chunk in self._declared.chunks
            if not chunk.message_index_offsets or chunk.message_index_offsets.keys() & channels
        )
        for start, place, length in (*sorted(chunks), (math.inf, 0, 0)):
            while waiting and waiting[0][0] < start:
                time, _, _, channel, data = heapq.heappop(waiting)
                held -= len(data) + _OVERHEAD
                yield channel, time, data
            if not length:
                return
            for number, (kind, record) in enumerate(self._chunk(place, length)):
                if kind == Opcode.MESSAGE and int.from_bytes(record[:2], "little") in channels:
                    channel, time, data = _message(record)
                    held += len(data) + _OVERHEAD
                    check_size("data that overlaps in time", held, self._max_size)
                    heapq.heappush(waiting, (time, place, number, channel, data))

    def _chunk(self, place: int, length: int) -> Iterator[tuple[int, bytes]]:
        self._file.seek(place)
        opcode, data = next(self._records(self._file))
        if opcode != Opcode.CHUNK or _RECORD.size + len(data) != length:
            raise ValueError("its index does not point to its chunks")
        return self._unpacked(data)


def _message(record: bytes) -> tuple[int, int, bytes]:
    channel, _, time, _ = _MESSAGE.unpack_from(record)
    return channel, time, record[_MESSAGE.size :]
