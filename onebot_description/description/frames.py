"""Frames of a robot as SDFormat names them, and their poses while all moving joints are at 0.

numpy is imported late: that takes longer than all that is done here, and few blocks need it.
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
    """Return the first link above a link by these joints, and a pose of the link in its frame.

    The pose is a translation (3,), m, and a unit quaternion (4,), x y z w.
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
    """The links and joints of a robot, whose frames a pose may be relative to."""

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
        """Return the link whose frame has this name, as SDFormat scopes it; None if there is none.

        ``default`` is the link of "", and one of those whose first link is the model's.
        """
        name = name.strip().rpartition("::")[2]
        if name == _MODEL:
            return placed(default, Origin(), self._joints)[0]
        return self._names.get(name) if name else default

    def relative(self, origin: Origin, frame: str, link: str) -> Origin:
        """Return where ``origin`` in the frame of a link is in that of another ``link``."""
        from onebot_description.model import quaternions

        _, at, turn = placed(frame, origin, self._joints)
        _, base, base_turn = placed(link, Origin(), self._joints)
        back = base_turn * (-1.0, -1.0, -1.0, 1.0)
        x, y, z = quaternions.rotate(back, at - base).tolist()
        matrix = quaternions.to_matrix(quaternions.multiply(back, turn))
        return Origin((x, y, z), quaternions.to_rpy(matrix))

    def turned(self, rpy: Triple, origin: Origin, link: str) -> Triple:
        """Return roll, pitch, yaw in the first link: ``rpy``, then ``origin`` on a link."""
        from onebot_description.model import quaternions

        turn = placed(link, origin, self._joints)[2]
        return quaternions.to_rpy(
            quaternions.to_matrix(quaternions.multiply(turn, quaternions.from_rpy(rpy)))
        )
