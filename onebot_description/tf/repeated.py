"""Reads messages whose names stay the same, which is what one publisher sends again and again.

The names of joints and frames are most of the work of decoding. Here they are compared, as bytes,
with those of messages read before, and only the numbers are taken out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.tf.wire import (
    ENCAPSULATION,
    JointStateArrays,
    Reader,
    TfArrays,
    TfTemplate,
    decode_joint_state,
    decode_tf,
)

# Publishers of one topic whose messages are of the same length; more of them are decoded anew.
_MOST = 8


class TfReader:
    """Reads TFMessages. The lists of names of those that repeat are the same objects each time."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._known: dict[int, list[TfTemplate]] = {}

    def read(self, data: bytes) -> TfArrays:
        """Read a serialized tf2_msgs/msg/TFMessage; see ``decode_tf``."""
        known = self._known.setdefault(len(data), [])
        for template in known:
            arrays = template.read(data)
            if arrays is not None:
                return arrays
        arrays = decode_tf(data)
        template = TfTemplate(arrays.parents, arrays.children)
        if template.read(data) is not None:
            del known[: len(known) - _MOST + 1]
            known.append(template)
        return arrays


class _Names(NamedTuple):
    """What stays the same in a JointState, and what it says.

    Attributes:
        data: all before the numbers.
        mask: of ``data``, where the names are; padding may hold anything, and does.
        frame_id: of the header.
        names: of the joints.
    """

    data: NDArray[np.uint8]
    mask: NDArray[np.uint8]
    frame_id: str
    names: tuple[str, ...]

    @classmethod
    def of(cls, data: bytes) -> "_Names":
        """Take the names of a message."""
        reader = Reader(data)
        reader.stamp_ns()
        start = reader.offset
        frame_id = reader.string()
        spans = [(start, reader.offset)]
        reader.align(4)
        start = reader.offset
        count = reader.count(4)
        names = []
        for _ in range(count):
            names.append(reader.string())
            spans.append((start, reader.offset))
            reader.align(4)
            start = reader.offset
        end = spans[-1][1] if count else reader.offset
        mask = np.zeros(end, np.uint8)
        mask[: len(ENCAPSULATION) // 2] = 255
        for first, last in spans:
            mask[first:last] = 255
        return cls(np.frombuffer(data, np.uint8, end), mask, frame_id, tuple(names))

    def are_in(self, data: bytes) -> bool:
        """Whether a message of the same length has these names."""
        found = np.frombuffer(data, np.uint8, len(self.data))
        return not ((found ^ self.data) & self.mask).any()


class JointStateReader:
    """Reads JointStates. The tuples of names of those that repeat are the same objects."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._known: dict[int, list[_Names]] = {}

    def read(self, data: bytes) -> JointStateArrays:
        """Read a serialized sensor_msgs/msg/JointState; see ``decode_joint_state``."""
        known = self._known.setdefault(len(data), [])
        for names in known:
            if names.are_in(data):
                return _numbers(data, names)
        arrays = decode_joint_state(data)
        del known[: len(known) - _MOST + 1]
        known.append(_Names.of(data))
        return arrays


def _numbers(data: bytes, names: _Names) -> JointStateArrays:
    reader = Reader(data)
    stamp = reader.stamp_ns()
    reader.offset = len(names.data)
    fields = [reader.doubles(reader.count(8)) for _ in range(3)]
    return JointStateArrays(stamp, names.frame_id, names.names, *fields)
