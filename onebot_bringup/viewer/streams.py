"""What moves: transforms, collected and logged many at a time.

One ``send_columns`` costs about as much for fifty messages as one ``rr.log`` for a single joint.
Times are those of the messages, on the timeline ``ros_time``.
"""

import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import ColumnMaker, ReadyColumn, StampColumn
from onebot_bringup.viewer.frame_names import NameColumns, name_columns
from onebot_bringup.viewer.frames import FrameTree

TIMELINE = "ros_time"
TF_ENTITY = "tf"
TF_STATIC_ENTITY = "tf_static"
# A server with a memory limit drops the oldest data. What is sent seldom is logged anew this often
# (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0

Floats = NDArray[np.float64]

_TRANSLATIONS = ColumnMaker(rr.Transform3D.columns(translation=np.zeros((1, 3))))
_ROTATIONS = ColumnMaker(rr.Transform3D.columns(quaternion=np.zeros((1, 4))))


class Transforms(Protocol):
    """A TFMessage as arrays (``onebot_description.tf.wire.TfArrays`` is one)."""

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
