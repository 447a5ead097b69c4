"""CDR bytes <-> arrays, for the two messages of the hot path: JointState in, TFMessage out.

The layout is plain CDR (XCDR version 1, little endian), as every Jazzy node puts it on the wire:
four bytes of encapsulation (00 01 00 00), then the fields in order, each aligned to its size
counted from the end of those four bytes; a string is its length with the closing NUL, then its
bytes; a sequence is its length, then its elements (OMG DDSI-RTPS 2.5, section 10; OMG CORBA 3.0,
section 15.3).

Anything else (big endian, a truncated message) raises WireError: the caller falls back to rclpy's
own deserialisation, which knows every encoding.
"""

import struct
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

# Times as ROS messages have them, and as one number of nanoseconds.

NANO = 1_000_000_000  # nanoseconds in a second


class Stamp(Protocol):
    """A builtin_interfaces/Time."""

    sec: int
    nanosec: int


def nanoseconds(stamp: Stamp) -> int:
    """Return builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)


ENCAPSULATION = b"\x00\x01\x00\x00"
_BODY = len(ENCAPSULATION)
_U32 = struct.Struct("<I")
STAMP = slice(_BODY, _BODY + 8)  # where it lies in a message that begins with a header
_STAMP = struct.Struct("<iI")
DOUBLES_PER_TRANSFORM = 7

Floats = NDArray[np.float64]


class WireError(ValueError):
    """Bytes that are not the plain little-endian CDR this module reads."""


class TfArrays(NamedTuple):
    """A TFMessage as arrays; one row a transform.

    Attributes:
        parents: header.frame_id of each transform, N of them.
        children: child_frame_id of each.
        stamps_ns: (N,) int64, nanoseconds.
        translations: (N, 3), metres.
        rotations: (N, 4), quaternions x y z w.
    """

    parents: list[str]
    children: list[str]
    stamps_ns: NDArray[np.int64]
    translations: Floats
    rotations: Floats


class JointStateArrays(NamedTuple):
    """A JointState as arrays; a field that was left empty has shape (0,).

    Attributes:
        stamp_ns: header.stamp, nanoseconds.
        frame_id: header.frame_id.
        names: joint names.
        positions: radians or metres.
        velocities: radians or metres a second.
        efforts: newton metres or newtons.
    """

    stamp_ns: int
    frame_id: str
    names: tuple[str, ...]
    positions: Floats
    velocities: Floats
    efforts: Floats


class Reader:
    """Reads one CDR message from its start.

    Attributes:
        offset: where the next field is looked for, counted from the first byte of the message.
    """

    def __init__(self, data: bytes) -> None:
        """Check the encapsulation.

        Raises:
            WireError: it is not plain little-endian CDR.
        """
        # The last two bytes are options, which receivers ignore.
        if data[:2] != ENCAPSULATION[:2] or len(data) < _BODY:
            raise WireError("not plain little-endian CDR")
        self._data = data
        self.offset = _BODY

    def align(self, size: int) -> None:
        """Skip padding up to a multiple of ``size`` bytes from the body's start."""
        self.offset += -(self.offset - _BODY) % size

    def _unpack(self, form: struct.Struct) -> tuple[int, ...]:
        self.align(4)
        try:
            values = form.unpack_from(self._data, self.offset)
        except struct.error as error:
            raise WireError("truncated") from error
        self.offset += form.size
        return values

    def u32(self) -> int:
        """Read an unsigned 32-bit number."""
        return self._unpack(_U32)[0]

    def stamp_ns(self) -> int:
        """Read a builtin_interfaces/Time, as nanoseconds."""
        seconds, nanoseconds = self._unpack(_STAMP)
        return seconds * NANO + nanoseconds

    def string(self) -> str:
        """Read a string (UTF-8, as rclpy writes it)."""
        length = self.u32()
        end = self.offset + length
        if end > len(self._data):
            raise WireError("truncated string")
        text = self._data[self.offset : max(end - 1, self.offset)]
        self.offset = end
        try:
            return text.decode()
        except UnicodeDecodeError as error:
            raise WireError("string is not UTF-8") from error

    def count(self, smallest: int) -> int:
        """Read a sequence's length, whose elements take at least ``smallest`` bytes each."""
        count = self.u32()
        if count * smallest > len(self._data) - self.offset:
            raise WireError("truncated sequence")
        return count

    def doubles(self, count: int) -> Floats:
        """View ``count`` doubles in place: shape (count,), read-only."""
        if count == 0:
            return np.empty(0)
        self.align(8)
        if self.offset + 8 * count > len(self._data):
            raise WireError("truncated doubles")
        view = np.frombuffer(self._data, "<f8", count, self.offset)
        self.offset += 8 * count
        return view


def decode_joint_state(data: bytes) -> JointStateArrays:
    """Read a serialized sensor_msgs/msg/JointState; the arrays are views into ``data``.

    Raises:
        WireError: the bytes are not a whole message in plain little-endian CDR.
    """
    reader = Reader(data)
    stamp = reader.stamp_ns()
    frame_id = reader.string()
    names = tuple(reader.string() for _ in range(reader.count(4)))
    fields = [reader.doubles(reader.count(8)) for _ in range(3)]
    return JointStateArrays(stamp, frame_id, names, *fields)


def decode_tf(data: bytes) -> TfArrays:
    """Read a serialized tf2_msgs/msg/TFMessage.

    Raises:
        WireError: the bytes are not a whole message in plain little-endian CDR.
    """
    reader = Reader(data)
    count = reader.count(4 * DOUBLES_PER_TRANSFORM)
    parents: list[str] = []
    children: list[str] = []
    stamps = np.empty(count, np.int64)
    values = np.empty((count, DOUBLES_PER_TRANSFORM))
    for row in range(count):
        stamps[row] = reader.stamp_ns()
        parents.append(reader.string())
        children.append(reader.string())
        values[row] = reader.doubles(DOUBLES_PER_TRANSFORM)
    return TfArrays(parents, children, stamps, values[:, :3], values[:, 3:])


class Writer:
    """Writes one CDR message from its start.

    Attributes:
        data: what is written so far, from the encapsulation on.
        mask: as long as ``data``: 255 where something is written, 0 where bytes are left out or
            pad.
    """

    def __init__(self) -> None:
        """Write the encapsulation."""
        self.data, self.mask = bytearray(), bytearray()
        self._put(ENCAPSULATION)

    def u32(self, number: int) -> None:
        """Write an unsigned 32-bit number."""
        self.leave_out(0, 4)
        self._put(_U32.pack(number))

    def string(self, text: str) -> None:
        """Write a string."""
        encoded = text.encode()
        self.u32(len(encoded) + 1)
        self._put(encoded + b"\x00")

    def leave_out(self, size: int, alignment: int) -> int:
        """Leave out ``size`` bytes at a multiple of ``alignment``; return where they begin."""
        pad = -(len(self.data) - _BODY) % alignment
        self.data += bytes(pad + size)
        self.mask += bytes(pad + size)
        return len(self.data) - size

    def _put(self, data: bytes) -> None:
        self.data += data
        self.mask += b"\xff" * len(data)
