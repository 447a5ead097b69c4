"""Columns of the names of frames, made once for those that come again and again."""

from collections.abc import Sequence

import rerun as rr

from onebot_bringup.viewer.columns import ReadyColumn, ready

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
