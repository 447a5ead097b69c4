"""CDR, the format of serialized ROS messages: reads stamps, and writes fields.

The layout is plain CDR (XCDR version 1, little endian), as every Jazzy node puts it on the wire:
four bytes of encapsulation (00 01 00 00), then the fields in order, each aligned to its size
counted from the end of those four bytes; a string is its length with the closing NUL, then its
bytes; a sequence is its length, then its elements (OMG DDSI-RTPS 2.5, section 10; OMG CORBA 3.0,
section 15.3).

``schema`` reads whole messages. Anything else (big endian, a truncated message) raises WireError.
"""

import struct
from collections.abc import Sequence
from typing import Any

from onebot_description.timing import NS_PER_S

SYSTEM_TIME_NS = 10**18  # the year 2001; stamps of simulated time are smaller

ENCAPSULATION = b"\x00\x01\x00\x00"
_BODY = len(ENCAPSULATION)
HEADER = _BODY  # byte of the stamp in a message that begins with a header
STAMP = slice(HEADER, HEADER + 8)
DOUBLES_PER_TRANSFORM = 7

_U32 = struct.Struct("<I")
_STAMP = struct.Struct("<iI")


class WireError(ValueError):
    """The bytes are not plain little-endian CDR."""


def nanoseconds(stamp: Any) -> int:
    """Return builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def stamp_at(data: bytes, at: int) -> int:
    """Return the stamp at a byte of a serialized message, nanoseconds; 0 if there is none."""
    if not data.startswith(ENCAPSULATION[:2]) or len(data) < at + _STAMP.size:
        return 0
    seconds, nanosec = _STAMP.unpack_from(data, at)
    return int(seconds * NS_PER_S + nanosec)


class Writer:
    """Writes one CDR message from its start.

    Attributes:
        data: the bytes so far, including the encapsulation.
        mask: as long as ``data``: 255 for bytes that were written, 0 for bytes that were left out,
            and for padding.
    """

    def __init__(self) -> None:
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

    def stamp(self, stamp_ns: int) -> None:
        """Write nanoseconds as builtin_interfaces/Time."""
        self.leave_out(0, 4)
        self._put(_STAMP.pack(*divmod(stamp_ns, NS_PER_S)))

    def doubles(self, numbers: Sequence[float]) -> None:
        """Write 64-bit floating-point numbers, such as an array or consecutive fields."""
        if numbers:
            self.leave_out(0, 8)
            self._put(struct.pack(f"<{len(numbers)}d", *numbers))

    def leave_out(self, size: int, alignment: int) -> int:
        """Leave out ``size`` bytes at a multiple of ``alignment``; return their position."""
        pad = -(len(self.data) - _BODY) % alignment
        self.data += bytes(pad + size)
        self.mask += bytes(pad + size)
        return len(self.data) - size

    def _put(self, data: bytes) -> None:
        self.data += data
        self.mask += b"\xff" * len(data)
