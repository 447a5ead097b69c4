"""The TF tree: stores transforms over time, and computes the pose of any frame in another.

Rules and error messages are tf2's.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.geometry.matrices import of_transform
from onebot_description.geometry.poses import of_arrays
from onebot_description.geometry.quaternions import UNIT_TOLERANCE, slerp
from onebot_description.ros.wire.message_arrays import TfArrays
from onebot_description.timing import NS_PER_S

_MOST_ROWS = 100_000  # limit of rows in all blocks, since each new set of frames adds some
_HISTORY_NS, _HISTORY_ROWS = 10_000_000_000, 1_000_000  # ten seconds, as in tf2
_FOR_EVER = np.iinfo(np.int64).max
_LATE_NS = 1_000_000_000  # if a message is older than the latest by more, the clock was set back


class TransformError(OneBotError):
    """There is no transform between two frames (yet)."""


class Edge(NamedTuple):
    """The pose of a frame in its parent: translation (3,) in metres, rotation (4,) x y z w."""

    parent: str
    translation: Floats
    rotation: Floats


class StampedPose(NamedTuple):
    """The pose of a frame in another at a time."""

    stamp_ns: int  # 0 for a static one
    matrix: Floats  # (4, 4)


def _stamp_ns(message: TfArrays) -> int:
    return int(message.stamps_ns[0])


class _Block:
    """Frames that came in one message and are likely to come together again, with a history."""

    def __init__(self, message: TfArrays) -> None:
        self.parents, self.children = message.parents, message.children
        self.whole = False  # whether it has the latest transform of each of its frames
        self.latest = message
        # Empty for static transforms.
        self.history: deque[TfArrays] = deque(maxlen=_HISTORY_ROWS // max(1, len(self.children)))

    def record(self, message: TfArrays) -> None:
        """Insert a message into the history, which is ordered by stamps."""
        history = self.history
        late_ns = _stamp_ns(history[-1]) - _stamp_ns(message) if history else 0
        if late_ns > _LATE_NS:
            history.clear()  # the clock was set back
        history.append(message)
        if 0 < late_ns <= _LATE_NS:
            self.history = history = deque(sorted(history, key=_stamp_ns), history.maxlen)
        while _stamp_ns(history[-1]) - _stamp_ns(history[0]) > _HISTORY_NS:
            history.popleft()
        self.latest = history[-1]

    def edge(self, row: int) -> "Edge":
        """Return the latest transform of a frame."""
        latest = self.latest
        return Edge(self.parents[row], latest.translations[row], latest.rotations[row])

    def span(self, row: int) -> tuple[int, int]:
        """Return the first and the last stamp of a moving frame, nanoseconds."""
        return int(self.history[0].stamps_ns[row]), int(self.history[-1].stamps_ns[row])

    def at(self, row: int, time_ns: int) -> tuple[Floats, Floats]:
        """Return translation and rotation, interpolated at a time; for 0, the latest.

        A time before the history gets its first transform, or the latest if the time is so early
        that it seems to be of another clock; a time after the history gets the latest.
        """
        history = self.history
        first, last = self.span(row) if history else (0, 0)
        if time_ns == 0 or not first - _HISTORY_NS < time_ns < last:
            return self.latest.translations[row], self.latest.rotations[row]
        number = bisect_right(history, time_ns, key=lambda message: message.stamps_ns[row])
        earlier, later = history[max(0, number - 1)], history[number]
        start, end = earlier.stamps_ns[row], later.stamps_ns[row]
        part = min(1.0, max(0.0, (time_ns - start) / max(1, end - start)))
        shift = earlier.translations[row]
        shift = shift + part * (later.translations[row] - shift)
        return shift, slerp(earlier.rotations[row], later.rotations[row], part)


class FrameTree:
    """All frames received so far, by name."""

    def __init__(self) -> None:
        self.version = 0  # changes whenever a frame's parent changes
        self._places: dict[str, tuple[_Block, int]] = {}
        self._blocks: dict[tuple[tuple[str, ...], tuple[str, ...]], _Block] = {}
        self._rows = 0  # number of rows in all blocks
        self._tops: dict[str, str] = {}
        self._names: frozenset[str] | None = None

    # --- input ----------------------------------------------------------------------------------

    def add(self, message: TfArrays, *, static: bool) -> list[str]:
        """Add a message, with a separate history for each frame.

        Returns:
            One sentence per transform that is ignored.
        """
        ignored = []
        for row, (parent, child) in enumerate(zip(message.parents, message.children, strict=True)):
            rows = slice(row, row + 1)
            values = message.translations[rows], message.rotations[rows]
            problem = _problem(parent, child, *values)
            if problem:
                ignored.append(problem)
                continue
            single = TfArrays((parent,), (child,), message.stamps_ns[rows], *values)
            self.update(single, static=static)
        return ignored

    def update(self, message: TfArrays, *, static: bool = False) -> None:
        """Add a message whose transforms are valid; the last row of a child wins.

        Its history is that of the messages with the same names.
        """
        key = message.parents, message.children
        block = self._blocks.get(key)
        if block is None:
            self._rows += len(message.children)
            if self._rows > _MOST_ROWS:
                self._blocks.clear()
                self._rows = len(message.children)
            block = self._blocks[key] = _Block(message)
        if not block.whole:
            self._place(block)
        if static:
            block.history.clear()
            block.latest = message
        else:
            block.record(message)

    def _place(self, block: _Block) -> None:
        """Make a block the current one of its frames."""
        block.whole = True
        for row, child in enumerate(block.children):
            place = self._places.get(child)
            if place is None or place[0].parents[place[1]] != block.parents[row]:
                self._changed()
            if place is not None and place[0] is not block:
                place[0].whole = False
            self._places[child] = (block, row)

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are received again."""
        for frame in frames:
            place = self._places.pop(frame, None)
            if place is not None:
                place[0].whole = False
                self._changed()

    def _changed(self) -> None:
        self.version += 1
        self._tops.clear()
        self._names = None

    # --- the tree -------------------------------------------------------------------------------

    @property
    def names(self) -> frozenset[str]:
        """All frames, both children and parents."""
        if self._names is None:
            parents = (block.parents[row] for block, row in self._places.values())
            self._names = frozenset(self._places).union(parents)
        return self._names

    @property
    def edges(self) -> Mapping[str, Edge]:
        """The latest transform of each child frame."""
        return {child: block.edge(row) for child, (block, row) in self._places.items()}

    @property
    def roots(self) -> list[str]:
        """The frames without a parent, and the first one of each cycle; sorted."""
        return sorted({min(self.above(top)) for top in map(self.top, self.names)})

    def above(self, frame: str) -> list[str]:
        """Return ``frame`` and all frames above it, up to the root or once around a cycle."""
        way: dict[str, None] = {}
        while frame not in way:
            way[frame] = None
            place = self._places.get(frame)
            if place is not None:
                frame = place[0].parents[place[1]]
        return list(way)

    def top(self, frame: str) -> str:
        """Return the root of the tree that ``frame`` is in (itself if it has no parent).

        Each frame of a cycle counts as a root.
        """
        way: dict[str, int] = {}  # index of each frame on the way up
        name = frame
        while name not in self._tops:
            if name in way:
                circle = list(way)[way[name] :]
                self._tops.update(zip(circle, circle, strict=True))
                break
            way[name] = len(way)
            place = self._places.get(name)
            if place is None:
                self._tops[name] = name
            else:
                name = place[0].parents[place[1]]
        top = self._tops[name]
        for below in way:
            self._tops.setdefault(below, top)
        return self._tops[frame]

    # --- poses ----------------------------------------------------------------------------------

    def pose(self, frame: str, fixed: str, time_ns: int = 0) -> Floats | None:
        """Return the (4, 4) pose of ``frame`` in ``fixed``; None if they are not connected.

        Args:
            frame: a frame.
            fixed: the frame to express the pose in.
            time_ns: the time, nanoseconds; 0 for the latest.
        """
        top = self.top(fixed)
        if self.top(frame) != top:
            return None
        if fixed == top:
            return self._from_top(frame, time_ns)
        ways = self._from_top(fixed, time_ns), self._from_top(frame, time_ns)
        pose: Floats = np.linalg.solve(*ways).astype(float)
        return pose

    def poses(self, frames: Iterable[str], fixed: str) -> dict[str, Floats]:
        """Return the latest poses (4, 4) in ``fixed`` of all ``frames`` connected to it."""
        poses = {frame: self.pose(frame, fixed) for frame in frames}
        return {frame: pose for frame, pose in poses.items() if pose is not None}

    def known_until(self, frame: str) -> int:
        """Return the time (ns) up to which all transforms above ``frame`` are known.

        Static transforms are always known.
        """
        until, top = _FOR_EVER, self.top(frame)
        while frame != top:
            block, row = self._places[frame]
            if block.history:
                until = min(until, block.span(row)[1])
            frame = block.parents[row]
        return until

    def _from_top(self, frame: str, time_ns: int) -> Floats:
        pose, top = np.eye(4), self.top(frame)
        while frame != top:
            block, row = self._places[frame]
            pose = of_transform(of_arrays(*block.at(row, time_ns))) @ pose
            frame = block.parents[row]
        return pose

    def span(self, frame: str) -> tuple[int, int] | None:
        """Return the first and the last stamp (ns) of a moving frame; None if static."""
        block, row = self._places.get(frame, (None, 0))
        return block.span(row) if block is not None and block.history else None

    def lookup(self, target: str, source: str) -> StampedPose:
        """Return the pose of ``source`` in ``target`` at the latest common time.

        Raises:
            TransformError: a frame does not exist, they are not connected, or there is no common
                time.
        """
        for name, role in ((target, "target_frame"), (source, "source_frame")):
            if name not in self.names:
                raise TransformError(
                    f'Invalid frame ID "{name}" passed to lookupTransform argument {role} - '
                    f"frame does not exist{did_you_mean(name, self.names, 'frames')}"
                )
        if self.top(target) != self.top(source):
            raise TransformError(
                f"Could not find a connection between '{target}' and '{source}' because they are "
                "not part of the same tree. Tf has two or more unconnected trees."
            )
        between = {*self.above(target)} ^ {*self.above(source)}  # below their common ancestor
        spans = [span for child in between if (span := self.span(child)) is not None]
        time_ns = min((newest for _, newest in spans), default=0)
        oldest = max((oldest for oldest, _ in spans), default=0)
        if oldest > time_ns:
            raise TransformError(
                f"Lookup would require extrapolation into the past.  Requested time "
                f"{time_ns / NS_PER_S:.6f} but the earliest data is at time "
                f"{oldest / NS_PER_S:.6f}, "
                f"when looking up transform from frame [{source}] to frame [{target}]"
            )
        pose = self.pose(source, target, time_ns)
        assert pose is not None
        return StampedPose(time_ns, pose)


def _problem(parent: str, child: str, translation: Floats, rotation: Floats) -> str:
    """Return why tf2 ignores a transform, (1, 3) and (1, 4); "" if it does not."""
    if not child or not parent:
        return f'a transform from "{parent}" to "{child}" is ignored: a frame_id is not set'
    if child == parent:
        return f'a transform is ignored: frame_id and child_frame_id are both "{child}"'
    length = float(np.sum(rotation**2))
    if not np.isfinite(translation).all() or not abs(length - 1.0) <= UNIT_TOLERANCE:
        return (
            f'a transform of "{child}" is ignored: it has a nan or inf, or its quaternion is not '
            "normalized"
        )
    return ""
