"""CDR, the format of serialized ROS messages: reads and writes its fields.

The layout is plain CDR (XCDR version 1, little endian), as every Jazzy node puts it on the wire:
four bytes of encapsulation (00 01 00 00), then the fields in order, each aligned to its size
counted from the end of those four bytes; a string is its length with the closing NUL, then its
bytes; a sequence is its length, then its elements (OMG DDSI-RTPS 2.5, section 10; OMG CORBA 3.0,
section 15.3).

Anything else (big endian, a truncated message) raises WireError: the caller falls back to rclpy's
own deserialization, which reads every encoding.
"""

import ctypes
import functools
import struct
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_description.wire.library import load_library
from onebot_description.wire.remembered import Remembered

Floats = NDArray[np.float64]

NANO = 1_000_000_000  # nanoseconds in a second
SYSTEM_TIME_NS = 10**18  # of the year 2001: stamps of simulated time are less

ENCAPSULATION = b"\x00\x01\x00\x00"
_BODY = len(ENCAPSULATION)
HEADER = _BODY  # byte of the stamp in a message that begins with a header
STAMP = slice(HEADER, HEADER + 8)
DOUBLES_PER_TRANSFORM = 7

_U32 = struct.Struct("<I")
_STAMP = struct.Struct("<iI")


class WireError(ValueError):
    """Bytes that are not the plain little-endian CDR this module reads."""


class Stamp(Protocol):
    """A builtin_interfaces/Time."""

    sec: int
    nanosec: int


def nanoseconds(stamp: Stamp) -> int:
    """Return builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def stamp_at(data: bytes, at: int) -> int:
    """Return the stamp at a byte of a serialized message, nanoseconds; 0 if there is none."""
    if not data.startswith(ENCAPSULATION[:2]) or len(data) < at + _STAMP.size:
        return 0
    seconds, nanosec = _STAMP.unpack_from(data, at)
    return int(seconds * NANO + nanosec)


class Reader:
    """Reads one CDR message from its start.

    Attributes:
        offset: where the next field is read, counted from the first byte of the message.
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
        [length] = self._unpack(_U32)
        data, at = self._data, self.offset
        self.offset = end = at + length
        if end > len(data):
            raise WireError("truncated string")
        return _decode(data, at, end)

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

    def strings(self, count: int) -> tuple[str, ...]:
        """Read ``count`` strings; the same strings are mostly the same object again."""
        return self._items(count, 1)

    def transforms(self, count: int) -> tuple[tuple[str, ...], NDArray[np.int64], Floats]:
        """Read ``count`` of geometry_msgs/TransformStamped.

        Returns:
            Parent and child of each in turn, as from ``strings``; (count,) stamps, nanoseconds;
            (count, 7) translation x y z in metres, rotation x y z w.
        """
        stamps, values = np.empty(count, np.int64), np.empty((count, DOUBLES_PER_TRANSFORM))
        return self._items(count, 2, stamps, values), stamps, values

    def _items(
        self,
        count: int,
        strings: int,
        stamps: NDArray[np.int64] | None = None,
        values: Floats | None = None,
    ) -> tuple[str, ...]:
        """Read items of a stamp, so many strings, and doubles; return the strings of all."""
        text = np.empty(len(self._data) - self.offset, np.uint8)
        text_size = ctypes.c_uint64()
        end = _read_items()(
            self._data,
            len(self._data),
            self.offset,
            count,
            strings,
            0 if values is None else values.shape[1],
            None if stamps is None else stamps.ctypes.data,
            text.ctypes.data,
            ctypes.addressof(text_size),
            None if values is None else values.ctypes.data,
        )
        if end < 0:
            raise WireError("truncated")
        self.offset = end
        return _strings(text[: text_size.value].tobytes())


@functools.cache
def _read_items() -> Any:
    """Return the compiled function of _cdr.c."""
    function = load_library().onebot_read_items
    pointer, size = ctypes.c_void_p, ctypes.c_uint64
    function.argtypes = [ctypes.c_char_p, *[size] * 5, *[pointer] * 4]
    function.restype = ctypes.c_int64
    return function


def _split(text: bytes) -> tuple[str, ...]:
    """Return strings, each of which is written with its length before it."""
    strings = []
    at = 0
    while at < len(text):
        [length] = _U32.unpack_from(text, at)
        at += _U32.size + length
        strings.append(_decode(text, at - length, at))
    return tuple(strings)


# To make the strings is most of the work of decoding.
_strings = Remembered(_split, len)


def _decode(data: bytes, at: int, end: int) -> str:
    """Return the string in some bytes, without the NUL that closes it.

    Without one, or with another before it, it is left to rclpy.
    """
    try:
        text = data[at : end - 1].decode()
    except UnicodeDecodeError as error:
        raise WireError("string is not UTF-8") from error
    if "\0" in text or (at != end and data[end - 1]):
        raise WireError("string is not closed by its only NUL")
    return text


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
