"""The viewer's layout: the robot on its grid, curves beside it, quiet panels."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from onebot_bringup.viewer.covariance import COVARIANCE_ENTITY, covariance_entity
from onebot_bringup.viewer.geometry import Vector
from onebot_bringup.viewer.joint_curves import POSITION_ENTITY, VELOCITY_ENTITY
from onebot_bringup.viewer.scene import COLLISION_ENTITY, FRAMES_ENTITY
from onebot_bringup.viewer.speeds import ANGULAR_ENTITY, LINEAR_ENTITY, speed_entity
from onebot_bringup.viewer.streams import TIMELINE
from onebot_bringup.viewer.trails import TRAILS_ENTITY, trail_entity
from onebot_bringup.viewer.view_config import JointPlotView, PanelsView, SpeedsView, ViewConfig

ROBOT_VIEW = "Robot"


def make_blueprint(
    view: ViewConfig,
    fixed_frame: str,
    eye: Vector | None = None,
    target: Vector | None = None,
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
    eye: Vector | None,
    target: Vector | None,
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
