"""The layout of a robot's view: made to fit the robot, and sent only when it has to change."""

from dataclasses import dataclass, replace

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from onebot_bringup.viewer.blueprint import make_blueprint
from onebot_bringup.viewer.bounds import fitting_eye, robot_bounds
from onebot_bringup.viewer.frames import FrameTree
from onebot_bringup.viewer.geometry import Robot
from onebot_bringup.viewer.scene import Scene
from onebot_bringup.viewer.view_config import (
    AxesView,
    CovarianceView,
    JointRangesView,
    SpeedLineView,
    TrailView,
    ViewConfig,
)


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

    def update(self, robot: Robot, fit: Fit, *, send: bool = True) -> bool:
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

    def _made(self, robot: Robot, fit: Fit) -> rrb.Blueprint:
        links = {self._scene.frame_of(link): link for link in robot.links}
        poses = self._frames.poses(links, fit.fixed_frame)
        by_link = {links[frame]: pose for frame, pose in poses.items()}
        bounds = robot_bounds(robot.geometries, by_link)
        eye = target = None
        spacing = 1.0
        if bounds is not None:
            eye, target = fitting_eye(bounds)
            self.size = float(np.linalg.norm(bounds[1] - bounds[0]))
            spacing = 1.0 if self.size > 1.0 else 0.1
        follow = fit.view.camera.follow
        entity = self._scene.entity_of(follow) if follow in robot.links else None
        return make_blueprint(
            _worth_showing(fit, robot), fit.fixed_frame, eye, target, spacing, entity
        )

    def fitting_length(self, robot: Robot) -> float:
        """Return how long axes should be, metres; 0 before the robot's size is known.

        Long enough to come out of a few big links, short enough for many small ones.
        """
        crowd = len(robot.links) ** 0.7
        return round(0.55 * self.size / crowd, 3) if crowd else 0.0


def _worth_showing(fit: Fit, robot: Robot) -> ViewConfig:
    """The view without plots that would stay empty."""
    plot = fit.view.joint_plot
    plot = replace(
        plot,
        positions=plot.positions and robot.moves,
        velocities=plot.velocities and fit.velocities,
    )
    return replace(fit.view, joint_plot=plot)
