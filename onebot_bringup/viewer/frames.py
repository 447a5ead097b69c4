"""The frame that a robot is shown in, and which of its links have no transform to it."""

from collections.abc import Callable

from onebot_bringup.introspection.transforms import FrameTree
from onebot_description.description import Description
from onebot_description.errors import did_you_mean, listing


def unknown_frame(frames: FrameTree, wanted: str, fixed_frame: str) -> str:
    """Return a warning that ``wanted`` has not been received, and what is shown instead."""
    hint = did_you_mean(wanted, frames.names, "frames received")
    return (
        f'the fixed frame "{wanted}" is not on /tf or /tf_static{hint}; '
        f'shown in "{fixed_frame}" until it is'
    )


class FrameResolution:
    """In which frame a robot is shown, and which of its links have no transform to it."""

    def __init__(self, frames: FrameTree, frame_of: Callable[[str], str]) -> None:
        self._frames = frames
        self._frame_of = frame_of
        self._missing: list[str] = []
        self._missing_of: tuple[object, ...] = ()  # the arguments and tree that it is for

    def fixed_frame(self, robot: Description, wanted: str) -> str:
        """Return the frame to show ``robot`` in: ``wanted``, or else the one above its root."""
        return self.known_as(robot, wanted) or self._frames.top(self._frame_of(robot.root_link))

    def known_as(self, robot: Description, wanted: str) -> str:
        """Return the name by which a frame is known, also with the prefix; "" if it is not.

        Another robot's frame may have the name without the prefix. The frame that is connected with
        this robot counts; if both are, the name without the prefix.
        """
        if not wanted:
            return ""
        received, links = self._frames.names, robot.link_names
        prefixed = self._frame_of(wanted)
        names = [prefixed] if prefixed in received or wanted in links else []
        if wanted in received or wanted in map(self._frame_of, links):
            names.insert(0, wanted)
        top = self._frames.top(self._frame_of(robot.root_link))
        connected = [name for name in names if self._frames.top(name) == top]
        return next(iter(connected + names), "")

    def missing(self, robot: Description, fixed_frame: str) -> list[str]:
        """Return the frames of links that no transform connects with ``fixed_frame``."""
        what = (self._frames.version, robot, fixed_frame)
        if what != self._missing_of:
            top = self._frames.top(fixed_frame)
            frames = map(self._frame_of, robot.link_names)
            self._missing = [frame for frame in frames if self._frames.top(frame) != top]
            self._missing_of = what
        return self._missing

    def is_complete(self, robot: Description, wanted: str) -> bool:
        """Whether every link has a transform to the frame ``wanted``, which exists, if given."""
        as_wanted = not wanted or bool(self.known_as(robot, wanted))
        return as_wanted and not self.missing(robot, self.fixed_frame(robot, wanted))

    def warnings(self, robot: Description, wanted: str) -> list[str]:
        """Return the links without a transform, and a missing fixed frame, a sentence each."""
        warnings = []
        fixed_frame = self.fixed_frame(robot, wanted)
        missing = self.missing(robot, fixed_frame)
        if missing:
            warnings.append(
                f'no transform yet from "{fixed_frame}" to {listing(missing, 5)}: '
                "not shown until /tf or /tf_static brings it"
            )
        if wanted and not self.known_as(robot, wanted):
            warnings.append(unknown_frame(self._frames, wanted, fixed_frame))
        return warnings
