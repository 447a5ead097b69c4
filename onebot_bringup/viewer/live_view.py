"""A robot on show: takes in what is said of it, and keeps the recording right.

It says where it stands and what it waits for; it waits for nothing itself and never blocks.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.complaints import COMPLAIN_AFTER, Complaints
from onebot_bringup.viewer.drive import DriveStream
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot, read_robot
from onebot_bringup.viewer.joint_curves import JointStream
from onebot_bringup.viewer.joint_limits import JointLimits
from onebot_bringup.viewer.layout import Fit, Layout, laid_out
from onebot_bringup.viewer.odometry_wire import OdometrySample, TwistSample
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.shown_frames import ShownFrames
from onebot_bringup.viewer.standing import Standing
from onebot_bringup.viewer.streams import Transforms, TransformStream
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.text import did_you_mean

# How long the view waits for every link's frame before it is laid out without them (seconds).
_PATIENCE = 1.0
_DEFAULT_AXES = 0.5  # metres

Floats = NDArray[np.float64]


class LiveView:
    """Everything between the topics and the recording."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        view: ViewConfig | None = None,
        *,
        blueprint: Path | None = None,
        frame_prefix: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Show a robot in ``stream``.

        Args:
            stream: the recording.
            view: how to look at it.
            blueprint: a ``.rbl`` file, saved in the viewer, whose layout takes the place of ours.
            frame_prefix: put before link names to get their frames.
            clock: seconds, for tests.
        """
        self._stream = stream
        self._view = view or ViewConfig()
        self._laid_out = laid_out(self._view)
        self._own_layout = True
        self._clock = clock
        self._changed = clock()
        self._robot: Robot | None = None
        self._complaints = Complaints(clock)
        self.frames = FrameTree()
        axes = self._view.axes
        self._axes_length = axes.length  # as the view had it when they were drawn
        self._scene = Scene(
            stream,
            axes_length=axes.length or _DEFAULT_AXES,
            axes_names=axes.names,
            axes_of=axes.frames,
            frame_prefix=frame_prefix,
        )
        self._transforms = TransformStream(stream, self.frames)
        self._joints = JointStream(stream)
        self._limits = JointLimits(stream, self._joints, self._scene.frame_of)
        self._standing = Standing(self.frames, self._scene.frame_of)
        self._shown_frames = ShownFrames(self._scene, self._transforms, self.frames, clock)
        self._layout = Layout(stream, self._scene, self.frames)
        self._drive = self._make_drive()
        if blueprint is not None:
            self.use_blueprint(blueprint)

    def _make_drive(self) -> DriveStream:
        return DriveStream(self._stream, self._view, self._transforms, self.frames, self._clock)

    def use_blueprint(self, blueprint: Path | None) -> None:
        """Arrange the viewer as a ``.rbl`` file says that was saved in it; None: as the view."""
        self._own_layout = blueprint is None
        if blueprint is None:
            self._layout.forget()
        else:
            self._stream.log_file_from_path(blueprint)

    def set_view(self, view: ViewConfig) -> list[str]:
        """Look at the robot in another way.

        Returns:
            What in it does not fit the robot, a sentence each.
        """
        before, self._view = self._view, view
        self._laid_out = laid_out(view)
        if (before.trails, before.speeds, before.covariance) != (
            view.trails,
            view.speeds,
            view.covariance,
        ):
            self._drive.flush(self.fixed_frame)
            self._drive = self._make_drive()
        self._complaints.forget()
        if self._robot is None:
            return []
        self._changed = self._clock()
        axes, home = view.axes, self._scene.frame_of(self._robot.root)
        self._scene.set_axes(axes.names, axes.frames, home)
        self._show_limits()
        return self._wrong_names(self._robot)

    def _wrong_names(self, robot: Robot) -> list[str]:
        follow = self._view.camera.follow
        if not follow or follow in robot.links:
            return []
        known = did_you_mean(follow, robot.links, "links")
        return [f'camera.follow: the robot has no link "{follow}"{known}']

    @property
    def robot(self) -> Robot | None:
        """The robot shown now."""
        return self._robot

    @property
    def fixed_frame(self) -> str:
        """The frame everything is shown in; "" before there is any.

        The view's, also with the frame_prefix before it; while no such frame is known, the one
        above the robot's root link.
        """
        if self._robot is None:
            return self._view.fixed_frame
        return self._standing.fixed_frame(self._robot, self._view.fixed_frame)

    def set_description(self, urdf: str) -> list[str]:
        """Show the robot that ``urdf`` describes, in the place of the one before.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            DescriptionError: it is no URDF; the robot shown before stays.
        """
        robot = read_robot(urdf)
        problems = self._scene.set_robot(robot)
        problems += self._wrong_names(robot)
        self._limits.set_description(urdf)
        self._shown_frames.retire(self._robot, robot)
        if self._robot is None or robot.name != self._robot.name:
            self._stream.send_recording_name(robot.name)
        self._robot = robot
        self._changed = self._clock()
        self._complaints.forget()
        self._show_limits()
        return problems

    def _show_limits(self) -> None:
        assert self._robot is not None
        radius = self._layout.fitting_length(self._robot)
        self._limits.show(self._view, self._robot.root, radius)

    def add_transforms(self, transforms: Transforms, *, static: bool = False) -> None:
        """Take in a message of /tf, or of /tf_static."""
        if static:
            self._transforms.add_static(transforms)
        else:
            self._transforms.add(transforms)

    def add_joints(
        self, stamp_ns: int, names: tuple[str, ...], positions: Floats, velocities: Floats
    ) -> None:
        """Take in a JointState: nanoseconds, N names, (N,) or empty arrays."""
        self._joints.add(stamp_ns, names, positions, velocities)

    def add_odometry(self, topic: str, stamp_ns: int, sample: OdometrySample) -> None:
        """Take in an Odometry of ``topic``, as the view names it; its time in nanoseconds."""
        self._drive.add_odometry(topic, stamp_ns, sample)

    def add_command(self, topic: str, stamp_ns: int, sample: TwistSample) -> None:
        """Take in a Twist of ``topic``, as the view names it; its time in nanoseconds."""
        self._drive.add_command(topic, stamp_ns, sample)

    def tick(self, now_ns: int, *, curves: bool = True) -> list[str]:
        """Log what was collected and set the view up; call it some 20 times a second.

        Args:
            now_ns: stands in for a stamp of zero, nanoseconds.
            curves: log those of the joints, too; they may come in larger pieces than where the
                robot stands, which is less work for a page that draws slowly.

        Returns:
            What the user should know now, a sentence each.
        """
        self._transforms.flush(now_ns)
        if curves:
            self._joints.flush()
        problems = self._drive.tick(self.fixed_frame, now_ns)
        self._shown_frames.show()
        if self._robot is None:
            return self._complaints.waiting()
        self._show_limits()
        wanted = self._view.fixed_frame
        self._lay_out(self._robot, complete=self._standing.is_whole(self._robot, wanted))
        if self._clock() - self._changed >= COMPLAIN_AFTER:
            problems += self._standing.problems(self._robot, wanted)
        return self._complaints.once(problems)

    def finish(self, now_ns: int) -> None:
        """Log what is still kept back, before the recording is closed."""
        self._transforms.flush(now_ns)
        self._joints.flush()
        self._drive.flush(self.fixed_frame)

    def _lay_out(self, robot: Robot, complete: bool) -> None:
        """Send the layout once all frames are known, or do not come."""
        if not complete and self._clock() - self._changed < _PATIENCE:
            return
        fit = Fit(self._laid_out, self.fixed_frame, complete, self._joints.has_velocities)
        changed = self._layout.update(robot, fit, send=self._own_layout)
        wanted = self._view.axes.length
        if changed or wanted != self._axes_length:
            self._axes_length = wanted
            length = wanted or self._layout.fitting_length(robot)
            self._scene.set_axes_length(length or _DEFAULT_AXES)
