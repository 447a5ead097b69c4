"""The contents of a recording, and code that both formats share: sizes and decompression."""

import sqlite3
import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
import zstandard
from mcap.exceptions import McapError

from onebot_bringup.bags.writer import Qos
from onebot_description.errors import OneBotError
from onebot_description.parameters import bounded_yaml

OFFERED = "offered_qos_profiles"  # a topic's entry in both formats
# Errors that mcap, the decompressors and sqlite3 raise for damaged files.
DAMAGE = (
    McapError, OSError, struct.error, zstandard.ZstdError, sqlite3.Error, ValueError, KeyError,
    EOFError, RuntimeError, TypeError, OverflowError, MemoryError,
)  # fmt: skip


class BagMessage(NamedTuple):
    """A recorded message."""

    topic: str
    type: str  # package/msg/Type
    time: int  # when it was received, nanoseconds
    data: bytes  # CDR, as on the wire


@dataclass
class Contents:
    """The contents of a recording's files.

    Attributes:
        topics: the type of each topic, ``package/msg/Type``; the first one if there are several.
        definitions: the definitions of types that the files have as .msg text.
        counts: the number of messages of each topic.
        offered: the QoS that the publishers of each topic offered; empty if not recorded.
        count: the number of all messages, including those that are not in CDR.
        start_ns, end_ns: times of the first and the last message; 0 without messages.
    """

    topics: dict[str, str] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    offered: dict[str, list[Qos]] = field(default_factory=dict)
    count: int = 0
    start_ns: int = 0
    end_ns: int = 0

    def add_topic(self, name: str, kind: str, offered: str) -> None:
        """Add a topic of a file; ``offered`` is its publishers' QoS in rosbag2's YAML."""
        self.topics.setdefault(name, kind)
        self.counts.setdefault(name, 0)
        self.offered.setdefault(name, []).extend(_offered(offered))

    def add_messages(self, name: str, count: int, start_ns: int, end_ns: int) -> None:
        """Count messages of a topic; ``name`` is unknown if they are not in CDR."""
        if name in self.topics:
            self.counts[name] += count
        if count:
            self.start_ns = min(self.start_ns, start_ns) if self.count else start_ns
            self.end_ns = max(self.end_ns, end_ns)
        self.count += count


def _offered(text: str) -> list[Qos]:
    """Parse the QoS that publishers offered; empty if it is not valid YAML."""
    with suppress(yaml.YAMLError, ValueError, TypeError, AttributeError, OverflowError):
        return [
            Qos(  # values are words, or rmw's numbers
                reliability=_word(qos.get("reliability"), {2: "best_effort"}, "reliable"),
                durability=_word(qos.get("durability"), {1: "transient_local"}, "volatile"),
            )
            for qos in bounded_yaml.load(text) or ()
        ]
    return []


def _word(value: Any, words: Mapping[int, str], default: str) -> str:
    return next((word for number, word in words.items() if value in (number, word)), default)


def open_file(path: Path) -> IO[bytes]:
    """Open a regular file of a recording.

    Raises:
        OneBotError: it cannot be read.
    """
    try:
        return bounded_yaml.open_regular(path)
    except OSError as error:
        raise OneBotError(f"{path} cannot be read: {error.strerror}") from error


def check_size(what: str, size: int, max_size: int) -> None:
    """Check a size before reading the data.

    Args:
        what: the thing that has the size, for the message.
        size: the size, bytes.
        max_size: the maximum, bytes.

    Raises:
        ValueError: it is too large.
    """
    if size > max_size:
        raise ValueError(
            f"{what} of {megabytes(size)} is above {megabytes(max_size)}, which max_size sets"
        )


def megabytes(size: int) -> str:
    """Return a number of bytes as text in MB."""
    return f"{size / 1e6:,.1f} MB"


def decompressed(data: bytes, max_size: int) -> bytes:
    """Decompress a zstd frame.

    Raises:
        ValueError: its content is larger than ``max_size`` bytes.
    """
    check_size("a message or chunk", zstandard.frame_content_size(data), max_size)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max_size)
