"""Messages packed into the chunks of an MCAP file, and the summary that a file ends with.

The records are written by the ``mcap`` library; https://mcap.dev/spec says what is where.
"""

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

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
