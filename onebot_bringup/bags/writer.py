"""Writes a rosbag2: a folder with metadata.yaml and an MCAP file that is readable at any time."""

import contextlib
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, IndexType, Writer

from onebot_description.atomic_write import write_whole
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interface_text import full_definition

_METADATA = "metadata.yaml"
CHUNK_SIZE = 768 * 1024  # bytes, rosbag2's default
_MAX_PENDING = 16 * 1024 * 1024  # bytes kept in memory between two checkpoints
_INFINITE = 2**63 - 1  # ns; what rosbag2 writes for an infinite duration, and for no start
_FOREVER = dict(zip(("sec", "nsec"), divmod(_INFINITE, 10**9), strict=True))
_FastDumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # libyaml's, if PyYAML has it


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers, as far as it is recorded."""

    reliability: str = "reliable"  # the other value is best_effort
    durability: str = "volatile"  # the other value is transient_local


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a recording."""

    name: str
    type: str  # package/msg/Type
    hash: str = ""  # hash of the type, RIHS01_...
    offered: tuple[Qos, ...] = ()  # QoS of each publisher


class _Output(io.BytesIO):
    """A buffer to be written to the file from ``start`` on, with positions in that file."""

    start = 0

    def tell(self) -> int:
        return self.start + super().tell()


class BagWriter:
    """Writes messages into a new folder, which is a complete rosbag2 after each checkpoint.

    Whatever ends the process, the folder stays as of the last checkpoint. (Only a kill during the
    call that writes to the file may leave it without its end, but even then all messages up to the
    previous checkpoint can be read.) All methods raise an OneBotError if nothing can be written,
    such as on a full disk; the recording then ends at the last checkpoint.

    Attributes:
        folder: the recording.
        open: whether messages are written; False once closed, or after a failure.
        topics: the topics, by number.
        message_count: the number of messages of all topics.
    """

    def __init__(
        self, folder: Path, *, compress: bool = True, chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Make a new folder with an empty recording.

        Args:
            folder: the folder, which must not exist.
            compress: compress chunks with zstd.
            chunk_size: the size of a chunk, bytes.

        Raises:
            OneBotError: the folder exists, or cannot be written.
        """
        self.folder, self._name = folder, f"{folder.name}_0.mcap"
        self.open = False
        self.message_count = 0
        self._start = self._end = 0  # times of the first and the last message, ns
        self._counts: dict[int, int] = {}  # number of messages by the topic's number
        self.topics: dict[int, RecordedTopic] = {}
        self._changed = False
        self._output = _Output()
        self._ending = b""  # content of the file from the start of the output on
        self._writer = Writer(
            self._output,
            chunk_size=chunk_size,
            compression=CompressionType.ZSTD if compress else CompressionType.NONE,
            index_types=IndexType.CHUNK | IndexType.MESSAGE,
            use_summary_offsets=False,  # the writer accumulates them, so they are right only once
        )
        with self._explained():
            if folder.exists():
                raise OneBotError(f"{folder} exists already: name a new folder")
            folder.mkdir()
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            self._file = os.open(folder / self._name, flags, 0o666)
            self.open = True
            self._writer.start("ros2", "onebot")
            self._complete()

    def add_topic(self, topic: RecordedTopic) -> int:
        """Add a topic, whose type must be installed; return its number for ``write``."""
        definition = full_definition(topic.type).encode()
        schema = self._writer.register_schema(topic.type, "ros2msg", definition)
        offered = _yaml([_qos(qos) for qos in topic.offered])
        metadata = {"offered_qos_profiles": offered, "topic_type_hash": topic.hash}
        number = self._writer.register_channel(topic.name, "cdr", schema, metadata)
        self.topics[number] = topic
        self._counts[number] = 0
        self._changed = True
        return number

    def write(self, topic: int, time_ns: int, data: bytes) -> None:
        """Add a message, which the next checkpoint writes.

        Args:
            topic: the topic's number.
            time_ns: when it was received, nanoseconds.
            data: the message in CDR.
        """
        if not self.open:
            return
        self._start = min(time_ns, self._start) if self.message_count else time_ns
        self._end = max(time_ns, self._end)
        self.message_count += 1
        self._counts[topic] += 1
        self._changed = True
        # The publish time is unknown, so use the receive time.
        self._writer.add_message(topic, time_ns, data, time_ns, self._counts[topic])
        if self._output.tell() - self._output.start > _MAX_PENDING:
            self.checkpoint()

    def checkpoint(self) -> None:
        """Complete the recording with all messages added; call this about once a second."""
        if self.open and self._changed:
            with self._explained():
                self._complete()
                self._changed = False

    def _complete(self) -> None:
        """Complete the file and its metadata.

        mcap's ``Writer`` writes to memory, where this closes the chunk and writes the end of the
        file: the summary and the footer. One call then writes this over the previous end of the
        file, and the ``Writer`` continues where the new end begins. If it cannot be written (for
        example, the disk is full), the file stays complete, as of the previous checkpoint.
        """
        output = self._output
        self._writer.flush()  # type: ignore[no-untyped-call]
        end = output.tell()
        self._writer.finish()  # type: ignore[no-untyped-call]
        data = output.getvalue()
        try:
            self._write_at(output.start, data)
        except OSError:
            with contextlib.suppress(OSError):  # only the first error matters
                self._write_at(output.start, self._ending)
            raise
        self._ending = data[end - output.start :]
        output.start = end
        output.seek(0)
        output.truncate(0)
        # This file is replaced as a whole, so that it is never incomplete.
        write_whole(self.folder / _METADATA, _yaml(self._metadata()).encode())

    def _write_at(self, offset: int, data: bytes) -> None:
        """Write ``data`` at ``offset``, and end the file after it."""
        view, place = memoryview(data), offset
        while view:  # usually once, but a write may be partial
            written = os.pwrite(self._file, view, place)
            view, place = view[written:], place + written
        os.ftruncate(self._file, place)

    def _metadata(self) -> dict[str, Any]:
        """Return the metadata in rosbag2's version 9, as Jazzy writes it."""
        start = self._start if self.message_count else _INFINITE
        extent = {
            "duration": {"nanoseconds": self._end - self._start},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": self.message_count,
        }
        topics = [_topic(topic, self._counts[number]) for number, topic in self.topics.items()]
        information = {
            "version": 9,
            "storage_identifier": "mcap",
            **extent,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._name],
            "files": [{"path": self._name, **extent}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        return {"rosbag2_bagfile_information": information}

    def close(self) -> None:
        try:
            self.checkpoint()
        finally:
            self._stop()

    def _stop(self) -> None:
        if self.open:
            self.open = False
            os.close(self._file)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn a write error into an OneBotError with one sentence, and end the recording."""
        try:
            yield
        except OSError as error:
            self._stop()
            raise OneBotError(f"cannot record to {self.folder}: {error.strerror}") from error


def _topic(topic: RecordedTopic, count: int) -> dict[str, Any]:
    metadata = {
        "name": topic.name,
        "type": topic.type,
        "serialization_format": "cdr",
        "offered_qos_profiles": [_qos(qos) for qos in topic.offered],
        "type_description_hash": topic.hash,
    }
    return {"topic_metadata": metadata, "message_count": count}


def _qos(qos: Qos) -> dict[str, Any]:
    return {
        "history": "unknown",  # DDS reports neither this nor the depth
        "depth": 0,
        "reliability": qos.reliability,
        "durability": qos.durability,
        "deadline": _FOREVER,
        "lifespan": _FOREVER,
        "liveliness": "automatic",
        "liveliness_lease_duration": _FOREVER,
        "avoid_ros_namespace_conventions": False,
    }


class _Dumper(_FastDumper):  # type: ignore[misc, valid-type]
    def ignore_aliases(self, data: Any) -> bool:
        return True  # rosbag2 writes no aliases


def _yaml(data: Any) -> str:
    text: str = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**30)
    return text
