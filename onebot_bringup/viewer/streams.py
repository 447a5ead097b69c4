"""What moves: transforms and joint states, collected and logged many at a time.

One ``send_columns`` costs about as much for fifty messages as one ``rr.log`` for a single joint.
Times are those of the messages, on the timeline ``ros_time``.
"""

import colorsys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.frames import FrameTree

TIMELINE = "ros_time"
TF_ENTITY = "tf"
TF_STATIC_ENTITY = "tf_static"
POSITION_ENTITY = "joints/position"
VELOCITY_ENTITY = "joints/velocity"
# A server with a memory limit drops the oldest data. What is sent seldom is logged anew this often
# (seconds), so that it is never the oldest.
REPEAT_AFTER = 10.0
# Each set of joint names is plotted on its own; more sets than these are a publisher's mistake.
_MOST_JOINT_SETS = 32

Floats = NDArray[np.float64]


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


class TransformStream:
    """Logs /tf and /tf_static, and remembers the last of each in ``frames``."""

    def __init__(self, recording: rr.RecordingStream, frames: FrameTree) -> None:
        """Log into ``recording``, update ``frames``."""
        self._recording = recording
        self._frames = frames
        self._pending: list[Transforms] = []
        self._static: dict[str, tuple[object, ...]] = {}
        self._logged: dict[str, float] = {}  # child -> monotonic time of its last row
        self._latest_ns = 0
        self._next_repeat = 0.0

    def add(self, transforms: Transforms) -> None:
        """Take in a message of /tf; it is logged at the next ``flush``."""
        self._pending.append(transforms)

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
        for frame in frames:
            self._static.pop(frame, None)
            self._logged.pop(frame, None)

    def flush(self, now_ns: int) -> bool:
        """Log what was collected in one call; ``now_ns`` stands in for a stamp of zero.

        Returns:
            True if there was anything.
        """
        if not self._pending:
            return False
        batch, self._pending = self._pending, []
        parents = [name for item in batch for name in item.parents]
        children = [name for item in batch for name in item.children]
        if not children:
            return False
        stamps = np.concatenate([item.stamps_ns for item in batch])
        stamps = np.where(stamps == 0, now_ns, stamps)
        translations = np.concatenate([item.translations for item in batch])
        rotations = np.concatenate([item.rotations for item in batch])
        self._send(stamps, parents, children, translations, rotations)
        last = dict(zip(children, range(len(children)), strict=True))
        rows = list(last.values())
        names = [parents[row] for row in rows]
        self._frames.update(names, last, translations[rows], rotations[rows])
        now = time.monotonic()
        self._logged.update(dict.fromkeys(last, now))
        self._latest_ns = int(stamps.max())
        if now >= self._next_repeat:
            self._next_repeat = now + REPEAT_AFTER / 2
            self._repeat_slow(now)
        return True

    def _repeat_slow(self, now: float) -> None:
        """Log anew the frames not heard for a while, at the time of the newest ones."""
        edges = self._frames.edges
        slow = [child for child, when in self._logged.items() if now - when > REPEAT_AFTER]
        if not slow:
            return
        self._send(
            np.full(len(slow), self._latest_ns),
            [edges[child].parent for child in slow],
            slow,
            np.array([edges[child].translation for child in slow]),
            np.array([edges[child].rotation for child in slow]),
        )
        self._logged.update(dict.fromkeys(slow, now))

    def _send(
        self,
        stamps_ns: NDArray[np.int64],
        parents: list[str],
        children: list[str],
        translations: Floats,
        rotations: Floats,
    ) -> None:
        self._recording.send_columns(
            TF_ENTITY,
            indexes=[_time_column(stamps_ns)],
            columns=rr.Transform3D.columns(
                translation=translations,
                quaternion=rotations,
                parent_frame=parents,
                child_frame=children,
            ),
        )


class JointStream:
    """Logs joint positions and velocities as curves, named after the joints.

    Attributes:
        has_velocities: a velocity was ever heard.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        """Log into ``recording``."""
        self._recording = recording
        self._sets: dict[tuple[str, ...], int] = {}
        self._pending: dict[tuple[str, int], list[tuple[int, Floats]]] = {}
        self.has_velocities = False

    def add(
        self, stamp_ns: int, names: tuple[str, ...], positions: Floats, velocities: Floats
    ) -> None:
        """Take in a JointState; it is logged at the next ``flush``.

        Args:
            stamp_ns: its time, nanoseconds.
            names: N joint names.
            positions: (N,) radians or metres, or empty.
            velocities: (N,) radians or metres a second, or empty.
        """
        if not names:
            return
        number = self._number(names)
        if number is None:
            return
        self.has_velocities |= len(velocities) == len(names)
        for entity, values in ((POSITION_ENTITY, positions), (VELOCITY_ENTITY, velocities)):
            if len(values) == len(names):
                self._pending.setdefault((entity, number), []).append((stamp_ns, values))

    def flush(self) -> bool:
        """Log what was collected, one call for each curve family; True if there was anything."""
        batches, self._pending = self._pending, {}
        for (entity, number), rows in batches.items():
            width = len(rows[0][1])
            values = np.concatenate([row for _, row in rows])
            self._recording.send_columns(
                f"{entity}/{number}",
                indexes=[_time_column(np.array([stamp for stamp, _ in rows], np.int64))],
                columns=rr.Scalars.columns(scalars=values).partition([width] * len(rows)),
            )
        return bool(batches)

    def _number(self, names: tuple[str, ...]) -> int | None:
        """The entity of this set of names; a new one gets its legend first."""
        number = self._sets.get(names)
        if number is None and len(self._sets) < _MOST_JOINT_SETS:
            number = self._sets[names] = len(self._sets)
            legend = rr.SeriesLines(names=names, colors=list(_palette(len(names), number)))
            for entity in (POSITION_ENTITY, VELOCITY_ENTITY):
                self._recording.log(f"{entity}/{number}", legend, static=True)
        return number


def _palette(count: int, offset: int) -> Iterator[tuple[int, int, int]]:
    """Colours that are easily told apart on a dark ground (hues a golden angle apart)."""
    for index in range(count):
        hue = (0.58 + 0.381966 * (index + 3 * offset)) % 1.0
        red, green, blue = colorsys.hsv_to_rgb(hue, 0.6, 1.0)
        yield round(255 * red), round(255 * green), round(255 * blue)


def _columns(transforms: Transforms) -> tuple[Sequence[str], Sequence[str], Floats, Floats]:
    return (
        transforms.parents,
        transforms.children,
        transforms.translations,
        transforms.rotations,
    )


def _time_column(stamps_ns: NDArray[np.int64]) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, timestamp=stamps_ns.astype("datetime64[ns]"))
