"""Transforms over time, and lookups between any two frames at one moment, as tf2's buffer does.

Its errors are in tf2's words. The viewer's ``FrameTree`` is for drawing: it has the latest
transform of each frame only, whatever their times.
"""

import math
from bisect import bisect_right
from collections import deque
from itertools import islice
from typing import NamedTuple

from onebot_control.poses import Quaternion, Transform, compose, inverse
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.wire.messages import TfArrays

_KEPT = 10_000_000_000  # ns, as tf2 keeps transforms
_UNIT = 0.01  # that the square of a quaternion's length may be off, as in tf2
_IDENTITY: Transform = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_NANO = 1e-9


class TransformError(OneBotError):
    """There is no transform between two frames (yet)."""


class StampedTransform(NamedTuple):
    """A transform at a time."""

    stamp_ns: int  # 0 for a static one
    transform: Transform


class History:
    """The transforms of one frame in its parent, of the last ten seconds."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent, self.static = parent, static
        self._stamps: deque[int] = deque()
        self._transforms: deque[Transform] = deque()

    def add(self, stamp_ns: int, transform: Transform) -> None:
        """Add a transform; time that jumps back by over ten seconds begins anew."""
        stamps, transforms = self._stamps, self._transforms
        if self.static or (stamps and stamp_ns < stamps[-1] - _KEPT):
            stamps.clear()
            transforms.clear()
        place = bisect_right(stamps, stamp_ns)
        stamps.insert(place, stamp_ns)
        transforms.insert(place, transform)
        while stamps[0] < stamps[-1] - _KEPT:
            stamps.popleft()
            transforms.popleft()

    @property
    def newest_ns(self) -> int:
        """The stamp of the newest transform."""
        return self._stamps[-1]

    @property
    def oldest_ns(self) -> int:
        """The stamp of the oldest transform that is kept."""
        return self._stamps[0]

    def at(self, stamp_ns: int) -> Transform:
        """Return the transform at a time between the oldest and the newest, interpolated."""
        if self.static:
            return self._transforms[0]
        after = bisect_right(self._stamps, stamp_ns)
        if after == len(self._stamps):
            return self._transforms[-1]
        (start, first), (end, second) = islice(
            zip(self._stamps, self._transforms, strict=True), after - 1, after + 1
        )
        return _between(first, second, (stamp_ns - start) / (end - start))


class TransformBuffer:
    """What /tf and /tf_static have brought.

    Attributes:
        frames: the history of each child frame, by its name.
    """

    def __init__(self) -> None:
        self.frames: dict[str, History] = {}

    def add(self, transforms: TfArrays, *, static: bool) -> list[str]:
        """Add a message; return why some of its transforms are ignored, a sentence each."""
        ignored = []
        rows = zip(
            transforms.parents,
            transforms.children,
            transforms.stamps_ns.tolist(),
            transforms.translations.tolist(),
            transforms.rotations.tolist(),
            strict=True,
        )
        for parent, child, stamp_ns, translation, rotation in rows:
            parent, child = parent.removeprefix("/"), child.removeprefix("/")
            problem = _problem(parent, child, translation, rotation)
            if problem:
                ignored.append(problem)
                continue
            history = self.frames.get(child)
            if history is None or (history.parent, history.static) != (parent, static):
                history = self.frames[child] = History(parent, static)
            history.add(stamp_ns, (tuple(translation), tuple(rotation)))
        return ignored

    @property
    def names(self) -> set[str]:
        """Every frame, children and parents alike."""
        return {*self.frames, *(history.parent for history in self.frames.values())}

    @property
    def roots(self) -> list[str]:
        """The frames without a parent, and the first one of each loop; sorted."""
        return sorted({self._top(name) for name in self.names})

    def _top(self, frame: str) -> str:
        way = self.above(frame)
        loop = self.frames.get(way[-1])
        return way[-1] if loop is None else min(way[way.index(loop.parent) :])

    def children(self, frame: str) -> list[str]:
        """Return the frames right below one, sorted."""
        return sorted(name for name, history in self.frames.items() if history.parent == frame)

    def chain(self, target: str, source: str) -> list[str]:
        """Return the frames from one to the other, through their common ancestor.

        Raises:
            TransformError: a frame does not exist, or they are not connected.
        """
        for name, role in ((target, "target_frame"), (source, "source_frame")):
            self._check(name, role)
        up, down = self.above(target), self.above(source)
        shared = set(down)
        common = next((name for name in up if name in shared), None)
        if common is None:
            raise TransformError(
                f"Could not find a connection between '{target}' and '{source}' because they are "
                "not part of the same tree. Tf has two or more unconnected trees."
            )
        return [*up[: up.index(common) + 1], *reversed(down[: down.index(common)])]

    def lookup(self, target: str, source: str, at_ns: int | None = None) -> StampedTransform:
        """Return the pose of ``source`` in ``target``.

        Args:
            target: a frame.
            source: another one.
            at_ns: when; None for the latest time that all have in common.

        Raises:
            TransformError: a frame does not exist, they are not connected, or not at that time.
        """
        chain = self.chain(target, source)
        edges = [self._edge(*pair) for pair in zip(chain, chain[1:], strict=False)]
        moving = [history for history, _ in edges if not history.static]
        newest = min((history.newest_ns for history in moving), default=at_ns or 0)
        oldest = max((history.oldest_ns for history in moving), default=0)
        time = newest if at_ns is None else at_ns
        if not oldest <= time <= newest:
            way, end, limit = ("past", "earliest", oldest)
            if time > newest:
                way, end, limit = ("future", "latest", newest)
            raise TransformError(
                f"Lookup would require extrapolation into the {way}.  Requested time "
                f"{time * _NANO:.6f} but the {end} data is at time {limit * _NANO:.6f}, when "
                f"looking up transform from frame [{source}] to frame [{target}]"
            )
        found = _IDENTITY
        for history, downwards in edges:
            step = history.at(time)
            found = compose(found, step if downwards else inverse(step))
        return StampedTransform(time, found)

    def _edge(self, frame: str, other: str) -> tuple[History, bool]:
        """The transforms between neighbours, and whether ``other`` is the child."""
        history = self.frames.get(other)
        if history is not None and history.parent == frame:
            return history, True
        return self.frames[frame], False

    def _check(self, name: str, role: str) -> None:
        names = self.names
        if name not in names:
            raise TransformError(
                f'Invalid frame ID "{name}" passed to lookupTransform argument {role} - '
                f"frame does not exist{did_you_mean(name, names, 'frames')}"
            )

    def above(self, frame: str) -> list[str]:
        """Return ``frame`` and those above it, to the root or once around a loop."""
        way: dict[str, None] = {}
        name = frame
        while name not in way:
            way[name] = None
            if name in self.frames:
                name = self.frames[name].parent
        return list(way)


def _problem(parent: str, child: str, translation: list[float], rotation: list[float]) -> str:
    """Why tf2 ignores a transform; "" if it does not."""
    if not child or not parent:
        return f'a transform from "{parent}" to "{child}" is ignored: a frame_id is not set'
    if child == parent:
        return f'a transform is ignored: frame_id and child_frame_id are both "{child}"'
    length = sum(number * number for number in rotation)
    if not all(map(math.isfinite, translation)) or not abs(length - 1.0) <= _UNIT:
        return (
            f'a transform of "{child}" is ignored: it has a nan or inf, or its quaternion is not '
            "normalized"
        )
    return ""


def _between(first: Transform, second: Transform, part: float) -> Transform:
    """The transform ``part`` of the way from the first to the second."""
    x, y, z = (a + (b - a) * part for a, b in zip(first[0], second[0], strict=True))
    return (x, y, z), _slerp(first[1], second[1], part)


def _slerp(first: Quaternion, second: Quaternion, part: float) -> Quaternion:
    """Spherical interpolation along the shorter arc."""
    product = sum(a * b for a, b in zip(first, second, strict=True))
    angle = math.acos(min(1.0, abs(product)))
    if angle < 1e-9:
        return first
    left = math.sin((1.0 - part) * angle) / math.sin(angle)
    right = math.copysign(math.sin(part * angle) / math.sin(angle), product)
    x, y, z, w = (left * a + right * b for a, b in zip(first, second, strict=True))
    return x, y, z, w
