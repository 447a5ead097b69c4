"""Reads messages whose names stay the same, which is what one publisher sends again and again.

The names of joints and frames are most of the work of decoding. Here they are compared, as bytes,
with those of messages read before, and only the numbers are taken out; of many messages at once.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.wire.cdr import (
    DOUBLES_PER_TRANSFORM,
    ENCAPSULATION,
    NANO,
    JointStateArrays,
    Reader,
    TfArrays,
)

# Which bytes of a message say what its numbers belong to.


class MarkingReader(Reader):
    """Reads a message, and marks what must be the same in others to be read like it.

    Strings and lengths are; padding and numbers may hold anything.

    Attributes:
        mask: (bytes of the message,) 255 where it is marked, 0 elsewhere.
    """

    def __init__(self, data: bytes) -> None:
        """Check the encapsulation.

        Raises:
            WireError: it is not plain little-endian CDR.
        """
        super().__init__(data)
        self.mask: NDArray[np.uint8] = np.zeros(len(data), np.uint8)
        self.mask[: len(ENCAPSULATION) // 2] = 255  # the other half are options

    def u32(self) -> int:
        """Read and mark an unsigned 32-bit number, which is the length of something."""
        number = super().u32()
        self.mask[self.offset - 4 : self.offset] = 255
        return number

    def string(self) -> str:
        """Read and mark a string."""
        self.align(4)
        start = self.offset
        text = super().string()
        self.mask[start : self.offset] = 255
        return text


T = TypeVar("T")
Rows = NDArray[np.uint64]

# Publishers of one topic whose messages are of the same length; more of them are decoded anew.
_MOST = 8
_MOST_LENGTHS = 64
# Four bytes before a message bring its body, and so every double, to its own alignment.
_FRONT = bytes(8 - len(ENCAPSULATION))
_STAMP_WORDS = np.arange(2)


def _stack(messages: Sequence[bytes]) -> Rows:
    """(S, W) words of eight bytes: messages of one length, a row each, after ``_FRONT``."""
    length = len(messages[0])
    width = -(-(len(_FRONT) + length) // 8)
    between = bytes(8 * width - length)
    data = between.join([_FRONT + messages[0], *messages[1:], b""])
    return np.frombuffer(data, np.uint64, width * len(messages)).reshape(-1, width)


class _Layout(ABC, Generic[T]):
    """Where the numbers are in messages of the same names."""

    def __init__(self, data: bytes, reader: MarkingReader) -> None:
        """Take what ``reader`` has marked in a message."""
        [self._fixed], [self._mask] = _stack([data]), _stack([reader.mask.tobytes()])

    def are_in(self, rows: Rows) -> NDArray[np.bool_]:
        """(S,) whether messages of the same length have these names."""
        other: NDArray[np.bool_] = ((rows ^ self._fixed) & self._mask).any(axis=1)
        return ~other

    @abstractmethod
    def read(self, rows: Rows) -> list[T]:
        """Take the numbers out of messages that have these names."""


class _TfLayout(_Layout[TfArrays]):
    def __init__(self, data: bytes) -> None:
        reader = MarkingReader(data)
        self._parents: list[str] = []
        self._children: list[str] = []
        stamps, values = [], []
        for _ in range(reader.count(4 * DOUBLES_PER_TRANSFORM)):
            reader.align(4)
            stamps.append(reader.offset)
            reader.stamp_ns()
            self._parents.append(reader.string())
            self._children.append(reader.string())
            reader.align(8)
            values.append(reader.offset)
            reader.doubles(DOUBLES_PER_TRANSFORM)
        super().__init__(data, reader)
        self._stamps = _slots(stamps, 4)[:, None] + _STAMP_WORDS
        self._values = _slots(values, 8)[:, None] + np.arange(DOUBLES_PER_TRANSFORM)

    def read(self, rows: Rows) -> list[TfArrays]:
        stamps = _nanoseconds(rows, self._stamps)
        values = rows.view(np.float64).take(self._values, axis=1)
        columns = zip(stamps, values[..., :3], values[..., 3:], strict=True)
        return [TfArrays(self._parents, self._children, *column) for column in columns]


class _JointStateLayout(_Layout[JointStateArrays]):
    def __init__(self, data: bytes) -> None:
        reader = MarkingReader(data)
        self._stamp = _slots([reader.offset], 4) + _STAMP_WORDS
        reader.stamp_ns()
        self._frame_id = reader.string()
        self._names = tuple(reader.string() for _ in range(reader.count(4)))
        self._fields = []
        for _ in range(3):
            count = reader.count(8)
            reader.doubles(count)
            [end] = _slots([reader.offset], 8)
            self._fields.append(slice(end - count, end))
        super().__init__(data, reader)

    def read(self, rows: Rows) -> list[JointStateArrays]:
        stamps = _nanoseconds(rows, self._stamp).tolist()
        doubles = rows.view(np.float64)
        columns = zip(stamps, *(doubles[:, field] for field in self._fields), strict=True)
        return [JointStateArrays(at, self._frame_id, self._names, *rest) for at, *rest in columns]


def _slots(offsets: Sequence[int], size: int) -> NDArray[np.intp]:
    """Where in a row, as items of ``size`` bytes, is what lies at ``offsets`` of a message."""
    return (np.array(offsets, np.intp) + len(_FRONT)) // size


def _nanoseconds(rows: Rows, slots: NDArray[np.intp]) -> NDArray[np.int64]:
    """Stamps of messages: (S, ...) of slots (..., 2). Seconds are signed, nanoseconds are not."""
    pairs = rows.view(np.int32).take(slots, axis=1)
    stamps: NDArray[np.int64] = pairs[..., 0] * np.int64(NANO) + pairs[..., 1].view(np.uint32)
    return stamps


class _Repeated(Generic[T]):
    """Reads messages of a kind, and knows those again that it has read before."""

    def __init__(self, layout: Callable[[bytes], _Layout[T]]) -> None:
        self._layout = layout
        self._known: dict[int, list[_Layout[T]]] = {}

    def read(self, data: bytes) -> T:
        """Read a message.

        Raises:
            WireError: the bytes are not a whole message in plain little-endian CDR.
        """
        [found] = self.read_known([data])
        if found is not None:
            return found
        layout = self._layout(data)
        if len(self._known) >= _MOST_LENGTHS:
            self._known.clear()
        known = self._known.setdefault(len(data), [])
        del known[: len(known) - _MOST + 1]
        known.append(layout)
        [found] = layout.read(_stack([data]))
        return found

    def read_known(self, messages: Sequence[bytes]) -> list[T | None]:
        """Read messages whose names were read before; None in the place of others.

        It takes hardly longer for ten than for one.
        """
        found: list[T | None] = [None] * len(messages)
        for length in set(map(len, messages)):
            known = self._known.get(length)
            if known:
                places = [at for at, data in enumerate(messages) if len(data) == length]
                items = _read(known, _stack([messages[at] for at in places]))
                for at, item in zip(places, items, strict=True):
                    found[at] = item
        return found


def _read(known: Sequence[_Layout[T]], rows: Rows) -> list[T | None]:
    """Read messages of one length, each by the layout that it has, if there is one."""
    found: list[T | None] = [None] * len(rows)
    for layout in known:
        here = np.flatnonzero(layout.are_in(rows))
        if len(here) == len(rows):
            return list(layout.read(rows))
        for at, item in zip(here.tolist(), layout.read(rows[here]), strict=True):
            found[at] = item
    return found


class TfReader(_Repeated[TfArrays]):
    """Reads tf2_msgs/msg/TFMessage; the lists of names of those that repeat are the same objects.

    Nobody may change the lists.
    """

    def __init__(self) -> None:
        """Know nothing yet."""
        super().__init__(_TfLayout)


class JointStateReader(_Repeated[JointStateArrays]):
    """Reads sensor_msgs/msg/JointState; the tuples of names of those that repeat are the same."""

    def __init__(self) -> None:
        """Know nothing yet."""
        super().__init__(_JointStateLayout)
