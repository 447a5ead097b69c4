"""The viewer's layout: the robot on its grid, the joints' curves beside it, quiet panels."""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from onebot_bringup.viewer.geometry import Vector
from onebot_bringup.viewer.scene import COLLISION_ENTITY, FRAMES_ENTITY, VISUAL_ENTITY
from onebot_bringup.viewer.streams import POSITION_ENTITY, TIMELINE, VELOCITY_ENTITY
from onebot_bringup.viewer.view_config import JointPlotView, PanelsView, ViewConfig

ROBOT_VIEW = "Robot"


def make_blueprint(
    view: ViewConfig,
    fixed_frame: str,
    eye: Vector | None = None,
    target: Vector | None = None,
    grid_spacing: float = 1.0,
) -> rrb.Blueprint:
    """Return the layout that ``view`` asks for.

    Args:
        view: the saved view, or the default one.
        fixed_frame: the frame everything is shown in.
        eye: where to look from if the view does not say, metres in the fixed frame.
        target: where to look at if the view does not say.
        grid_spacing: metres, if the view does not say.
    """
    robot = _robot_view(view, fixed_frame, eye, target, grid_spacing)
    plots = _plots(view.joint_plot)
    root = rrb.Horizontal(robot, rrb.Vertical(*plots), column_shares=[3, 1]) if plots else robot
    return rrb.Blueprint(root, *_panels(view.panels))


def _robot_view(
    view: ViewConfig,
    fixed_frame: str,
    eye: Vector | None,
    target: Vector | None,
    grid_spacing: float,
) -> rrb.Spatial3DView:
    camera = view.camera
    eye, target = camera.eye or eye, camera.target or target
    follow = rr.new_entity_path([*VISUAL_ENTITY.split("/"), camera.follow, "0"])
    optional: dict[str, Any] = {}
    if view.background is not None:
        optional["background"] = rrb.Background(color=view.background)
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /**"],
        name=ROBOT_VIEW,
        overrides={
            COLLISION_ENTITY: rrb.EntityBehavior(visible=view.collision),
            FRAMES_ENTITY: rrb.EntityBehavior(visible=view.axes.visible),
        },
        line_grid=rrb.LineGrid3D(
            visible=view.grid.visible, spacing=view.grid.spacing or grid_spacing
        ),
        spatial_information=rrb.SpatialInformation(target_frame=fixed_frame, show_axes=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=follow if camera.follow else None,
        ),
        **optional,
    )


def _plots(plot: JointPlotView) -> list[rrb.TimeSeriesView]:
    shown = [
        (plot.positions, POSITION_ENTITY, "Joint positions (rad, m)"),
        (plot.velocities, VELOCITY_ENTITY, "Joint velocities (rad/s, m/s)"),
    ]
    window = rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-plot.window),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return [
        rrb.TimeSeriesView(origin=entity, name=name, time_ranges=[window])
        for wanted, entity, name in shown
        if wanted
    ]


def _panels(panels: PanelsView) -> tuple[Any, ...]:
    state: Any = panels
    return (
        rrb.BlueprintPanel(state=state.blueprint),
        rrb.SelectionPanel(state=state.selection),
        rrb.TimePanel(state=state.time, timeline=TIMELINE, play_state="following"),
        rrb.TopPanel(state=state.top),
    )
