"""What a recording holds, and what its two formats share: sizes, damage and decompression."""

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
from onebot_description.ros.parameters import bounded_yaml
from onebot_description.ros.wire.cdr import NANO

OFFERED = "offered_qos_profiles"  # a topic's, in both formats
# What mcap, the decompressors and sqlite3 raise for damaged files.
DAMAGE = (
    McapError, OSError, struct.error, zstandard.ZstdError, sqlite3.Error, ValueError, KeyError,
    EOFError, RuntimeError, TypeError, OverflowError, MemoryError,
)  # fmt: skip
_INFINITE_S = 2**31 - 1  # s: this or more stands for an infinite duration; in Foxy it is this


class BagMessage(NamedTuple):
    """A recorded message."""

    topic: str
    type: str  # package/msg/Type
    time: int  # when it was received, nanoseconds
    data: bytes  # CDR, as on the wire


@dataclass
class Contents:
    """What the files of a recording hold.

    Attributes:
        topics: the type of each topic, ``package/msg/Type``; the first one, if it has several.
        definitions: of the types, as far as they are in the files in .msg text.
        counts: of the messages of each topic.
        offered: what the publishers of each topic offered; empty if that was not recorded.
        count: of all messages, those that are not in CDR too.
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
        """Add a topic of a file, with its publishers' QoS in YAML, as rosbag2 writes it."""
        self.topics.setdefault(name, kind)
        self.counts.setdefault(name, 0)
        self.offered.setdefault(name, []).extend(_offered(offered))

    def add_messages(self, name: str, count: int, start_ns: int, end_ns: int) -> None:
        """Count messages of a topic, or of none that is in CDR."""
        if name in self.topics:
            self.counts[name] += count
        if count:
            self.start_ns = min(self.start_ns, start_ns) if self.count else start_ns
            self.end_ns = max(self.end_ns, end_ns)
        self.count += count


def _offered(text: str) -> list[Qos]:
    """Parse the QoS that publishers offered; empty if it is no valid YAML."""
    with suppress(yaml.YAMLError, ValueError, TypeError, AttributeError, OverflowError):
        return [
            Qos(  # words, or the numbers of rmw
                reliability=_word(qos.get("reliability"), {2: "best_effort"}, "reliable"),
                durability=_word(qos.get("durability"), {1: "transient_local"}, "volatile"),
                depth=int(qos.get("depth", 0)),
                liveliness=_word(qos.get("liveliness"), {3: "manual_by_topic"}, "automatic"),
                deadline=_limit(qos.get("deadline")),
                lifespan=_limit(qos.get("lifespan")),
                lease=_limit(qos.get("liveliness_lease_duration")),
            )
            for qos in bounded_yaml.load(text) or ()
        ]
    return []


def _word(value: Any, words: Mapping[int, str], default: str) -> str:
    return next((word for number, word in words.items() if value in (number, word)), default)


def _limit(duration: Mapping[str, Any] | None) -> int | None:
    """A duration, ns; None for an infinite one, or none."""
    if duration is None:
        return None
    seconds, nanoseconds = int(duration.get("sec", 0)), int(duration.get("nsec", 0))
    limit = seconds * NANO + nanoseconds
    return limit if seconds < _INFINITE_S and 0 < limit < _INFINITE_S * NANO else None


def open_file(path: Path) -> IO[bytes]:
    """Open a regular file of a recording, or raise an OneBotError."""
    try:
        return bounded_yaml.open_regular(path)
    except OSError as error:
        raise OneBotError(f"{path} cannot be read: {error.strerror}") from error


def check_size(what: str, size: int, max_size: int) -> None:
    """Raise a ValueError for what is too large to be read, before it is."""
    if size > max_size:
        raise ValueError(
            f"{what} of {megabytes(size)} is above {megabytes(max_size)}, which max_size sets"
        )


def megabytes(size: int) -> str:
    """Return a number of bytes as messages show it."""
    return f"{size / 1e6:,.1f} MB"


def decompressed(data: bytes, max_size: int) -> bytes:
    """Return what a frame of zstd holds, unless that is more than ``max_size``."""
    check_size("a message or chunk", zstandard.frame_content_size(data), max_size)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max_size)
