"""A robot on show: takes in what is said of it, and keeps the recording right.

It says where it stands and what it waits for; it waits for nothing itself and never blocks.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.blueprint import make_blueprint
from onebot_bringup.viewer.bounds import fitting_eye, robot_bounds
from onebot_bringup.viewer.complaints import (
    COMPLAIN_AFTER,
    Complaints,
    missing_fixed_frame,
    missing_links,
)
from onebot_bringup.viewer.drive import DriveStream
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot, read_robot
from onebot_bringup.viewer.odometry_wire import OdometrySample, TwistSample
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.streams import JointStream, Transforms, TransformStream
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.text import did_you_mean

# How long the view waits for every link's frame before it is laid out without them (seconds).
_PATIENCE = 1.0
_DEFAULT_AXES = 0.5  # metres

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Layout:
    """What the current blueprint was made for; it is sent again when this changes."""

    fixed_frame: str
    complete: bool
    velocities: bool


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
            blueprint: a ``.rbl`` file, saved in the viewer, in the place of ``view``.
            frame_prefix: put before link names to get their frames.
            clock: seconds, for tests.
        """
        self._stream = stream
        self._view = view or ViewConfig()
        self._own_layout = blueprint is None
        self._clock = clock
        self._changed = clock()
        self._robot: Robot | None = None
        self._layout: _Layout | None = None
        self._retired: set[str] = set()
        self._complaints = Complaints(clock)
        self.frames = FrameTree()
        axes = self._view.axes
        self._scene = Scene(
            stream,
            axes_length=axes.length or _DEFAULT_AXES,
            axes_names=axes.names,
            axes_of=axes.frames,
            frame_prefix=frame_prefix,
        )
        self._transforms = TransformStream(stream, self.frames)
        self._joints = JointStream(stream)
        self._drive = DriveStream(stream, self._view, self.frames, clock)
        if blueprint is not None:
            stream.log_file_from_path(blueprint)

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
        return self._wanted_frame() or self.frames.top(self._scene.frame_of(self._robot.root))

    def _wanted_frame(self) -> str:
        """The view's fixed frame under the name it is known by; "" if there is none such."""
        assert self._robot is not None
        wanted = self._view.fixed_frame
        known = self.frames.names.union(map(self._scene.frame_of, self._robot.links))
        names = (wanted, self._scene.frame_of(wanted)) if wanted else ()
        return next((name for name in names if name in known), "")

    def set_description(self, urdf: str) -> list[str]:
        """Show the robot that ``urdf`` describes, in the place of the one before.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            DescriptionError: it is no URDF; the robot shown before stays.
        """
        robot = read_robot(urdf)
        problems = self._scene.set_robot(robot)
        follow = self._view.camera.follow
        if follow and follow not in robot.links:
            known = did_you_mean(follow, robot.links, "links")
            problems.append(f'camera.follow: the robot has no link "{follow}"{known}')
        self._retire_frames(robot)
        if self._robot is None or robot.name != self._robot.name:
            self._stream.send_recording_name(robot.name)
        self._robot = robot
        self._changed = self._clock()
        self._complaints.forget()
        return problems

    def _retire_frames(self, robot: Robot) -> None:
        """Hide the frames of links that are no more."""
        frame_of = self._scene.frame_of
        before = set() if self._robot is None else set(map(frame_of, self._robot.links))
        self._retired = before - set(map(frame_of, robot.links))
        self._transforms.forget(self._retired)
        self._scene.hide_frames(self._retired, frame_of(robot.root))

    def _show_frames(self) -> None:
        """Draw new frames, but not those that only a straggling message still names."""
        if self._retired and self._clock() - self._changed > _PATIENCE:
            self._transforms.forget(self._retired)
            self._retired = set()
        self._scene.show_frames(self.frames.names - self._retired)

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

    def tick(self, now_ns: int) -> list[str]:
        """Log what was collected and set the view up; call it some 20 times a second.

        Args:
            now_ns: stands in for a stamp of zero, nanoseconds.

        Returns:
            What the user should know now, a sentence each.
        """
        self._transforms.flush(now_ns)
        self._joints.flush()
        problems = self._drive.tick(self.fixed_frame, now_ns)
        self._show_frames()
        if self._robot is None:
            return self._complaints.waiting()
        missing = self._missing_links()
        as_wanted = not self._view.fixed_frame or bool(self._wanted_frame())
        self._lay_out(complete=as_wanted and not missing)
        if self._clock() - self._changed >= COMPLAIN_AFTER:
            fixed = self.fixed_frame
            if missing:
                problems.append(missing_links(fixed, missing))
            if not as_wanted:
                wanted = self._view.fixed_frame
                problems.append(missing_fixed_frame(wanted, fixed, self.frames.names))
        return self._complaints.once(problems)

    def finish(self, now_ns: int) -> None:
        """Log what is still kept back, before the recording is closed."""
        self._transforms.flush(now_ns)
        self._joints.flush()
        self._drive.flush(self.fixed_frame)

    def _missing_links(self) -> list[str]:
        assert self._robot is not None
        fixed = self.fixed_frame
        frames = map(self._scene.frame_of, self._robot.links)
        top = self.frames.top(fixed)
        return [frame for frame in frames if self.frames.top(frame) != top]

    def _lay_out(self, complete: bool) -> None:
        """Send the blueprint once all frames are known (or do not come), and on a new fixed frame.

        Never otherwise: it would undo what the user has arranged and turned meanwhile.
        """
        if not self._own_layout:
            return
        if not complete and self._clock() - self._changed < _PATIENCE:
            return
        before = self._layout
        if before is not None:  # what was once complete, or heard, stays so
            complete = complete or before.complete
        wanted = _Layout(self.fixed_frame, complete, self._joints.has_velocities)
        if wanted != before:
            self._layout = wanted
            self._send_blueprint(wanted.fixed_frame)

    def _send_blueprint(self, fixed_frame: str) -> None:
        assert self._robot is not None
        links = {self._scene.frame_of(link): link for link in self._robot.links}
        poses = self.frames.poses(links, fixed_frame)
        by_link = {links[frame]: pose for frame, pose in poses.items()}
        bounds = robot_bounds(self._robot.geometries, by_link)
        eye = target = None
        spacing = 1.0
        if bounds is not None:
            eye, target = fitting_eye(bounds)
            size = float(np.linalg.norm(bounds[1] - bounds[0]))
            spacing = 1.0 if size > 1.0 else 0.1
            if not self._view.axes.length:
                # Long enough to come out of a few big links, short enough for many small ones.
                crowd = len(self._robot.links) ** 0.7
                self._scene.set_axes_length(round(0.55 * size / crowd, 3))
        follow = self._view.camera.follow
        entity = self._scene.entity_of(follow) if follow in self._robot.links else None
        blueprint = make_blueprint(self._shown(), fixed_frame, eye, target, spacing, entity)
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def _shown(self) -> ViewConfig:
        """The view without plots that would stay empty."""
        assert self._robot is not None
        plot = self._view.joint_plot
        plot = replace(
            plot,
            positions=plot.positions and self._robot.moves,
            velocities=plot.velocities and self._joints.has_velocities,
        )
        return replace(self._view, joint_plot=plot)
