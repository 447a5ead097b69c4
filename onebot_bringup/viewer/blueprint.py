"""The viewer's layout: the robot on its grid, curves beside it, quiet panels."""

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.covariance import COVARIANCE_ENTITY, covariance_entity
from onebot_bringup.viewer.displays.joint_plot import POSITION_ENTITY, VELOCITY_ENTITY
from onebot_bringup.viewer.displays.speeds import ANGULAR_ENTITY, LINEAR_ENTITY, speed_entity
from onebot_bringup.viewer.displays.tf import TIMELINE
from onebot_bringup.viewer.displays.trail import TRAILS_ENTITY, trail_entity
from onebot_bringup.viewer.scene import COLLISION_ENTITY, FRAMES_ENTITY
from onebot_bringup.viewer.shapes import load_shape
from onebot_bringup.viewer.view_config import JointPlotView, PanelsView, SpeedsView, ViewConfig
from onebot_description.description.description import Description, Geometry, Triple
from onebot_description.errors import OneBotError
from onebot_description.model.quaternions import from_rpy, to_matrix

# How large the robot is, so that the first view shows all of it.

Floats = NDArray[np.float64]


def corners(geometry: Geometry) -> Floats:
    """Return the (8, 3) corners of the box around ``geometry``, metres, in its link's frame.

    Raises:
        OneBotError: its mesh cannot be read.
    """
    low, high = load_shape(geometry.shape).bounds
    grid = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    local = np.where(grid == 1, high, low)
    turned = np.asarray(local @ to_matrix(from_rpy(geometry.origin.rpy)).T, np.float64)
    moved: Floats = turned + np.array(geometry.origin.xyz)
    return moved


def robot_bounds(description: Description, poses: Mapping[str, Floats]) -> Floats | None:
    """Return the (2, 3) box around all visuals, metres, in the fixed frame.

    Args:
        description: the robot.
        poses: (4, 4) matrices of the links in the fixed frame; links not in it are left out.
    """
    points = []
    for link in description.links:
        if link.name not in poses:
            continue
        pose = poses[link.name]
        for geometry in link.visuals:
            with contextlib.suppress(OneBotError):  # reported when it was drawn
                points.append(corners(geometry) @ pose[:3, :3].T + pose[:3, 3])
    if not points:
        return None
    cloud = np.concatenate(points)
    return np.array([cloud.min(axis=0), cloud.max(axis=0)])


def fitting_eye(bounds: Floats) -> tuple[Triple, Triple]:
    """Return eye and target, metres, from which the whole box is seen, from front left above."""
    center = bounds.mean(axis=0)
    radius = max(float(np.linalg.norm(bounds[1] - bounds[0])) / 2, 0.01)
    direction = np.array([1.0, 0.75, 0.65])
    # A field of view of about 55 degrees; a bit of air around the robot.
    eye = center + direction / np.linalg.norm(direction) * radius * 2.6
    return _vector(eye), _vector(center)


def _vector(values: Floats) -> Triple:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z


ROBOT_VIEW = "Robot"


def make_blueprint(
    view: ViewConfig,
    fixed_frame: str,
    eye: Triple | None = None,
    target: Triple | None = None,
    grid_spacing: float = 1.0,
    follow: str | None = None,
) -> rrb.Blueprint:
    """Return the layout that ``view`` asks for.

    Args:
        view: the saved view, or the default one.
        fixed_frame: the frame everything is shown in.
        eye: where to look from if the view does not say, metres in the fixed frame.
        target: where to look at if the view does not say.
        grid_spacing: metres, if the view does not say.
        follow: the entity that the camera moves with.
    """
    robot = _robot_view(view, fixed_frame, eye, target, grid_spacing, follow)
    plots = [*_joint_plots(view.joint_plot), *_speed_plots(view.speeds)]
    root = rrb.Horizontal(robot, rrb.Vertical(*plots), column_shares=[3, 1]) if plots else robot
    return rrb.Blueprint(root, *_panels(view.panels))


def _robot_view(
    view: ViewConfig,
    fixed_frame: str,
    eye: Triple | None,
    target: Triple | None,
    grid_spacing: float,
    follow: str | None,
) -> rrb.Spatial3DView:
    camera = view.camera
    eye, target = camera.eye or eye, camera.target or target
    optional: dict[str, Any] = {}
    if view.background is not None:
        optional["background"] = rrb.Background(color=view.background)
    return rrb.Spatial3DView(
        origin="/",
        contents=_shown(view),
        name=ROBOT_VIEW,
        overrides={
            COLLISION_ENTITY: rrb.EntityBehavior(visible=view.collision),
            FRAMES_ENTITY: rrb.EntityBehavior(visible=view.axes.visible),
            **{trail_entity(name): _last(trail.length) for name, trail in view.trails.items()},
        },
        line_grid=rrb.LineGrid3D(
            visible=view.grid.visible,
            spacing=view.grid.spacing or grid_spacing,
            plane=rr.components.Plane3D((0.0, 0.0, 1.0), view.grid.height),
        ),
        spatial_information=rrb.SpatialInformation(target_frame=fixed_frame, show_axes=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=follow,
        ),
        **optional,
    )


def _shown(view: ViewConfig) -> list[str]:
    """Everything, but no trail nor covariance that an earlier version of the view had."""
    names = [*map(trail_entity, view.trails), *map(covariance_entity, view.covariance)]
    old = [f"- /{entity}/**" for entity in (TRAILS_ENTITY, COVARIANCE_ENTITY)]
    return ["+ /**", *old, *(f"+ /{name}/**" for name in names)]


def _joint_plots(plot: JointPlotView) -> list[rrb.TimeSeriesView]:
    shown = [
        (plot.positions, POSITION_ENTITY, "Joint positions (rad, m)"),
        (plot.velocities, VELOCITY_ENTITY, "Joint velocities (rad/s, m/s)"),
    ]
    return [_plot(entity, name, plot.window) for wanted, entity, name in shown if wanted]


def _speed_plots(speeds: SpeedsView) -> list[rrb.TimeSeriesView]:
    if not speeds.lines:
        return []
    return [
        _plot(entity, name, speeds.window, [speed_entity(entity, line) for line in speeds.lines])
        for entity, name in (
            (LINEAR_ENTITY, "Speed (m/s)"),
            (ANGULAR_ENTITY, "Turn rate (rad/s)"),
        )
    ]


def _plot(
    entity: str, name: str, window: float, lines: list[str] | None = None
) -> rrb.TimeSeriesView:
    contents = "$origin/**" if lines is None else [f"+ /{line}" for line in lines]
    return rrb.TimeSeriesView(
        origin=entity, contents=contents, name=name, time_ranges=_last(window)
    )


def _last(seconds: float) -> rrb.VisibleTimeRanges:
    """The last ``seconds`` before the time cursor; 0 for all before it."""
    start = (
        rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds)
        if seconds
        else rrb.TimeRangeBoundary.infinite()
    )
    end = rrb.TimeRangeBoundary.cursor_relative()
    return rrb.VisibleTimeRanges(rrb.VisibleTimeRange(TIMELINE, start=start, end=end))


def _panels(panels: PanelsView) -> tuple[Any, ...]:
    state: Any = panels
    return (
        rrb.BlueprintPanel(state=state.blueprint),
        rrb.SelectionPanel(state=state.selection),
        rrb.TimePanel(state=state.time, timeline=TIMELINE, play_state="following"),
        rrb.TopPanel(state=state.top),
    )
