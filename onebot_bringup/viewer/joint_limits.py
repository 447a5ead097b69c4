"""The limits of a robot's joints on show: in the plot of positions, and in the robot."""

from collections.abc import Callable

import rerun as rr

from onebot_bringup.viewer.joint_curves import JointStream
from onebot_bringup.viewer.joint_ranges import JointRange, RangeMarks, read_ranges
from onebot_bringup.viewer.view_config import ViewConfig


class JointLimits:
    """Draws them where a view asks for it, and anew only when they change."""

    def __init__(
        self, stream: rr.RecordingStream, joints: JointStream, frame_of: Callable[[str], str]
    ) -> None:
        """Draw in ``stream``.

        Args:
            stream: the recording.
            joints: the curves of the joints.
            frame_of: gives the frame of a link.
        """
        self._joints = joints
        self._frame_of = frame_of
        self._marks = RangeMarks(stream, frame_of)
        self._ranges: tuple[JointRange, ...] = ()
        self._marked: tuple[object, ...] = ()  # what the marks were drawn for

    def set_description(self, urdf: str) -> None:
        """Take the limits that ``urdf`` says."""
        self._ranges = read_ranges(urdf)

    def show(self, view: ViewConfig, root: str, fitting_radius: float) -> None:
        """Draw the limits.

        Args:
            view: says which.
            root: the robot's root link.
            fitting_radius: of the arcs, metres, if the view does not say; 0 while it is not known.
        """
        limits = {joint.name: (joint.lower, joint.upper) for joint in self._ranges}
        self._joints.set_limits(limits if view.joint_plot.limits else {})
        wanted, colors = view.joint_ranges, self._joints.colors
        radius = wanted.radius or fitting_radius
        ranges = self._ranges if wanted.visible and radius else ()
        what = (ranges, radius, len(colors))
        if what != self._marked:
            self._marked = what
            self._marks.show(ranges, radius, colors, self._frame_of(root))
