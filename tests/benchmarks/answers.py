"""Checks serialized TFMessages against a chain's transforms.

Reading is left to rclpy's own deserialisation, which shares nothing with the project's: where the
numbers lie is found by serialising a message whose numbers say which they are. While what lies
between the numbers stays as it was, only they are looked at.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from onebot_description.wire.tf_message import TFMessage
from tests.benchmarks.chains import Chain, Floats, pose_error
from tests.benchmarks.measuring import WrongAnswer

# Quaternions and metres; what double precision leaves is some 1e-15.
TOLERANCE = 1e-9
_BODY = 4  # bytes before the message, whence its fields are aligned
_NANO = 1_000_000_000
# No other bytes of a message can be taken for these.
_MARK = 1.2345678e300
_SECONDS_MARK, _NANOSECONDS_MARK = 0x5AB71C5E, 0x2B67A3C9


class _Layout(NamedTuple):
    """Where the numbers of a message of one length lie, and what lies between them."""

    stamps: NDArray[np.intp]
    numbers: NDArray[np.intp]
    between: NDArray[np.bool_]
    text: NDArray[np.uint8]


class AnswerChecker:
    """Holds the expected answers to some sets of positions.

    Attributes:
        worst: the largest error of a number so far.
    """

    def __init__(self, chain: Chain, positions: Floats) -> None:
        self._expected = chain.transforms(positions)
        self._frames = list(zip(chain.links[:-1], chain.links[1:], strict=True))
        self._layouts: dict[int, _Layout] = {}
        self.worst = 0.0

    def check(self, data: bytes, row: int, stamp_ns: int) -> None:
        """Check the answer to positions ``row``, sent with ``stamp_ns``.

        Raises:
            WrongAnswer: frames, stamp or a number are wrong.
        """
        layout = self._layouts.get(len(data))
        body = np.frombuffer(data, np.uint8)[_BODY:]
        if layout is None or not np.array_equal(body[layout.between], layout.text):
            layout = self._layouts[len(data)] = self._read(data)
        words = body[: len(body) // 4 * 4].view("<u4")
        expected = np.array(divmod(stamp_ns, _NANO), np.uint32)
        if not (words[layout.stamps] == expected).all():
            raise WrongAnswer(f"a transform is not stamped {stamp_ns} ns as its joint state was")
        numbers = body[: len(body) // 8 * 8].view("<f8")[layout.numbers]
        error = pose_error(numbers, self._expected[row])
        self.worst = float(np.maximum(self.worst, error))
        if not error <= TOLERANCE:
            raise WrongAnswer(f"a transform is off by {error:.3g} (allowed: {TOLERANCE:g})")

    def _read(self, data: bytes) -> _Layout:
        """Find the numbers in the order of the chain's joints; check the frames."""
        message = deserialize_message(data, TFMessage)
        frames = [(t.header.frame_id, t.child_frame_id) for t in message.transforms]
        if sorted(frames) != sorted(self._frames):
            raise WrongAnswer(_frames_differ(frames, self._frames))
        for number, transform in enumerate(message.transforms):
            _mark(transform, 7 * number)
        marked = np.frombuffer(serialize_message(message), np.uint8)
        if len(marked) != len(data):
            raise WrongAnswer(f"an answer has {len(data)} bytes, its content {len(marked)}")
        body = marked[_BODY:]
        words = body[: len(body) // 4 * 4].view("<u4")
        doubles = body[: len(body) // 8 * 8].view("<f8")
        ids = np.arange(7 * len(frames))
        places = np.flatnonzero(np.isin(doubles, _MARK * (1.0 + ids * 1e-9)))
        seconds = np.flatnonzero(words == _SECONDS_MARK)
        rows = {frame: row for row, frame in enumerate(frames)}
        order = [rows[frame] for frame in self._frames]
        between = np.ones(len(body), bool)
        numbers = places.reshape(len(frames), 7)
        stamps = seconds[:, None] + np.arange(2)
        between[(8 * numbers[..., None] + np.arange(8)).ravel()] = False
        between[(4 * stamps[..., None] + np.arange(4)).ravel()] = False
        text = np.frombuffer(data, np.uint8)[_BODY:][between]
        return _Layout(stamps, numbers[order], between, text)


def _mark(transform: Any, first: int) -> None:
    """Give a transform a stamp and numbers that can be found again."""
    # Seconds are signed in the message; the mark fits both ways.
    transform.header.stamp.sec = _SECONDS_MARK
    transform.header.stamp.nanosec = _NANOSECONDS_MARK
    translation, rotation = transform.transform.translation, transform.transform.rotation
    names = [(translation, name) for name in "xyz"] + [(rotation, name) for name in "xyzw"]
    for number, (owner, name) in enumerate(names, first):
        setattr(owner, name, _MARK * (1.0 + number * 1e-9))


def _frames_differ(found: Sequence[tuple[str, str]], expected: Sequence[tuple[str, str]]) -> str:
    missing = [" -> ".join(pair) for pair in expected if pair not in found]
    other = [" -> ".join(pair) for pair in found if pair not in expected]
    return (
        f"an answer holds {len(found)} transforms instead of {len(expected)}; missing: "
        f"{', '.join(missing[:3]) or 'none'}; not asked for: {', '.join(other[:3]) or 'none'}"
    )
