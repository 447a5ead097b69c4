"""Reads MCAP files of ROS 2; of damaged ones, what comes before the damage."""

import struct
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO

import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.summary import Summary

from onebot_bringup.bag.chunks import MAGIC
from onebot_bringup.bag.messages import BagMessage, Contents
from onebot_description.errors import OneBotError

# Whatever the library stumbles over in bytes that are no MCAP.
_DAMAGE = (
    McapError, OSError, struct.error, zstandard.ZstdError, ValueError, KeyError, EOFError,
    RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
_CDR = "cdr"
_MOST = 1 << 30  # bytes of a record: more is taken to be damage


def topics_of_mcap(path: Path) -> Contents:
    """Return what is in the file, by its summary; by reading all of it where that is missing.

    Raises:
        OneBotError: it is no MCAP file, or no messages of ROS 2 are in it.
    """
    with _opened(path) as file:
        summary = _summary(file)
        if summary is not None:
            statistics = summary.statistics
            contents = Contents(
                _topics(summary.channels, summary.schemas),
                statistics.message_count if statistics else 0,
            )
        else:
            contents = _counted(file)
    if not contents.topics and contents.count:
        raise OneBotError(f"{path} holds no messages of ROS 2 (in CDR)")
    return contents


def _opened(path: Path) -> IO[bytes]:
    try:
        file = path.open("rb")
    except OSError as error:
        raise OneBotError(f"{path}: {error.strerror}") from error
    start = file.read(len(MAGIC))
    if start != MAGIC:
        file.close()
        what = "is empty" if not start else "is no MCAP file"
        raise OneBotError(f"{path} {what}")
    return file


def _summary(file: IO[bytes]) -> Summary | None:
    """The summary; None where the file was cut off before its end, or has none."""
    file.seek(0)
    try:
        summary = SeekingReader(file, record_size_limit=_MOST).get_summary()
    except _DAMAGE:
        return None
    # Written without an index of its chunks, it has to be read in order.
    return summary if summary is not None and summary.chunk_indexes else None


def _topics(channels: dict[int, Channel], schemas: dict[int, Schema]) -> dict[str, str]:
    return {
        channel.topic: _full(schemas[channel.schema_id].name)
        for channel in channels.values()
        if channel.message_encoding == _CDR and channel.schema_id in schemas
    }


def _full(name: str) -> str:
    """``package/msg/Type``, of the short name too that some writers use."""
    package, _, kind = name.partition("/")
    return name if "/" in kind else f"{package}/msg/{kind}"


def _counted(file: IO[bytes]) -> Contents:
    topics: dict[str, str] = {}
    count = 0
    for schema, channel, _ in _in_order(file, lambda _: None):
        count += 1
        if channel.message_encoding == _CDR and schema is not None:
            topics[channel.topic] = _full(schema.name)
    return Contents(topics, count)


def read_mcap(
    path: Path, topics: Collection[str], warn: Callable[[str], None]
) -> Iterator[BagMessage]:
    """Yield the messages of ``topics`` in the order of their times.

    Args:
        path: the file.
        topics: names.
        warn: told if the file ends early; what comes before is yielded in the file's order.
    """
    with _opened(path) as file:
        if _summary(file) is not None:
            file.seek(0)
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=_MOST)
            found = _guarded(reader.iter_messages(topics=list(topics)), path, warn)
        else:
            found = _in_order(file, lambda why: warn(f"{path} is damaged or cut off: {why}"))
        for schema, channel, message in found:
            usable = channel.message_encoding == _CDR and schema is not None
            if usable and channel.topic in topics:
                assert schema is not None
                yield BagMessage(
                    channel.topic, _full(schema.name), message.log_time, bytes(message.data)
                )


_Found = Iterator[tuple[Schema | None, Channel, Message]]


def _guarded(found: _Found, path: Path, warn: Callable[[str], None]) -> _Found:
    try:
        yield from found
    except _DAMAGE as error:
        warn(f"{path} is damaged: {_reason(error)}; showing what comes before")


def _in_order(file: IO[bytes], warn: Callable[[str], None]) -> _Found:
    """Yield messages as they stand in the file, up to its end or the first damage."""
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
        warn(f"{_reason(error)}; showing what comes before")


def _reason(error: BaseException) -> str:
    if isinstance(error, CRCValidationError):
        return "a checksum is wrong"
    return str(error) or "it ends too early"
