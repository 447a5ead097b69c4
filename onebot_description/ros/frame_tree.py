"""The TF tree of our nodes: the latest transforms, and the pose of any frame in another.

It is the buffer of tf2 (``TransformBuffer``) with other rules, for live views: if the clock is set
back or the parent changes, a frame's history restarts, and a pose at a time beyond the history is
the nearest known one.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.errors import did_you_mean
from onebot_description.geometry.quaternions import UNIT_TOLERANCE
from onebot_description.ros.transform_buffer import (
    CACHE_NS,
    ROW,
    Found,
    LookupException,
    TransformBuffer,
)
from onebot_description.ros.wire.message_arrays import TfArrays

_MAX_ROWS = 100_000  # limit of known rows, since each new set of frames adds some
_MAX_TRANSFORMS = 1_000_000
_LATE_NS = 1_000_000_000  # a transform older than the latest by more means the clock was set back


class Edge(NamedTuple):
    """The pose of a frame in its parent: translation (3,) in meters, rotation (4,) x y z w."""

    parent: str
    translation: Floats
    rotation: Floats


class _Rows:
    """Reusable rows for messages with the same frames, since most messages repeat their frames."""

    def __init__(self, buffer: TransformBuffer, message: TfArrays) -> None:
        self._rows = rows = np.zeros(len(message.children), ROW)
        rows["parent"] = [buffer.number(name) for name in message.parents]
        rows["child"] = [buffer.number(name) for name in message.children]
        self.stamps_ns, pose = rows["stamp_ns"], rows["pose"]
        self.translations, self.rotations = pose[:, :3], pose[:, 3:]
        self.address, self.count = rows.ctypes.data, len(rows)


class FrameTree:
    """All frames received so far, by name."""

    def __init__(self) -> None:
        self.version = 0  # changes whenever a frame's parent changes
        self._buffer = TransformBuffer(CACHE_NS, live_ns=_LATE_NS, most=_MAX_TRANSFORMS)
        self._known: dict[tuple[tuple[str, ...], tuple[str, ...]], _Rows] = {}
        self._count = 0  # number of known rows
        self._parents: dict[str, str] | None = None
        self._tops: dict[str, str] = {}
        self._names: frozenset[str] | None = None

    # --- input ----------------------------------------------------------------------------------

    def add(self, message: TfArrays, *, static: bool) -> list[str]:
        """Add the valid transforms of a message.

        Returns:
            One sentence per ignored transform.
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
        """Add a message whose transforms are valid; the last row of a child wins."""
        rows = self._known.get((message.parents, message.children))
        if rows is None:
            self._count += len(message.children)
            if self._count > _MAX_ROWS:
                self._known.clear()
                self._count = len(message.children)
            rows = _Rows(self._buffer, message)
            self._known[message.parents, message.children] = rows
        rows.stamps_ns[:] = message.stamps_ns
        rows.translations[:] = message.translations
        rows.rotations[:] = message.rotations
        if self._buffer.add_rows(rows.address, rows.count, static) >> 32:
            self._changed()

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are received again."""
        for frame in frames:
            if frame in self._parent_of:
                self._buffer.drop(frame)
                self._changed()

    def _changed(self) -> None:
        self.version += 1
        self._tops.clear()
        self._parents = self._names = None

    # --- the tree -------------------------------------------------------------------------------

    @property
    def _parent_of(self) -> Mapping[str, str]:
        """The parent of each child frame."""
        if self._parents is None:
            states = self._buffer.states()
            self._parents = {name: state.parent for name, state in states.items()}
        return self._parents

    @property
    def names(self) -> frozenset[str]:
        """All frames, both children and parents."""
        if self._names is None:
            self._names = frozenset(self._parent_of).union(self._parent_of.values())
        return self._names

    @property
    def edges(self) -> Mapping[str, Edge]:
        """The latest transform of each child frame."""
        poses = self._buffer.latest_poses()
        return {
            child: Edge(parent, poses[child][:3], poses[child][3:])
            for child, parent in self._parent_of.items()
        }

    @property
    def roots(self) -> list[str]:
        """The frames without a parent, and the first frame of each cycle; sorted."""
        return sorted({min(self.above(top)) for top in map(self.top, self.names)})

    def above(self, frame: str) -> list[str]:
        """Return ``frame`` and all frames above it, up to the root or once around a cycle."""
        path: dict[str, None] = {}
        while frame not in path:
            path[frame] = None
            frame = self._parent_of.get(frame, frame)
        return list(path)

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
            parent = self._parent_of.get(name)
            if parent is None:
                self._tops[name] = name
            else:
                name = parent
        top = self._tops[name]
        for below in way:
            self._tops.setdefault(below, top)
        return self._tops[frame]

    # --- poses ----------------------------------------------------------------------------------

    def pose(self, frame: str, fixed: str, time_ns: int = 0) -> Floats | None:
        """Return the (4, 4) pose of ``frame`` in ``fixed``; None if they are not connected.

        It is interpolated at the time. Before a frame's history, its first transform is used, or
        the latest if the time is so early that it seems to come from another clock; after the
        history, the latest is used.

        Args:
            frame: a frame.
            fixed: the frame to express the pose in.
            time_ns: the time, nanoseconds; 0 for the latest.
        """
        top = self.top(fixed)
        if self.top(frame) != top:
            return None
        if frame == fixed:
            return np.eye(4)
        return self._buffer.find(fixed, frame, time_ns, top).matrix

    def poses(self, frames: Iterable[str], fixed: str) -> dict[str, Floats]:
        """Return the latest poses (4, 4) in ``fixed`` of all ``frames`` connected to it."""
        poses = {frame: self.pose(frame, fixed) for frame in frames}
        return {frame: pose for frame, pose in poses.items() if pose is not None}

    def known_until(self, frame: str) -> int:
        """Return the time (ns) up to which all transforms above ``frame`` are known.

        Static transforms are always known.
        """
        return self._buffer.known_until(frame, self.top(frame))

    def span(self, frame: str) -> tuple[int, int] | None:
        """Return the first and the last stamp (ns) of a moving frame; None if static."""
        state = self._buffer.state(frame)
        return (state.oldest_ns, state.latest_ns) if state and not state.is_static else None

    def lookup(self, target: str, source: str) -> Found:
        """Return the pose of ``source`` in ``target`` at the latest common time, 0 if static.

        Raises:
            TransformException: a frame does not exist, they are not connected, or there is no
                common time.
        """
        for name, role in ((target, "target_frame"), (source, "source_frame")):
            if name not in self.names:
                raise LookupException(
                    f'Invalid frame ID "{name}" passed to lookupTransform argument {role} - '
                    f"frame does not exist{did_you_mean(name, self.names, 'frames')}"
                )
        if self.top(target) != self.top(source):
            raise self._buffer.unconnected(target, source)
        return self._buffer.find(target, source, 0)


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
