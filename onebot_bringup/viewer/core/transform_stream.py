"""Logs the transforms of TF in batches, so that entities move with their frames."""

import time
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import chain, compress

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import (
    ColumnMaker,
    ReadyColumn,
    entity_path,
    ready,
    send,
)
from onebot_bringup.viewer.core.inbox import OTHER_CLOCK_NS, MessageType
from onebot_bringup.viewer.core.rerun_limits import LARGEST, is_old
from onebot_description.arrays import Floats
from onebot_description.geometry.quaternions import UNIT_TOLERANCE
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.wire.message_arrays import TfArrays, tf_arrays

TF_ENTITY = "tf"
TF_STATIC_ENTITY = "tf_static"


def _stamp_ns(message: TfArrays) -> int:
    return int(message.stamps_ns[-1]) if len(message.stamps_ns) else 0


TF: MessageType[TfArrays] = MessageType("tf2_msgs/msg/TFMessage", tf_arrays, _stamp_ns)

_TRANSLATIONS = ColumnMaker(rr.Transform3D.columns(translation=np.zeros((1, 3))))
_ROTATIONS = ColumnMaker(rr.Transform3D.columns(quaternion=np.zeros((1, 4))))


def _usable(translations: Floats, rotations: Floats) -> NDArray[np.bool_]:
    """Return a mask of the rows that are valid: finite, with a quaternion of unit length."""
    with np.errstate(all="ignore"):
        lengths, distances = (np.einsum("ij,ij->i", a, a) for a in (rotations, translations))
        # Both are squared lengths.
        usable: NDArray[np.bool_] = np.abs(lengths - 1.0) <= UNIT_TOLERANCE
        usable &= distances <= LARGEST**2
        return usable


@lru_cache(maxsize=32)
def _name_columns(parents: tuple[str, ...], children: tuple[str, ...]) -> Sequence[ReadyColumn]:
    """Return columns with the frame of each row, and its parent."""
    return ready(rr.Transform3D.columns(parent_frame=parents, child_frame=children))


class TransformStream:
    """Logs transforms in batches, and stores the latest of each frame in ``frames``."""

    def __init__(self, recording: rr.RecordingStream, frames: FrameTree) -> None:
        self.recording = recording
        self._frames = frames
        self._pending: list[tuple[int, TfArrays]] = []
        self._static: dict[str, tuple[object, ...]] = {}
        self._logged: dict[str, float] = {}  # monotonic time of each child's last row
        self._repeated_at = 0.0
        self.ignored = ""  # the first frame with an invalid transform

    def add(self, stamp_ns: int, transforms: TfArrays) -> None:
        """Add a message of /tf; it is logged at the next ``flush``.

        Args:
            stamp_ns: its time, nanoseconds; replaces stamps that are zero, or more than 10 s later.
            transforms: the message.
        """
        if transforms.children:
            self._pending.append((stamp_ns, transforms))

    def add_static(self, transforms: TfArrays) -> None:
        """Log the changed transforms of a message of /tf_static, on one entity per frame.

        If several static chunks shared an entity, a file would keep only some of them.
        """
        transforms = self._only_usable(transforms)
        self._frames.update(transforms, static=True)
        for row, child in enumerate(transforms.children):
            translation, rotation = transforms.translations[row], transforms.rotations[row]
            value = (transforms.parents[row], *translation.tolist(), *rotation.tolist())
            if self._static.get(child) == value:
                continue
            self._static[child] = value
            self.recording.log(
                entity_path(TF_STATIC_ENTITY, child),
                rr.Transform3D(
                    translation=translation,
                    quaternion=rr.Quaternion(xyzw=rotation),
                    parent_frame=transforms.parents[row],
                    child_frame=child,
                ),
                static=True,
            )

    def _only_usable(self, transforms: TfArrays) -> TfArrays:
        """Return the valid transforms; tf2 ignores the others, too."""
        usable = _usable(transforms.translations, transforms.rotations)
        if usable.all():
            return transforms
        bad = int(np.argmin(usable))
        self.ignored = self.ignored or transforms.children[bad]
        return TfArrays(
            tuple(compress(transforms.parents, usable)),
            tuple(compress(transforms.children, usable)),
            transforms.stamps_ns[usable],
            transforms.translations[usable],
            transforms.rotations[usable],
        )

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are received again."""
        frames = list(frames)
        self._frames.forget(frames)
        for frame in frames:
            self._static.pop(frame, None)
            self._logged.pop(frame, None)

    def flush(self) -> bool:
        """Log the collected transforms in one call; return whether there were any."""
        pending, self._pending = self._pending, []
        if not pending:
            return False
        batch = [item for _, item in pending]
        stamps = np.concatenate([item.stamps_ns for item in batch])
        translations = np.concatenate([item.translations for item in batch])
        rotations = np.concatenate([item.rotations for item in batch])
        if not _usable(translations, rotations).all():
            for stamp_ns, item in pending:
                self.add(stamp_ns, self._only_usable(item))
            return self.flush()
        latest = max(stamp_ns for stamp_ns, _ in pending) + OTHER_CLOCK_NS
        if not stamps.all() or stamps.max() > latest:
            sent = np.repeat([when for when, _ in pending], [len(item.children) for item in batch])
            stamps = np.where((stamps == 0) | (stamps > sent + OTHER_CLOCK_NS), sent, stamps)
        parents = tuple(chain.from_iterable(item.parents for item in batch))
        children = tuple(chain.from_iterable(item.children for item in batch))
        self._send(stamps, translations, rotations, parents, children)
        self._remember(batch, int(stamps.max()))
        return True

    def _remember(self, batch: Sequence[TfArrays], latest_ns: int) -> None:
        """Update ``frames``, and log frames again that were not received for a while."""
        now = time.monotonic()
        for item in batch:
            self._frames.update(item)
        for children in {item.children for item in batch}:
            self._logged.update(dict.fromkeys(children, now))
        if is_old(self._repeated_at):
            self._repeated_at = now
            self._repeat_slow(now, latest_ns)

    def _repeat_slow(self, now: float, stamp_ns: int) -> None:
        """Log frames again that were not received for a while, at the time of the newest."""
        slow = tuple(child for child, when in self._logged.items() if is_old(when))
        if not slow:
            return
        edges = [self._frames.edges[child] for child in slow]
        self._send(
            np.full(len(slow), stamp_ns),
            np.array([edge.translation for edge in edges]),
            np.array([edge.rotation for edge in edges]),
            tuple(edge.parent for edge in edges),
            slow,
        )
        self._logged.update(dict.fromkeys(slow, now))

    def _send(
        self,
        stamps_ns: NDArray[np.int64],
        translations: Floats,
        rotations: Floats,
        parents: tuple[str, ...],
        children: tuple[str, ...],
    ) -> None:
        numbers = [_TRANSLATIONS.column(translations), _ROTATIONS.column(rotations)]
        columns = [*numbers, *_name_columns(parents, children)]
        send(self.recording, TF_ENTITY, stamps_ns, columns)
