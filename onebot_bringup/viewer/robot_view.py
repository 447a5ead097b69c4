"""A robot on show: takes in what is said of it, and keeps the recording right.

It says where it stands and what it waits for; it waits for nothing itself and never blocks.
"""

import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.viewer.blueprint import fitting_eye, make_blueprint, robot_bounds
from onebot_bringup.viewer.displays.joint_limits import JointLimits
from onebot_bringup.viewer.displays.joint_plot import JointStream
from onebot_bringup.viewer.displays.odometry import DriveStream
from onebot_bringup.viewer.displays.tf import FrameTree, Transforms, TransformStream
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.view_config import (
    AxesView,
    CovarianceView,
    JointRangesView,
    SpeedLineView,
    TrailView,
    ViewConfig,
)
from onebot_description.description import Description, read_description
from onebot_description.errors import did_you_mean, listing
from onebot_description.wire.messages import OdometrySample, TwistSample

# What keeps something from being shown, said once and in words.

# How long a link or a frame may take before its absence is said (seconds).
COMPLAIN_AFTER = 3.0


class Complaints:
    """Says each sentence once for a description, and now and then that there is none."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Count from now, in the seconds of ``clock``."""
        self._clock = clock
        self._started = clock()
        self._said: set[str] = set()
        self._next_hint = 2.0

    def forget(self) -> None:
        """Say everything again where it is still true."""
        self._said.clear()

    def once(self, sentences: Iterable[str]) -> list[str]:
        """Return those of ``sentences`` not said so far."""
        new = [sentence for sentence in sentences if sentence not in self._said]
        self._said.update(new)
        return new

    def waiting(self) -> list[str]:
        """Return, from time to time, that the description is waited for."""
        waited = self._clock() - self._started
        if waited < self._next_hint:
            return []
        self._next_hint = max(10.0, 2 * self._next_hint)
        return [
            f"waiting for the robot's description on robot_description ({waited:.0f} s); "
            "it comes from robot_state_publisher"
        ]


def missing_fixed_frame(wanted: str, shown: str, heard: Collection[str]) -> str:
    """Say that the frame ``wanted`` is not there, and ``shown`` takes its place."""
    return (
        f'the fixed frame "{wanted}" is not on /tf or /tf_static'
        f'{did_you_mean(wanted, heard, "frames heard")}; shown in "{shown}" until it is'
    )


def missing_links(fixed_frame: str, missing: Collection[str]) -> str:
    """Say which frames no transform connects with ``fixed_frame``."""
    return (
        f'no transform yet from "{fixed_frame}" to {listing(missing, 5)}: '
        "not shown until /tf or /tf_static brings it"
    )


# In which frame a robot is shown, and which of its links stand nowhere in it yet.


class Standing:
    """Finds that out by what was heard on /tf and /tf_static."""

    def __init__(self, frames: FrameTree, frame_of: Callable[[str], str]) -> None:
        """Look in ``frames``, where a link has the name that ``frame_of`` gives it."""
        self._frames = frames
        self._frame_of = frame_of
        self._missing: list[str] = []
        self._missing_of: tuple[object, ...] = ()  # what that was found out for

    def fixed_frame(self, robot: Description, wanted: str) -> str:
        """Return the frame to show ``robot`` in: ``wanted``, or else the one above its root."""
        return self.known_as(robot, wanted) or self._frames.top(self._frame_of(robot.root_link))

    def known_as(self, robot: Description, wanted: str) -> str:
        """Return the name by which a frame is known, also with the prefix; "" if it is not."""
        if not wanted:
            return ""
        heard, links = self._frames.names, robot.link_names
        if wanted in heard or wanted in map(self._frame_of, links):
            return wanted
        prefixed = self._frame_of(wanted)
        return prefixed if prefixed in heard or wanted in links else ""

    def missing(self, robot: Description, fixed_frame: str) -> list[str]:
        """Return the frames of links that nothing connects with ``fixed_frame``."""
        what = (self._frames.version, robot, fixed_frame)
        if what != self._missing_of:
            top = self._frames.top(fixed_frame)
            frames = map(self._frame_of, robot.link_names)
            self._missing = [frame for frame in frames if self._frames.top(frame) != top]
            self._missing_of = what
        return self._missing

    def is_whole(self, robot: Description, wanted: str) -> bool:
        """Whether every link is there, and ``robot`` is shown in the frame ``wanted``, if any."""
        as_wanted = not wanted or bool(self.known_as(robot, wanted))
        return as_wanted and not self.missing(robot, self.fixed_frame(robot, wanted))

    def problems(self, robot: Description, wanted: str) -> list[str]:
        """Return what is not as it should be, a sentence each."""
        found = []
        fixed_frame = self.fixed_frame(robot, wanted)
        missing = self.missing(robot, fixed_frame)
        if missing:
            found.append(missing_links(fixed_frame, missing))
        if wanted and not self.known_as(robot, wanted):
            found.append(missing_fixed_frame(wanted, fixed_frame, self._frames.names))
        return found


# The frames that are drawn: all that were heard, but none of a robot that is gone.

# For how long after a new description messages may still name the frames of the old one (seconds).
_STRAGGLING = 1.0


class ShownFrames:
    """Draws axes in new frames, and hides those of links that are no more."""

    def __init__(
        self,
        scene: Scene,
        transforms: TransformStream,
        frames: FrameTree,
        clock: Callable[[], float],
    ) -> None:
        """Draw in ``scene`` the ``frames`` that ``transforms`` hears; ``clock`` in seconds."""
        self._scene = scene
        self._transforms = transforms
        self._frames = frames
        self._clock = clock
        self._retired: set[str] = set()
        self._retired_at = clock()

    def retire(self, before: Description | None, now: Description) -> None:
        """Hide the frames of links that are no more."""
        frame_of = self._scene.frame_of
        old = set() if before is None else set(map(frame_of, before.link_names))
        self._retired = old - set(map(frame_of, now.link_names))
        self._retired_at = self._clock()
        self._transforms.forget(self._retired)
        self._scene.hide_frames(self._retired, frame_of(now.root_link))

    def show(self) -> None:
        """Draw new frames, but not those that only a straggling message still names."""
        if self._retired and self._clock() - self._retired_at > _STRAGGLING:
            self._transforms.forget(self._retired)
            self._retired = set()
        self._scene.show_frames(self._frames.names - self._retired)


# The layout of a robot's view: made to fit the robot, and sent only when it has to change.


def laid_out(view: ViewConfig) -> ViewConfig:
    """Return what of ``view`` is in a layout, and all else as usual.

    Colours and lengths are drawn: they change without another layout, which would turn the camera
    back to where the view has it.
    """
    speeds = view.speeds
    return replace(
        view,
        fixed_frame="",
        axes=AxesView(visible=view.axes.visible),
        joint_plot=replace(view.joint_plot, limits=False),
        joint_ranges=JointRangesView(),
        trails={name: TrailView(length=item.length) for name, item in view.trails.items()},
        covariance=dict.fromkeys(view.covariance, CovarianceView()),
        speeds=replace(speeds, lines=dict.fromkeys(speeds.lines, SpeedLineView())),
    )


@dataclass(frozen=True)
class Fit:
    """What a layout is made for; another one is sent when this changes.

    Attributes:
        view: what of the user's view is in a layout (see ``laid_out``).
        fixed_frame: the frame everything is shown in.
        complete: every link stands somewhere.
        velocities: the joint states tell velocities.
    """

    view: ViewConfig
    fixed_frame: str
    complete: bool
    velocities: bool


class Layout:
    """Sends layouts to the viewer."""

    def __init__(self, stream: rr.RecordingStream, scene: Scene, frames: FrameTree) -> None:
        """Send into ``stream``, by what ``scene`` draws and where its ``frames`` stand."""
        self._stream = stream
        self._scene = scene
        self._frames = frames
        self._sent: Fit | None = None
        self.size = 0.0  # of the robot, metres: its diagonal when it was last laid out

    def forget(self) -> None:
        """Send the next layout whatever it is."""
        self._sent = None

    def update(self, robot: Description, fit: Fit, *, send: bool = True) -> bool:
        """Make the layout for ``robot`` anew if it has to change; True if it did.

        Never otherwise: it would undo what the user has arranged and turned meanwhile.

        Args:
            robot: what is shown.
            fit: what the layout is to fit.
            send: to the viewer; else only the robot's size is taken.
        """
        before = self._sent
        if before and (before.view, before.fixed_frame) == (fit.view, fit.fixed_frame):
            # What was once complete stays so.
            fit = replace(fit, complete=fit.complete or before.complete)
        if fit == before:
            return False
        self._sent = fit
        blueprint = self._made(robot, fit)
        if send:
            self._stream.send_blueprint(blueprint, make_active=True, make_default=True)
        return True

    def _made(self, robot: Description, fit: Fit) -> rrb.Blueprint:
        links = {self._scene.frame_of(link): link for link in robot.link_names}
        poses = self._frames.poses(links, fit.fixed_frame)
        by_link = {links[frame]: pose for frame, pose in poses.items()}
        bounds = robot_bounds(robot, by_link)
        eye = target = None
        spacing = 1.0
        if bounds is not None:
            eye, target = fitting_eye(bounds)
            self.size = float(np.linalg.norm(bounds[1] - bounds[0]))
            spacing = 1.0 if self.size > 1.0 else 0.1
        follow = fit.view.camera.follow
        entity = self._scene.entity_of(follow) if follow in robot.link_names else None
        return make_blueprint(
            _worth_showing(fit, robot), fit.fixed_frame, eye, target, spacing, entity
        )

    def fitting_length(self, robot: Description) -> float:
        """Return how long axes should be, metres; 0 before the robot's size is known.

        Long enough to come out of a few big links, short enough for many small ones.
        """
        crowd = len(robot.link_names) ** 0.7
        return round(0.55 * self.size / crowd, 3) if crowd else 0.0


def _worth_showing(fit: Fit, robot: Description) -> ViewConfig:
    """The view without plots that would stay empty."""
    plot = fit.view.joint_plot
    plot = replace(
        plot,
        positions=plot.positions and any(joint.kind != "fixed" for joint in robot.joints),
        velocities=plot.velocities and fit.velocities,
    )
    return replace(fit.view, joint_plot=plot)


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
        self._robot: Description | None = None
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
        axes, home = view.axes, self._scene.frame_of(self._robot.root_link)
        self._scene.set_axes(axes.names, axes.frames, home)
        self._show_limits()
        return self._wrong_names(self._robot)

    def _wrong_names(self, robot: Description) -> list[str]:
        follow = self._view.camera.follow
        if not follow or follow in robot.link_names:
            return []
        known = did_you_mean(follow, robot.link_names, "links")
        return [f'camera.follow: the robot has no link "{follow}"{known}']

    @property
    def robot(self) -> Description | None:
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
        robot = read_description(urdf, "robot_description")
        problems = self._scene.set_robot(robot)
        problems += self._wrong_names(robot)
        self._limits.set_description(robot)
        self._shown_frames.retire(self._robot, robot)
        if self._robot is None or robot.robot_name != self._robot.robot_name:
            self._stream.send_recording_name(robot.robot_name)
        self._robot = robot
        self._changed = self._clock()
        self._complaints.forget()
        self._show_limits()
        return problems

    def _show_limits(self) -> None:
        assert self._robot is not None
        radius = self._layout.fitting_length(self._robot)
        self._limits.show(self._view, self._robot.root_link, radius)

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

    def _lay_out(self, robot: Description, complete: bool) -> None:
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
