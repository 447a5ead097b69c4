"""Frames of a robot by their SDFormat names, and their poses with all moving joints at 0."""

from collections.abc import Iterable

from onebot_description.elements.urdf import Joint
from onebot_description.geometry.poses import (
    Origin,
    Transform,
    Triple,
    compose,
    from_rpy,
    inverse,
    multiply,
    to_rpy,
)

_MODEL = "__model__"  # SDFormat's name of the frame of a robot's first link


def placed(link: str, origin: Origin, joints: Iterable[Joint]) -> tuple[str, Transform]:
    """Express a pose on a link in the frame of the topmost link above it.

    Args:
        link: the link.
        origin: a pose in its frame.
        joints: joints to follow upwards.

    Returns:
        The topmost link, and the pose in its frame.
    """
    above = {joint.child: joint for joint in joints}
    pose = origin.transform
    while joint := above.pop(link, None):
        pose, link = compose(joint.origin.transform, pose), joint.parent
    return link, pose


class Frames:
    """Resolves the names of frames (links and joints of a robot) that poses are relative to.

    Attributes:
        names: the link of each frame, by its name.
    """

    def __init__(self, links: Iterable[str], joints: Iterable[Joint]) -> None:
        self._joints = [*joints]
        # A joint's frame is the one of the link that it moves.
        self.names = {joint.name: joint.child for joint in self._joints}
        self.names |= {name: name for name in links}

    def link(self, name: str, default: str) -> str | None:
        """Return the link whose frame has this SDFormat name; None if there is none.

        Args:
            name: may be scoped by ``::``; "" is the default, ``__model__`` the robot's first link.
            default: the link that "" stands for.
        """
        name = name.strip().rpartition("::")[2]
        if name == _MODEL:
            return placed(default, Origin(), self._joints)[0]
        return self.names.get(name) if name else default

    def relative(self, origin: Origin, frame: str, link: str) -> Origin:
        """Convert ``origin`` from the frame of the link ``frame`` to that of ``link``."""
        _, pose = placed(frame, origin, self._joints)
        _, base = placed(link, Origin(), self._joints)
        return Origin.from_transform(compose(inverse(base), pose))

    def turned(self, rpy: Triple, origin: Origin, link: str) -> Triple:
        """Return, in the topmost link, roll, pitch, yaw of ``rpy`` relative to ``origin``."""
        _, (_, rotation) = placed(link, origin, self._joints)
        return to_rpy(multiply(rotation, from_rpy(rpy)))
