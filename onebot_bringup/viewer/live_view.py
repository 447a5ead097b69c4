"""A robot on show: takes in descriptions, transforms and joint states, keeps the recording right.

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
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot, read_robot
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.streams import JointStream, Transforms, TransformStream
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.text import did_you_mean, listing

# How long the view waits for every link's frame before it is laid out without them (seconds).
_PATIENCE = 1.0
_COMPLAIN_AFTER = 3.0
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
        self._started = clock()
        self._changed = clock()
        self._robot: Robot | None = None
        self._layout: _Layout | None = None
        self._retired: set[str] = set()
        self._complained: set[str] = set()
        self._next_hint = 2.0
        self.frames = FrameTree()
        axes = self._view.axes
        self._scene = Scene(
            stream,
            axes_length=axes.length or _DEFAULT_AXES,
            axes_names=axes.names,
            frame_prefix=frame_prefix,
        )
        self._transforms = TransformStream(stream, self.frames)
        self._joints = JointStream(stream)
        if blueprint is not None:
            stream.log_file_from_path(blueprint)

    @property
    def robot(self) -> Robot | None:
        """The robot shown now."""
        return self._robot

    @property
    def fixed_frame(self) -> str:
        """The frame everything is shown in; "" before there is any."""
        if self._view.fixed_frame or self._robot is None:
            return self._view.fixed_frame
        return self.frames.top(self._scene.frame_of(self._robot.root))

    def set_description(self, urdf: str) -> list[str]:
        """Show the robot that ``urdf`` describes, in the place of the one before.

        Returns:
            What could not be drawn, a sentence each.

        Raises:
            DescriptionError: it is no URDF; the robot shown before stays.
        """
        robot = read_robot(urdf)
        problems = self._scene.set_robot(robot)
        self._retire_frames(robot)
        if self._robot is None or robot.name != self._robot.name:
            self._stream.send_recording_name(robot.name)
        self._robot = robot
        self._changed = self._clock()
        self._complained.clear()
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

    def tick(self, now_ns: int) -> list[str]:
        """Log what was collected and set the view up; call it some 20 times a second.

        Args:
            now_ns: stands in for a stamp of zero, nanoseconds.

        Returns:
            What the user should know now, a sentence each.
        """
        self._transforms.flush(now_ns)
        self._joints.flush()
        self._show_frames()
        if self._robot is None:
            return self._hint_waiting()
        missing = self._missing_links()
        self._lay_out(complete=not missing)
        return self._complaints(missing)

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
        blueprint = make_blueprint(self._shown(), fixed_frame, eye, target, spacing)
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

    def _hint_waiting(self) -> list[str]:
        waited = self._clock() - self._started
        if waited < self._next_hint:
            return []
        self._next_hint = max(10.0, 2 * self._next_hint)
        return [
            f"waiting for the robot's description on robot_description ({waited:.0f} s); "
            "it comes from robot_state_publisher"
        ]

    def _complaints(self, missing: list[str]) -> list[str]:
        """Say once for a description what keeps links from being shown."""
        if not missing or self._clock() - self._changed < _COMPLAIN_AFTER:
            return []
        fixed = self.fixed_frame
        names = self.frames.names
        if fixed not in names and len(missing) > 1:
            known = did_you_mean(fixed, names, "frames heard")
            message = f'the fixed frame "{fixed}" is not on /tf or /tf_static{known}'
        else:
            message = (
                f'no transform yet from "{fixed}" to {listing(missing, 5)}: '
                "not shown until /tf or /tf_static brings it"
            )
        if message in self._complained:
            return []
        self._complained.add(message)
        return [message]
