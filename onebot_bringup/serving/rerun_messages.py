"""The messages of Rerun's server, as it sends them in gRPC-web (log_msg.proto of its re_protos)."""

from collections.abc import Hashable, Iterator
from typing import Any

SERVICE = "rerun.sdk_comms.v1alpha1.MessageProxyService"
"""Below this, Rerun's page requests its data from the host and port of its ``url=`` parameter."""
GRPC_WEB = "application/grpc-web+proto"
REQUEST = bytes(5)  # a message without fields asks for all that is recorded
HEAD = 5  # bytes before each message: flags, then its length
LAYOUT = 3  # the kind of a message that shows a layout, which has come before it

_ARROW_MSG = 2  # the kind of messages with data
# Numbers of fields.
_LOG_MSG = 1
_STORE_ID, _COMPRESSION, _UNCOMPRESSED_SIZE, _PAYLOAD, _CHUNK_ID, _IS_STATIC = 1, 2, 3, 5, 6, 7
_TIME_NS = 1
_LZ4 = 2
_VARINT, _FIXED64, _BYTES = 0, 1, 2  # protobuf's wire types
_BAD_MESSAGE = (LookupError, TypeError, ValueError, OverflowError)


def length(head: bytes) -> int:
    """Return how many bytes follow a message's head."""
    return int.from_bytes(head[1:], "big")


def content(message: bytes) -> tuple[int, memoryview]:
    """Return the kind of a message, and what it is, as they are in a recording's file, too.

    Raises:
        ValueError: Rerun writes no such message.
    """
    try:
        [(kind, data)] = _fields(dict(_fields(memoryview(message)[HEAD:]))[_LOG_MSG])
    except _BAD_MESSAGE as error:
        raise ValueError(f"no message of Rerun's: {error}") from error
    return kind, data


def subject(message: bytes) -> Hashable:
    """Return what a message is about; a newer message about the same replaces it.

    That is an entity and its components; of messages that hold no data each has its own.
    """
    import pyarrow as pa  # slow to import, and few viewers are slow

    try:
        kind, data = content(message)
        fields = dict(_fields(data)) if kind == _ARROW_MSG else {}
        table = fields[_PAYLOAD]
        if fields.get(_COMPRESSION) == _LZ4:
            table = pa.decompress(table, fields[_UNCOMPRESSED_SIZE], codec="lz4_raw")
        schema = pa.ipc.open_stream(table).schema
        entity = schema.metadata[b"rerun:entity_path"]
        return bytes(fields[_STORE_ID]), fields.get(_IS_STATIC), entity, tuple(schema.names)
    except (*_BAD_MESSAGE, pa.ArrowException):
        return object()


def logged_ns(message: bytes) -> int:
    """Return when the data of a message were logged, nanoseconds; 0 if it has none."""
    try:
        kind, data = content(message)
        fields = dict(_fields(data)) if kind == _ARROW_MSG else {}
        return int(dict(_fields(fields[_CHUNK_ID]))[_TIME_NS])
    except _BAD_MESSAGE:
        return 0


def _fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Yield the numbers and values of a protobuf message's fields."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        if key & 7 == _FIXED64:
            at += 8
            yield key >> 3, int.from_bytes(data[at - 8 : at], "little")
            continue
        value, at = _varint(data, at)
        if key & 7 == _BYTES:
            at += value
            yield key >> 3, data[at - value : at]
        elif key & 7 == _VARINT:
            yield key >> 3, value
        else:
            raise ValueError(f"wire type {key & 7}")


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """Return a number of variable length, and where it ends."""
    number = shift = 0
    while True:
        byte = data[at]
        number, shift, at = number | (byte & 0x7F) << shift, shift + 7, at + 1
        if byte < 0x80:
            return number, at
