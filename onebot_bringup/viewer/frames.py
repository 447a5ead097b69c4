"""The frames heard on /tf and /tf_static: who hangs on whom, and where, as last said."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_description.model.quaternions import to_matrix

Floats = NDArray[np.float64]


class Edge(NamedTuple):
    """A frame's last known place in its parent: (3,) metres and (4,) x y z w."""

    parent: str
    translation: Floats
    rotation: Floats


class FrameTree:
    """Every frame heard so far, by name."""

    def __init__(self) -> None:
        """Know no frame yet."""
        self._edges: dict[str, Edge] = {}

    def update(
        self,
        parents: Iterable[str],
        children: Iterable[str],
        translations: Floats,
        rotations: Floats,
    ) -> None:
        """Take in transforms, one row each; a later row of the same child wins."""
        for row, (parent, child) in enumerate(zip(parents, children, strict=True)):
            self._edges[child] = Edge(parent, translations[row], rotations[row])

    def forget(self, frames: Iterable[str]) -> None:
        """Drop ``frames`` until they are heard again."""
        for frame in frames:
            self._edges.pop(frame, None)

    @property
    def names(self) -> frozenset[str]:
        """Every frame, children and parents alike."""
        return frozenset(self._edges) | {edge.parent for edge in self._edges.values()}

    @property
    def edges(self) -> Mapping[str, Edge]:
        """The last transform of each child frame."""
        return self._edges

    def top(self, frame: str) -> str:
        """Return the frame above all that ``frame`` hangs on (itself if it hangs on none)."""
        return self._chain(frame)[-1]

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
        while (edge := self._edges.get(chain[-1])) is not None and edge.parent not in seen:
            chain.append(edge.parent)
            seen.add(edge.parent)
        return chain

    def _from_top(self, frame: str) -> Floats:
        pose = np.eye(4)
        for child in self._chain(frame)[:-1]:
            edge = self._edges[child]
            step = np.eye(4)
            step[:3, :3] = to_matrix(np.asarray(edge.rotation))
            step[:3, 3] = edge.translation
            pose = step @ pose
        return pose
