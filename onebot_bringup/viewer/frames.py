"""The TF tree with the transforms of each frame, and the frame that a robot is shown in."""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import Description
from onebot_description.errors import did_you_mean, listing

Floats = NDArray[np.float64]
_MOST_BLOCKS = 512
_MOST_ROWS = 100_000  # of all blocks
_MOST_COMPARED = 500  # names
_HISTORY_NS, _MOST_KEPT = 10_000_000_000, 1000  # of messages, as long as tf2 keeps them
_FOR_EVER = np.iinfo(np.int64).max
_LATE_NS = 1_000_000_000  # that a message may be older than one before it


class Transforms(Protocol):
    """A TFMessage as arrays (``onebot_description.wire.messages.TfArrays`` is one)."""

    @property
    def parents(self) -> list[str]: ...  # noqa: D102
    @property
    def children(self) -> list[str]: ...  # noqa: D102
    @property
    def stamps_ns(self) -> NDArray[np.int64]: ...  # noqa: D102
    @property
    def translations(self) -> Floats: ...  # noqa: D102
    @property
    def rotations(self) -> Floats: ...  # noqa: D102


class Edge(NamedTuple):
    """The transform of a frame in its parent: (3,) metres and (4,) x y z w."""

    parent: str
    translation: Floats
    rotation: Floats


def _stamp_ns(message: Transforms) -> int:
    return int(message.stamps_ns[0])


class _Block:
    """Frames that came in one message, and are likely to come together again."""

    def __init__(self, parents: Iterable[str], children: Iterable[str]) -> None:
        self.parents, self.children = list(parents), list(children)
        self.whole = True  # the latest transform of each of them is here
        self.translations: Floats  # the latest
        self.rotations: Floats
        self.history: deque[Transforms] = deque(maxlen=_MOST_KEPT)

    def record(self, messages: Iterable[Transforms]) -> None:
        """Keep messages, in the order of their stamps."""
        history = self.history
        for message in messages:
            late_ns = history[-1].stamps_ns[0] - message.stamps_ns[0] if history else 0
            if late_ns > _LATE_NS:
                history.clear()  # the clock was set back
            history.append(message)
            if 0 < late_ns <= _LATE_NS:
                self.history = history = deque(sorted(history, key=_stamp_ns), _MOST_KEPT)
        while len(history) > 1 and history[-1].stamps_ns[0] - history[0].stamps_ns[0] > _HISTORY_NS:
            history.popleft()

    def at(self, row: int, time_ns: int) -> tuple[Floats, Floats]:
        """Return translation and rotation at a time, interpolated.

        Before the history they are its first, unless that is of another clock; after it the latest.

        Args:
            row: of the frame.
            time_ns: nanoseconds.
        """
        history = self.history
        stamps = [history[end].stamps_ns[row] for end in (0, -1)] if history else [0, 0]
        if not stamps[0] - _HISTORY_NS < time_ns < stamps[1]:
            return self.translations[row], self.rotations[row]
        number = bisect_right(history, time_ns, key=lambda each: each.stamps_ns[row])
        before, after = history[max(0, number - 1)], history[number]
        start, end = before.stamps_ns[row], after.stamps_ns[row]
        part = min(1.0, max(0.0, (time_ns - start) / max(1, end - start)))
        turn, next_turn = before.rotations[row], after.rotations[row]
        turn = turn + part * (np.copysign(1.0, turn @ next_turn) * next_turn - turn)
        shift = before.translations[row]
        shift = shift + part * (after.translations[row] - shift)
        return shift, turn / np.linalg.norm(turn)


class FrameTree:
    """Every frame received so far, by name."""

    def __init__(self) -> None:
        self.version = 0  # another number after every change of a frame's parent
        self._places: dict[str, tuple[_Block, int]] = {}
        # By the identity of the lists that were given, which are kept for that.
        self._blocks: dict[tuple[int, int], tuple[object, object, _Block]] = {}
        self._rows = 0  # of the blocks
        self._tops: dict[str, str] = {}
        self._names: frozenset[str] | None = None

    def update(
        self,
        parents: Iterable[str],
        children: Iterable[str],
        translations: Floats,
        rotations: Floats,
        history: Sequence[Transforms] = (),
    ) -> None:
        """Add transforms, one row each; a later row of the same child wins.

        If the very same lists of names come again, it takes no longer for many than for few.

        Args:
            parents: of each row.
            children: the frames.
            translations: (N, 3), metres.
            rotations: (N, 4), x y z w.
            history: messages of these names with their times, of which the last is this one; none
                if they are static.
        """
        known = self._blocks.get((id(parents), id(children)))
        block = known[2] if known is not None and known[2].whole else None
        if block is None:
            block = self._remember(parents, children)
            if known is not None:
                block.history = known[2].history
        block.translations, block.rotations = translations, rotations
        if history:
            block.record(history)
            latest = block.history[-1]  # which may have come before
            block.translations, block.rotations = latest.translations, latest.rotations

    def _remember(self, parents: Iterable[str], children: Iterable[str]) -> _Block:
        block = _Block(parents, children)
        for row, child in enumerate(block.children):
            before = self._places.get(child)
            if before is None or before[0].parents[before[1]] != block.parents[row]:
                self._changed()
            if before is not None and before[0] is not block:
                before[0].whole = False
            self._places[child] = (block, row)
        self._rows += len(block.children)
        if len(self._blocks) >= _MOST_BLOCKS or self._rows > _MOST_ROWS:
            self._blocks.clear()
            self._rows = len(block.children)
        self._blocks[id(parents), id(children)] = (parents, children, block)
        return block

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

    @property
    def names(self) -> frozenset[str]:
        """Every frame, children and parents alike."""
        if self._names is None:
            parents = (block.parents[row] for block, row in self._places.values())
            self._names = frozenset(self._places).union(parents)
        return self._names

    @property
    def edges(self) -> Mapping[str, Edge]:
        """The last transform of each child frame."""
        return {child: self._edge(child) for child in self._places}

    def _edge(self, child: str) -> Edge:
        block, row = self._places[child]
        return Edge(block.parents[row], block.translations[row], block.rotations[row])

    def top(self, frame: str) -> str:
        """Return the root of the tree that ``frame`` is in (itself if it has no parent).

        Each frame of a circle is a root.
        """
        way: dict[str, int] = {}  # frames in order, and their numbers
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

    def pose(self, frame: str, fixed: str, time_ns: int = 0) -> Floats | None:
        """Return the (4, 4) pose of ``frame`` in ``fixed``; None when they are not connected.

        Args:
            frame: whose.
            fixed: in which.
            time_ns: nanoseconds; 0 for the latest.
        """
        top = self.top(fixed)
        if self.top(frame) != top:
            return None
        if fixed == top:
            return self._from_top(frame, time_ns)
        ways = self._from_top(fixed, time_ns), self._from_top(frame, time_ns)
        pose: Floats = np.linalg.solve(*ways).astype(float)
        return pose

    def known_until(self, frame: str) -> int:
        """Return the time (ns) up to which all transforms above ``frame`` have come.

        Static ones are known for ever.
        """
        until, top = _FOR_EVER, self.top(frame)
        while frame != top:
            block, row = self._places[frame]
            if block.history:
                until = min(until, int(block.history[-1].stamps_ns[row]))
            frame = block.parents[row]
        return until

    def poses(self, frames: Iterable[str], fixed: str) -> dict[str, Floats]:
        """Return the (4, 4) poses in ``fixed`` of those ``frames`` that are connected to it."""
        found = {frame: self.pose(frame, fixed) for frame in frames}
        return {frame: pose for frame, pose in found.items() if pose is not None}

    def unknown(self, wanted: str, fixed_frame: str) -> str:
        """Return a warning that ``wanted`` has not been received, and what is shown instead."""
        # It takes long to look for similar ones among many, and their number is others' affair.
        few = len(self.names) <= _MOST_COMPARED
        known = did_you_mean(wanted, self.names, "frames received") if few else ""
        return (
            f'the fixed frame "{wanted}" is not on /tf or /tf_static{known}; '
            f'shown in "{fixed_frame}" until it is'
        )

    def _from_top(self, frame: str, time_ns: int) -> Floats:
        pose, top = np.eye(4), self.top(frame)
        while frame != top:
            block, row = self._places[frame]
            latest = block.translations[row], block.rotations[row]
            translation, rotation = block.at(row, time_ns) if time_ns else latest
            pose, frame = _matrix(translation, rotation) @ pose, block.parents[row]
        return pose


def _matrix(translation: Floats, rotation: Floats) -> Floats:
    """Return the (4, 4) matrix of one transform; a tenth of the time that arrays would take.

    A rotation of no length is none.
    """
    (x, y, z, w), (at_x, at_y, at_z) = np.asarray(rotation).tolist(), translation.tolist()
    length = math.hypot(x, y, z, w) or 1.0
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), at_x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), at_y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), at_z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


class FrameResolution:
    """In which frame a robot is shown, and which of its links have no transform to it."""

    def __init__(self, frames: FrameTree, frame_of: Callable[[str], str]) -> None:
        self._frames = frames
        self._frame_of = frame_of
        self._missing: list[str] = []
        self._missing_of: tuple[object, ...] = ()  # the arguments and tree that it is for

    def fixed_frame(self, robot: Description, wanted: str) -> str:
        """Return the frame to show ``robot`` in: ``wanted``, or else the one above its root."""
        return self.known_as(robot, wanted) or self._frames.top(self._frame_of(robot.root_link))

    def known_as(self, robot: Description, wanted: str) -> str:
        """Return the name by which a frame is known, also with the prefix; "" if it is not.

        Another robot's frame may have the name without the prefix: of both, the one that a
        transform connects with this robot counts, and the name as it is if both are.
        """
        if not wanted:
            return ""
        received, links = self._frames.names, robot.link_names
        prefixed = self._frame_of(wanted)
        known = [prefixed] if prefixed in received or wanted in links else []
        if wanted in received or wanted in map(self._frame_of, links):
            known.insert(0, wanted)
        top = self._frames.top(self._frame_of(robot.root_link))
        connected = [name for name in known if self._frames.top(name) == top]
        return next(iter(connected + known), "")

    def missing(self, robot: Description, fixed_frame: str) -> list[str]:
        """Return the frames of links that no transform connects with ``fixed_frame``."""
        what = (self._frames.version, robot, fixed_frame)
        if what != self._missing_of:
            top = self._frames.top(fixed_frame)
            frames = map(self._frame_of, robot.link_names)
            self._missing = [frame for frame in frames if self._frames.top(frame) != top]
            self._missing_of = what
        return self._missing

    def is_complete(self, robot: Description, wanted: str) -> bool:
        """Whether every link has a transform to the frame ``wanted``, which exists, if given."""
        as_wanted = not wanted or bool(self.known_as(robot, wanted))
        return as_wanted and not self.missing(robot, self.fixed_frame(robot, wanted))

    def warnings(self, robot: Description, wanted: str) -> list[str]:
        """Return the links without a transform, and a missing fixed frame, a sentence each."""
        found = []
        fixed_frame = self.fixed_frame(robot, wanted)
        missing = self.missing(robot, fixed_frame)
        if missing:
            found.append(
                f'no transform yet from "{fixed_frame}" to {listing(missing, 5)}: '
                "not shown until /tf or /tf_static brings it"
            )
        if wanted and not self.known_as(robot, wanted):
            found.append(self._frames.unknown(wanted, fixed_frame))
        return found
