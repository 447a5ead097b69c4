"""Decodes the gRPC-web messages of Rerun's server (log_msg.proto of its re_protos)."""

from collections.abc import Hashable, Iterator, Sequence
from typing import Any

SERVICE = "rerun.sdk_comms.v1alpha1.MessageProxyService"
"""The path below which Rerun's page requests data from the host and port in its ``url=``."""
GRPC_WEB = "application/grpc-web+proto"
HEAD = 5  # bytes before each message: flags, then its length

_ARROW_MSG = 2  # the kind of message with data
# Field numbers.
_LOG_MSG = 1
_STORE_ID, _COMPRESSION, _UNCOMPRESSED_SIZE, _PAYLOAD, _IS_STATIC = 1, 2, 3, 5, 7
_LZ4 = 2
_CHILDREN = "Transform3D:child_frame"  # the column with the frames of transforms
_VARINT, _BYTES = 0, 2  # protobuf's wire types
_BAD_MESSAGE = (LookupError, TypeError, ValueError, OverflowError)


def length(head: bytes) -> int:
    """Return the number of bytes that follow a message's head."""
    return int.from_bytes(head[1:], "big")


def subjects(message: bytes) -> Sequence[Hashable]:
    """Return the subjects of a message, which newer messages with all of them replace.

    A subject is an entity with its components; transforms have one for each frame, and each message
    without data has its own.
    """
    import pyarrow as pa  # slow to import, and few viewers are slow

    try:
        [(kind, data)] = _fields(dict(_fields(memoryview(message)[HEAD:]))[_LOG_MSG])
        fields = dict(_fields(data)) if kind == _ARROW_MSG else {}
        table = fields[_PAYLOAD]
        if fields.get(_COMPRESSION) == _LZ4:
            table = pa.decompress(table, fields[_UNCOMPRESSED_SIZE], codec="lz4_raw")
        stream = pa.ipc.open_stream(table)
        schema, frames = stream.schema, [""]
        if _CHILDREN in schema.names:
            rows = stream.read_next_batch().column(_CHILDREN)
            frames = rows.flatten().unique().to_pylist() or frames
        entity = schema.metadata[b"rerun:entity_path"]
        store, is_static = bytes(fields[_STORE_ID]), fields.get(_IS_STATIC)
        return [(store, is_static, entity, tuple(schema.names), frame) for frame in frames]
    except (*_BAD_MESSAGE, pa.ArrowException, StopIteration):
        return [object()]


def _fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Yield the numbers and values of a protobuf message's fields."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        value, at = _varint(data, at)
        if key & 7 == _BYTES:
            at += value
            yield key >> 3, data[at - value : at]
        elif key & 7 == _VARINT:
            yield key >> 3, value
        else:
            raise ValueError(f"wire type {key & 7}")


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """Return a variable-length number, and the position after it."""
    number = shift = 0
    while True:
        byte = data[at]
        number, shift, at = number | (byte & 0x7F) << shift, shift + 7, at + 1
        if byte < 0x80:
            return number, at
