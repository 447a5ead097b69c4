"""In which frame a robot is shown, and which of its links stand nowhere in it yet."""

from collections.abc import Callable

from onebot_bringup.viewer.complaints import missing_fixed_frame, missing_links
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot


class Standing:
    """Finds that out by what was heard on /tf and /tf_static."""

    def __init__(self, frames: FrameTree, frame_of: Callable[[str], str]) -> None:
        """Look in ``frames``, where a link has the name that ``frame_of`` gives it."""
        self._frames = frames
        self._frame_of = frame_of
        self._missing: list[str] = []
        self._missing_of: tuple[object, ...] = ()  # what that was found out for

    def fixed_frame(self, robot: Robot, wanted: str) -> str:
        """Return the frame to show ``robot`` in: ``wanted``, or else the one above its root."""
        return self.known_as(robot, wanted) or self._frames.top(self._frame_of(robot.root))

    def known_as(self, robot: Robot, wanted: str) -> str:
        """Return the name by which a frame is known, also with the prefix; "" if it is not."""
        if not wanted:
            return ""
        heard, links = self._frames.names, robot.links
        if wanted in heard or wanted in map(self._frame_of, links):
            return wanted
        prefixed = self._frame_of(wanted)
        return prefixed if prefixed in heard or wanted in links else ""

    def missing(self, robot: Robot, fixed_frame: str) -> list[str]:
        """Return the frames of links that nothing connects with ``fixed_frame``."""
        what = (self._frames.version, robot, fixed_frame)
        if what != self._missing_of:
            top = self._frames.top(fixed_frame)
            frames = map(self._frame_of, robot.links)
            self._missing = [frame for frame in frames if self._frames.top(frame) != top]
            self._missing_of = what
        return self._missing

    def is_whole(self, robot: Robot, wanted: str) -> bool:
        """Whether every link is there, and ``robot`` is shown in the frame ``wanted``, if any."""
        as_wanted = not wanted or bool(self.known_as(robot, wanted))
        return as_wanted and not self.missing(robot, self.fixed_frame(robot, wanted))

    def problems(self, robot: Robot, wanted: str) -> list[str]:
        """Return what is not as it should be, a sentence each."""
        found = []
        fixed_frame = self.fixed_frame(robot, wanted)
        missing = self.missing(robot, fixed_frame)
        if missing:
            found.append(missing_links(fixed_frame, missing))
        if wanted and not self.known_as(robot, wanted):
            found.append(missing_fixed_frame(wanted, fixed_frame, self._frames.names))
        return found
