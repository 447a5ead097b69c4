"""What moves: transforms, collected and logged many at a time.

One ``send_columns`` costs about as much for fifty messages as one ``rr.log`` for a single joint.
Times are those of the messages, on the timeline ``ros_time``.
"""

import time
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from onebot_description.model.quaternions import to_matrix

# The frames heard on /tf and /tf_static: who hangs on whom, and where, as last said.

Floats = NDArray[np.float64]
_MOST_BLOCKS = 64


class Edge(NamedTuple):
    """A frame's last known place in its parent: (3,) metres and (4,) x y z w."""

    parent: str
    translation: Floats
    rotation: Floats


class _Block:
    """Frames that were heard together, and are likely to be again.

    Attributes:
        whole: the last word on each of them is here.
    """

    def __init__(self, parents: Iterable[str], children: Iterable[str]) -> None:
        self.parents, self.children = list(parents), list(children)
        self.whole = True
        self.translations: Floats
        self.rotations: Floats


class FrameTree:
    """Every frame heard so far, by name.

    Attributes:
        version: another number after every change of what hangs on what.
    """

    def __init__(self) -> None:
        """Know no frame yet."""
        self.version = 0
        self._places: dict[str, tuple[_Block, int]] = {}
        # By the identity of the lists that were given, which are kept for that.
        self._blocks: dict[tuple[int, int], tuple[object, object, _Block]] = {}
        self._tops: dict[str, str] = {}
        self._names: frozenset[str] | None = None

    def update(
        self,
        parents: Iterable[str],
        children: Iterable[str],
        translations: Floats,
        rotations: Floats,
    ) -> None:
        """Take in transforms, one row each; a later row of the same child wins.

        If the very same lists of names come again, it takes no longer for many than for few.
        """
        known = self._blocks.get((id(parents), id(children)))
        block = known[2] if known is not None and known[2].whole else None
        if block is None:
            block = self._remember(parents, children)
        block.translations, block.rotations = translations, rotations

    def _remember(self, parents: Iterable[str], children: Iterable[str]) -> _Block:
        block = _Block(parents, children)
        for row, child in enumerate(block.children):
            before = self._places.get(child)
            if before is None or before[0].parents[before[1]] != block.parents[row]:
                self._changed()
            if before is not None and before[0] is not block:
                before[0].whole = False
            self._places[child] = (block, row)
        if len(self._blocks) >= _MOST_BLOCKS:
            self._blocks.clear()
        self._blocks[id(parents), id(children)] = (parents, children, block)
        return block

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are heard again."""
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
        """Return the frame above all that ``frame`` hangs on (itself if it hangs on none)."""
        way = []
        name = frame
        while (known := self._tops.get(name)) is None:
            way.append(name)
            place = self._places.get(name)
            if place is None:
                known = name
                break
            name = place[0].parents[place[1]]
            if len(way) > len(self._places):  # in a circle
                return self._chain(frame)[-1]
        self._tops.update(dict.fromkeys(way, known))
        return known

    def pose(self, frame: str, fixed: str) -> Floats | None:
        """Return the (4, 4) pose of ``frame`` in ``fixed``; None when they are not connected."""
        if self.top(frame) != self.top(fixed):
            return None
        pose: Floats = np.linalg.solve(self._from_top(fixed), self._from_top(frame)).astype(float)
        return pose

    def poses(self, frames: Iterable[str], fixed: str) -> dict[str, Floats]:
        """Return the (4, 4) poses in ``fixed`` of those ``frames`` that are connected to it."""
        found = {frame: self.pose(frame, fixed) for frame in frames}
        return {frame: pose for frame, pose in found.items() if pose is not None}

    def _chain(self, frame: str) -> list[str]:
        chain = [frame]
        seen = {frame}
        while (place := self._places.get(chain[-1])) is not None:
            parent = place[0].parents[place[1]]
            if parent in seen:
                break
            chain.append(parent)
            seen.add(parent)
        return chain

    def _from_top(self, frame: str) -> Floats:
        pose = np.eye(4)
        for child in self._chain(frame)[:-1]:
            edge = self._edge(child)
            step = np.eye(4)
            step[:3, :3] = to_matrix(np.asarray(edge.rotation))
            step[:3, 3] = edge.translation
            pose = step @ pose
        return pose


# Columns for ``send_columns``, made of arrays without the checks of Rerun's own makers.

_STAMPS = pa.timestamp("ns")


class ReadyColumn(rr.ComponentColumn):
    """A column whose Arrow array is made, and can be sent many times."""

    def __init__(self, descriptor: Any, array: pa.Array) -> None:
        """Keep an array of the kind that ``descriptor`` says, a list a row."""
        self._descriptor = descriptor
        self._array = array

    def component_descriptor(self) -> Any:
        """What the column is."""
        return self._descriptor

    def as_arrow_array(self) -> pa.Array:
        """A list a row."""
        return self._array


def ready(columns: rr.ComponentColumnList) -> Sequence[ReadyColumn]:
    """Return columns that need no more work when they are sent again."""
    return [ReadyColumn(item.component_descriptor(), item.as_arrow_array()) for item in columns]


class ColumnMaker:
    """Makes columns of numbers of one component."""

    def __init__(self, sample: rr.ComponentColumnList) -> None:
        """Take the kind of a column that Rerun has made, alone in its list."""
        [column] = ready(sample)
        self._descriptor = column.component_descriptor()
        self._rows = column.as_arrow_array().type
        item = self._rows.value_type
        self._vector = item if pa.types.is_fixed_size_list(item) else None
        self._number = item if self._vector is None else item.value_type
        self._width = 1 if self._vector is None else item.list_size
        self._dtype = np.dtype(self._number.to_pandas_dtype())

    def column(self, values: NDArray[Any], each: int = 1) -> ReadyColumn:
        """Return a column of numbers.

        Args:
            values: all numbers, row by row.
            each: components a row, of as many numbers as the component has.
        """
        if self._dtype == values.dtype:
            array = _array(self._number, values, self._dtype)
        else:
            with np.errstate(over="ignore"):  # too much for 32 bits: infinite
                array = _array(self._number, values, self._dtype)
        count = len(array) // self._width
        if self._vector is not None:
            array = pa.Array.from_buffers(self._vector, count, [None], children=[array])
        rows = count // each
        buffers = [None, _offsets(rows, each)]
        array = pa.Array.from_buffers(self._rows, rows, buffers, children=[array])
        return ReadyColumn(self._descriptor, array)


class StampColumn:
    """A column of times (``rr.TimeColumn`` is another)."""

    def __init__(self, timeline: str, stamps_ns: NDArray[np.int64]) -> None:
        """Keep nanoseconds since 1970."""
        self._timeline = timeline
        self._array = _array(_STAMPS, stamps_ns, np.dtype(np.int64))

    def timeline_name(self) -> str:
        """Of the timeline."""
        return self._timeline

    def as_arrow_array(self) -> pa.Array:
        """A time a row."""
        return self._array


def _array(kind: pa.DataType, values: NDArray[Any], dtype: np.dtype[Any]) -> pa.Array:
    # The memory is Arrow's own: Rerun's threads let go of Python's only with the interpreter's
    # lock, for which they and we would wait in turn.
    memory = pa.allocate_buffer(values.size * dtype.itemsize)
    np.frombuffer(memory, dtype).reshape(values.shape)[...] = values
    return pa.Array.from_buffers(kind, values.size, [None, memory])


@lru_cache(maxsize=64)
def _offsets(rows: int, each: int) -> pa.Buffer:
    """Where rows of so many components each begin."""
    return pa.array(np.arange(rows + 1, dtype=np.int32) * np.int32(each)).buffers()[1]


# Columns of the names of frames, made once for those that come again and again.

_MOST = 32  # columns kept for the next time

Names = tuple[list[str], list[str]]  # parents, children


class NameColumns:
    """Keeps columns for messages whose lists of names are the same objects as before."""

    def __init__(self) -> None:
        """Keep none yet."""
        self._made: dict[tuple[object, ...], tuple[object, Sequence[ReadyColumn]]] = {}

    def columns(
        self, lists: Sequence[Names], single: Sequence[tuple[str, str]]
    ) -> Sequence[ReadyColumn]:
        """Return the columns of messages, and of single frames below them.

        Args:
            lists: parents and children of each message; nobody may change them.
            single: parent and child of each single frame.
        """
        key = (*(id(names) for pair in lists for names in pair), *single)
        made = self._made.get(key)
        if made is None:
            parents = [name for names, _ in lists for name in names]
            children = [name for _, names in lists for name in names]
            columns = name_columns(
                [*parents, *(parent for parent, _ in single)],
                [*children, *(child for _, child in single)],
            )
            if len(self._made) >= _MOST:
                self._made.clear()
            # The lists are kept, or others could come to bear their identity.
            made = self._made[key] = (lists, columns)
        return made[1]


def name_columns(parents: list[str], children: list[str]) -> Sequence[ReadyColumn]:
    """Return columns that say for each row which frame it is, and in which."""
    return ready(rr.Transform3D.columns(parent_frame=parents, child_frame=children))


TIMELINE = "ros_time"
TF_ENTITY = "tf"
TF_STATIC_ENTITY = "tf_static"
# A server with a memory limit drops the oldest data. What is sent seldom is logged anew this often
# (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0


_TRANSLATIONS = ColumnMaker(rr.Transform3D.columns(translation=np.zeros((1, 3))))
_ROTATIONS = ColumnMaker(rr.Transform3D.columns(quaternion=np.zeros((1, 4))))


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


class _Place(NamedTuple):
    """Where a frame of ours is, and since when."""

    stamp_ns: int
    parent: str
    translation: Floats
    rotation: Floats


class TransformStream:
    """Logs /tf and /tf_static, and remembers the last of each in ``frames``."""

    def __init__(self, recording: rr.RecordingStream, frames: FrameTree) -> None:
        """Log into ``recording``, update ``frames``."""
        self._recording = recording
        self._frames = frames
        self._pending: list[Transforms] = []
        self._placed: dict[str, _Place] = {}
        self._static: dict[str, tuple[object, ...]] = {}
        self._names = NameColumns()
        # Lists of children, by identity, and when each was last heard; sorted into _logged later.
        self._heard: dict[int, tuple[Sequence[str], float]] = {}
        self._logged: dict[str, float] = {}  # child -> monotonic time of its last row
        self._latest_ns = 0
        self._next_repeat = 0.0

    def add(self, transforms: Transforms) -> None:
        """Take in a message of /tf; it is logged at the next ``flush``."""
        self._pending.append(transforms)

    def place(
        self, stamp_ns: int, parent: str, child: str, translation: Floats, rotation: Floats
    ) -> None:
        """Put a frame that is ours, not /tf's, somewhere; the last place goes with ``flush``.

        Args:
            stamp_ns: its time, nanoseconds.
            parent: the frame it is placed in.
            child: its name.
            translation: (3,) metres.
            rotation: (4,) quaternion x y z w.
        """
        self._placed[child] = _Place(stamp_ns, parent, translation, rotation)

    def add_static(self, transforms: Transforms) -> None:
        """Log a message of /tf_static: what changed in it, an entity a frame.

        Several static chunks on one entity would survive in a file only in part.
        """
        self._frames.update(*_columns(transforms))
        for row, child in enumerate(transforms.children):
            translation, rotation = transforms.translations[row], transforms.rotations[row]
            value = (transforms.parents[row], *translation.tolist(), *rotation.tolist())
            if self._static.get(child) == value:
                continue
            self._static[child] = value
            self._recording.log(
                rr.new_entity_path([TF_STATIC_ENTITY, child]),
                rr.Transform3D(
                    translation=translation,
                    quaternion=rr.Quaternion(xyzw=rotation),
                    parent_frame=transforms.parents[row],
                    child_frame=child,
                ),
                static=True,
            )

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are heard again."""
        frames = list(frames)
        self._frames.forget(frames)
        self._sort_heard()
        for frame in frames:
            self._static.pop(frame, None)
            self._logged.pop(frame, None)

    def flush(self, now_ns: int) -> bool:
        """Log what was collected in one call; ``now_ns`` stands in for a stamp of zero.

        Returns:
            True if there was anything.
        """
        batch = [item for item in self._pending if item.children]
        placed, self._placed, self._pending = self._placed, {}, []
        if not batch and not placed:
            return False
        ours = placed.values()
        stamps = _stack([item.stamps_ns for item in batch], [p.stamp_ns for p in ours])
        if not stamps.all():
            stamps = np.where(stamps == 0, now_ns, stamps)
        translations = _stack([i.translations for i in batch], [p.translation for p in ours])
        rotations = _stack([i.rotations for i in batch], [p.rotation for p in ours])
        names = self._names.columns(
            [(item.parents, item.children) for item in batch],
            [(place.parent, child) for child, place in placed.items()],
        )
        self._send(stamps, translations, rotations, names)
        if batch:
            self._remember(batch, int(stamps.max()))
        return True

    def _remember(self, batch: Sequence[Transforms], latest_ns: int) -> None:
        """Take what /tf said into ``frames``, and log anew what it has not said for a while."""
        now = time.monotonic()
        last: dict[int, Transforms] = {}  # of each list of frames, in the order they came
        for item in batch:
            last.pop(id(item.children), None)
            last[id(item.children)] = item
        for names, item in last.items():
            self._frames.update(*_columns(item))
            self._heard[names] = (item.children, now)
        self._latest_ns = latest_ns
        if now >= self._next_repeat:
            self._next_repeat = now + REPEAT_AFTER / 2
            self._repeat_slow(now)

    def _sort_heard(self) -> None:
        """Put down for each frame when it was last heard."""
        for children, when in sorted(self._heard.values(), key=lambda entry: entry[1]):
            self._logged.update(dict.fromkeys(children, when))
        self._heard.clear()

    def _repeat_slow(self, now: float) -> None:
        """Log anew the frames not heard for a while, at the time of the newest ones."""
        self._sort_heard()
        slow = [child for child, when in self._logged.items() if now - when > REPEAT_AFTER]
        if not slow:
            return
        edges = self._frames.edges
        names = name_columns([edges[child].parent for child in slow], slow)
        self._send(
            np.full(len(slow), self._latest_ns),
            np.array([edges[child].translation for child in slow]),
            np.array([edges[child].rotation for child in slow]),
            names,
        )
        self._logged.update(dict.fromkeys(slow, now))

    def _send(
        self,
        stamps_ns: NDArray[np.int64],
        translations: Floats,
        rotations: Floats,
        names: Sequence[ReadyColumn],
    ) -> None:
        numbers = [_TRANSLATIONS.column(translations), _ROTATIONS.column(rotations)]
        self._recording.send_columns(
            TF_ENTITY, indexes=[time_column(stamps_ns)], columns=[*numbers, *names]
        )


def _columns(transforms: Transforms) -> tuple[Sequence[str], Sequence[str], Floats, Floats]:
    return (
        transforms.parents,
        transforms.children,
        transforms.translations,
        transforms.rotations,
    )


def _stack(arrays: Sequence[NDArray[Any]], rows: Sequence[Any]) -> NDArray[Any]:
    """Put arrays, and then single rows, one below the other."""
    return np.concatenate([*arrays, np.array(rows)] if rows else list(arrays))


def time_column(stamps_ns: NDArray[np.int64]) -> StampColumn:
    """Return nanoseconds as times on our timeline."""
    return StampColumn(TIMELINE, stamps_ns)
