"""The frames heard on /tf and /tf_static: who hangs on whom, and where, as last said."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model.quaternions import to_matrix

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
