"""Frames of a robot by their SDFormat names, and their poses with all moving joints at 0.

numpy is imported late, because importing it takes longer than everything here, and few robots need
it.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from onebot_description.description.description import Joint, Origin, Triple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MODEL = "__model__"  # SDFormat's name of the frame of a robot's first link

Placed = tuple[str, "NDArray[np.float64]", "NDArray[np.float64]"]


def placed(link: str, origin: Origin, joints: Iterable[Joint]) -> Placed:
    """Express a pose on a link in the frame of the topmost link above it.

    Args:
        link: the link.
        origin: a pose in its frame.
        joints: to follow upwards.

    Returns:
        The topmost link, translation (3,), m, and unit quaternion (4,), x y z w.
    """
    import numpy as np

    from onebot_description.model import quaternions

    above = {joint.child: joint for joint in joints}
    at, turn = np.array(origin.xyz), quaternions.from_rpy(origin.rpy)
    while joint := above.pop(link, None):
        outer = quaternions.from_rpy(joint.origin.rpy)
        at = quaternions.rotate(outer, at) + joint.origin.xyz
        turn, link = quaternions.multiply(outer, turn), joint.parent
    return link, at, turn


class Frames:
    """Resolves names of frames (links and joints of a robot) that poses may be relative to."""

    def __init__(self, links: Iterable[str], joints: Iterable[Joint]) -> None:
        self._joints = [*joints]
        self._links = {name: name for name in links}
        # A joint's frame is the one of the link that it moves.
        self._names = {joint.name: joint.child for joint in self._joints} | self._links

    @property
    def names(self) -> list[str]:
        """Names of links and joints."""
        return [*self._names]

    def link(self, name: str, default: str) -> str | None:
        """Return the link whose frame has this SDFormat name; None if there is none.

        Args:
            name: may be scoped by ``::``; "" is the default, ``__model__`` the robot's first link.
            default: the link that "" stands for.
        """
        name = name.strip().rpartition("::")[2]
        if name == _MODEL:
            return placed(default, Origin(), self._joints)[0]
        return self._names.get(name) if name else default

    def relative(self, origin: Origin, frame: str, link: str) -> Origin:
        """Convert ``origin`` from the frame of the link ``frame`` to that of ``link``."""
        from onebot_description.model import quaternions

        _, at, turn = placed(frame, origin, self._joints)
        _, base, base_turn = placed(link, Origin(), self._joints)
        back = base_turn * (-1.0, -1.0, -1.0, 1.0)
        x, y, z = quaternions.rotate(back, at - base).tolist()
        matrix = quaternions.to_matrix(quaternions.multiply(back, turn))
        return Origin((x, y, z), quaternions.to_rpy(matrix))

    def turned(self, rpy: Triple, origin: Origin, link: str) -> Triple:
        """Return, in the topmost link, roll, pitch, yaw of ``rpy`` relative to ``origin``."""
        from onebot_description.model import quaternions

        turn = placed(link, origin, self._joints)[2]
        return quaternions.to_rpy(
            quaternions.to_matrix(quaternions.multiply(turn, quaternions.from_rpy(rpy)))
        )
