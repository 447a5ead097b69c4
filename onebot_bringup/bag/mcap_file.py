"""An MCAP file that is complete at (almost) every moment, whatever ends its writer.

What makes an MCAP file readable by all stands at its end. So each ``checkpoint`` writes what is
new and an ending, in one call; the next one writes over that ending. A process that is killed
leaves the file as of its last checkpoint, with all indexes.
"""

import contextlib
import os
from pathlib import Path

from mcap.records import Channel, Header, Message, Schema, Statistics

from onebot_bringup.bag.chunks import MAGIC, OpenChunk, ending, packed

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
