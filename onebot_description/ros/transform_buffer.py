"""The core of tf2: stores transforms over time, and computes the transform between two frames.

``TransformBuffer`` has tf2's rules and error messages. Two interfaces are built on it:
``tf2_py.BufferCore`` for users' nodes, and ``FrameTree`` for ours. It needs no ROS: times are
nanoseconds, and 0 is the latest time at which all transforms between two frames are known.
_transform_buffer.c computes the numbers. Threads may share a buffer, since its calls hold the GIL.
"""

import ctypes
import functools
import math
import threading
import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.compiled.library import load_library
from onebot_description.errors import OneBotError
from onebot_description.geometry.matrices import of_transform
from onebot_description.geometry.poses import Transform
from onebot_description.timing import NS_PER_S

CACHE_NS = 10 * NS_PER_S
"""How long transforms are kept by default, as in tf2."""

ROW = np.dtype([("parent", "i8"), ("child", "i8"), ("stamp_ns", "i8"), ("pose", "f8", 7)])
"""A transform to add: numbers of its frames, stamp, and pose x y z in m, x y z w."""

_LONGEST_NS = 2**61  # the sum of a stamp and a cache time must not overflow
_UNLIMITED = 2**62
_NO_FRAME = "NO_PARENT"  # tf2's name of frame number 0
_LOOP, _UNCONNECTED, _EMPTY, _ONE_TIME, _TOO_LATE, _TOO_EARLY = range(1, 7)  # _transform_buffer.c


class TransformException(OneBotError):
    """There is no transform between two frames (yet)."""


class ConnectivityException(TransformException):
    """The frames are not in the same tree."""


class LookupException(TransformException):
    """A frame does not exist, or the tree has a loop."""


class ExtrapolationException(TransformException):
    """The transforms at the requested time are not known."""


class InvalidArgumentException(TransformException):
    """A frame's name is not valid."""


class TimeoutException(TransformException):
    """The answer did not come in time."""


class Found(ctypes.Structure):
    """A transform that was looked up (struct result in _transform_buffer.c).

    Attributes:
        stamp_ns: its time, nanoseconds.
        pose: x y z in m, and the quaternion x y z w of the source frame in the target frame.
    """

    if TYPE_CHECKING:
        stamp_ns: int
        edge_ns: int  # the stamp beyond which the time is, if the lookup failed for that reason
        pose: Sequence[float]

    _fields_ = (
        ("stamp_ns", ctypes.c_int64),
        ("edge_ns", ctypes.c_int64),
        ("pose", ctypes.c_double * 7),
    )

    @property
    def transform(self) -> Transform:
        """The pose as a transform."""
        x, y, z, a, b, c, w = self.pose
        return Transform((x, y, z), (a, b, c, w))

    @property
    def matrix(self) -> Floats:
        """The pose as a matrix (4, 4)."""
        return of_transform(self.transform)


class FrameState(NamedTuple):
    """The state of a frame.

    Attributes:
        parent: its parent in the latest transform; "NO_PARENT" if its history is empty.
        is_static: whether its transform holds for all times.
        samples: number of transforms in its history.
        oldest_ns, latest_ns: their stamps, nanoseconds; 0 if it is static or empty.
    """

    parent: str
    is_static: bool
    samples: int
    oldest_ns: int
    latest_ns: int


@functools.cache
def _functions() -> ctypes.PyDLL:
    """Return the compiled library, with the signatures of _transform_buffer.c declared."""
    library = load_library()
    number, pointer, result = ctypes.c_int64, ctypes.c_void_p, ctypes.POINTER(Found)
    for name, kind, arguments in (
        ("new", pointer, (number, number, number)),
        ("free", None, (pointer,)),
        ("grow", ctypes.c_int, (pointer, number)),
        ("empty", None, (pointer, number, number)),
        ("unit", None, (pointer,)),
        ("add", number, (pointer, pointer, number, number)),
        ("lookup", ctypes.c_int, (pointer, *[number] * 4, result)),
        ("common_time", ctypes.c_int, (pointer, number, number, ctypes.POINTER(number))),
        ("known_until", number, (pointer, number, number)),
        ("states", None, (pointer, number, number, pointer, pointer)),
    ):
        function = getattr(library, f"onebot_buffer_{name}")
        function.restype, function.argtypes = kind, arguments
    return library


def unit(rotation: Sequence[float]) -> list[float]:
    """Return a quaternion normalized as in tf2; NaN if its length is 0."""
    values = (ctypes.c_double * 4)(*rotation)
    _functions().onebot_buffer_unit(values)
    return values[:]


def seconds(time_ns: int) -> float:
    """Return nanoseconds as seconds, rounded as tf2 does."""
    seconds, nanoseconds = divmod(abs(time_ns), NS_PER_S)
    return math.copysign(seconds + 1e-9 * nanoseconds, time_ns)


def seconds_text(time_ns: int) -> str:
    """Return a time in seconds as tf2 prints it."""
    return f"{seconds(time_ns):.6f}"


class TransformBuffer:
    """Transforms between frames over time.

    Attributes:
        numbers: the number of each frame that was received, from 1.
        frames: their names, by number.
        cache_ns: how long transforms are kept, nanoseconds.

    Args:
        cache_ns: how long to keep transforms, nanoseconds.
        live_ns: 0 for tf2's rules. Otherwise, a frame's history restarts with another parent, and
            with a stamp that is older than the latest by more than this.
        most: how many transforms are kept.
    """

    def __init__(
        self, cache_ns: int = CACHE_NS, *, live_ns: int = 0, most: int = _UNLIMITED
    ) -> None:
        self.cache_ns = min(cache_ns, _LONGEST_NS)
        self.numbers = {_NO_FRAME: 0}
        self.frames = [_NO_FRAME]
        self._lock = threading.Lock()
        self._library = library = _functions()
        self._buffer = library.onebot_buffer_new(self.cache_ns, live_ns, most)
        self._add, self._lookup = library.onebot_buffer_add, library.onebot_buffer_lookup
        library.onebot_buffer_grow(self._buffer, 1)
        weakref.finalize(self, library.onebot_buffer_free, self._buffer)

    # --- input ----------------------------------------------------------------------------------

    def number(self, name: str) -> int:
        """Return the number of a frame, which is added if it is new."""
        number = self.numbers.get(name)
        if number is None:
            with self._lock:
                if name not in self.numbers:
                    if self._library.onebot_buffer_grow(self._buffer, len(self.frames) + 1):
                        raise MemoryError
                    self.frames.append(name)
                    self.numbers[name] = len(self.frames) - 1
                number = self.numbers[name]
        return number

    def add_rows(self, rows: int | bytes, count: int, static: bool) -> int:
        """Add ``count`` rows (see ``ROW``), or those at an address; their values must be valid.

        Returns:
            The number that were not too old, plus 2**32 for each frame with another parent.
        """
        accepted: int = self._add(self._buffer, rows, count, static)
        return accepted

    def drop(self, name: str) -> None:
        """Forget a frame until it is received again."""
        self._library.onebot_buffer_empty(self._buffer, self.numbers[name], 0)

    def clear(self) -> None:
        """Forget all transforms, except static ones."""
        for number, (kind, *_) in enumerate(self._states(0, len(self.frames))[0].tolist()):
            if kind == 1:
                self._library.onebot_buffer_empty(self._buffer, number, kind)

    # --- output ---------------------------------------------------------------------------------

    def find(self, target: str, source: str, time_ns: int, limit: str = _NO_FRAME) -> Found:
        """Return the transform from ``source`` to ``target``, whose names must be valid.

        Args:
            target: the frame to transform into.
            source: the frame to transform from.
            time_ns: the time, nanoseconds.
            limit: if given, a frame above both. Then a frame's nearest transform is used beyond
                its history, and the latest transform of each frame for time 0.

        Raises:
            TransformException: the transform is not known.
        """
        found, numbers = Found(), self.numbers
        failure = self._lookup(
            self._buffer,
            numbers.get(target, 0),
            numbers.get(source, 0),
            time_ns,
            numbers[limit],
            found,
        )
        if failure:
            raise self._explain(failure, found, target, source)
        return found

    def common_time(self, target: str, source: str) -> int:
        """Return the latest time, ns, at which two frames are connected; 0 if all is static.

        Raises:
            TransformException: they are not connected.
        """
        stamp, numbers = ctypes.c_int64(), self.numbers
        failure = self._library.onebot_buffer_common_time(
            self._buffer, numbers.get(target, 0), numbers.get(source, 0), stamp
        )
        if failure:
            raise self._explain(failure, Found(), target, source)
        return stamp.value

    def states(self) -> dict[str, FrameState]:
        """Return the state of each frame that was the child of a transform, in order of arrival."""
        return self._named_states(0, len(self.frames))

    def state(self, name: str) -> FrameState | None:
        """Return the state of a frame; None if it was not the child of a transform."""
        return self._named_states(self.numbers.get(name, 0), 1).get(name)

    def _named_states(self, first: int, count: int) -> dict[str, FrameState]:
        return {
            self.frames[number]: FrameState(self.frames[parent], kind == 2, *numbers)
            for number, (kind, parent, *numbers) in enumerate(
                self._states(first, count)[0].tolist(), first
            )
            if kind
        }

    def _states(self, first: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return kind, parent, samples, oldest and latest stamp (N, 5), and latest poses (N, 7)."""
        states, poses = np.empty((count, 5), np.int64), np.empty((count, 7))
        self._library.onebot_buffer_states(
            self._buffer, first, count, states.ctypes.data, poses.ctypes.data
        )
        return states, poses

    def latest_poses(self) -> dict[str, NDArray[np.float64]]:
        """Return the latest pose (7,) of each frame in its parent: x y z in m, x y z w."""
        states, poses = self._states(0, len(self.frames))
        return {self.frames[number]: poses[number] for number in np.flatnonzero(states[:, 0])}

    def known_until(self, name: str, top: str) -> int:
        """Return the time, ns, up to which all transforms from a frame to ``top`` are known."""
        numbers = self.numbers.get(name, 0), self.numbers.get(top, 0)
        until: int = self._library.onebot_buffer_known_until(self._buffer, *numbers)
        return until

    def as_string(self) -> str:
        """Return a line for each frame with its parent."""
        lines = (
            f"Frame {name} exists with parent {state.parent}.\n"
            for name, state in self.states().items()
        )
        return "".join(lines)

    def _explain(self, failure: int, found: Found, target: str, source: str) -> TransformException:
        if failure == _LOOP:
            return LookupException(
                f"The tf tree is invalid because it contains a loop.\n{self.as_string()}\n"
            )
        if failure == _UNCONNECTED:
            return self.unconnected(target, source)
        time, edge = seconds_text(found.stamp_ns), seconds_text(found.edge_ns)
        problem = {
            _EMPTY: "",
            _ONE_TIME: f"Lookup would require extrapolation at time {time}, but only time {edge} "
            "is in the buffer",
            _TOO_LATE: "Lookup would require extrapolation into the future.  Requested time "
            f"{time} but the latest data is at time {edge}",
            _TOO_EARLY: "Lookup would require extrapolation into the past.  Requested time "
            f"{time} but the earliest data is at time {edge}",
        }[failure]
        return ExtrapolationException(
            f"{problem}, when looking up transform from frame [{source}] to frame [{target}]"
        )

    @staticmethod
    def unconnected(target: str, source: str) -> ConnectivityException:
        """Return the error for two frames in different trees."""
        return ConnectivityException(
            f"Could not find a connection between '{target}' and '{source}' because they are not "
            "part of the same tree.Tf has two or more unconnected trees."
        )
