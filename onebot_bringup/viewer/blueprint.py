"""The viewer's blueprint: the robot on its grid, other views beside it, panels collapsed."""

from collections.abc import Collection, Container, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby
from typing import Any
from uuid import UUID

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from onebot_bringup.viewer.core.columns import TIMELINE
from onebot_bringup.viewer.core.display import LayoutPart, last
from onebot_bringup.viewer.core.drawing import topic_entity
from onebot_bringup.viewer.core.robot_shapes import box_around, diagonal, robot_bounds
from onebot_bringup.viewer.core.settings import Color
from onebot_bringup.viewer.core.shown_robot import ShownRobot
from onebot_bringup.viewer.displays.image import ImageDrawing
from onebot_bringup.viewer.view_config import (
    CameraSettings,
    GridSettings,
    PanelsSettings,
)
from onebot_description.arrays import Floats
from onebot_description.geometry.poses import Triple

ROBOT_VIEW = "Robot"
_BESIDE = "Plots and pictures"  # name of a tab
_ROBOT_VIEW_ID = UUID("6f0b5f0e-3c1d-4a52-9a75-0b6c5d9a2e11")
_IN_A_COLUMN = 4  # maximum number of views in a column; more are laid out in two


@dataclass(frozen=True)
class Layout:
    """Everything that a blueprint depends on; a new one is sent when this changes.

    Colors and lengths are not part of it: they change without a new blueprint, which would reset
    the camera.
    """

    grid: GridSettings
    background: Color | None
    camera: CameraSettings
    panels: PanelsSettings
    parts: tuple[LayoutPart, ...]  # one for each robot and display
    fixed_frame: str
    complete: bool  # transforms lead to every link
    robots: tuple[str, ...]  # namespaces of the robots whose description is known
    tabs: bool = False  # the robots fill the viewer; the other views are in a tab

    def in_page(self, cameras: Collection[str]) -> "Layout":
        """Return the layout for a page with little room that shows these cameras itself."""
        pictures = {topic_entity(ImageDrawing.key, topic) for topic in cameras}
        parts = tuple(_without(part, pictures) for part in self.parts)
        return replace(self, parts=parts, tabs=True)


class BlueprintSender:
    """Sends a blueprint that fits the robots, and a new one only when the layout changes."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        robots: Sequence[ShownRobot],
        *,
        from_start: bool = False,
    ) -> None:
        """Send into ``recording``.

        Args:
            recording: where to send.
            robots: the robots to fit.
            from_start: play from the beginning instead of following the latest data.
        """
        self._recording = recording
        self._robots = robots
        self._from_start = from_start
        self._sent: Layout | None = None

    def update(self, layout: Layout) -> None:
        """Send a new blueprint if the layout has changed.

        It is not sent otherwise, since that would undo what the user has rearranged.
        """
        sent = self._sent
        if sent and (layout.fixed_frame, layout.robots) == (sent.fixed_frame, sent.robots):
            # Once complete, it stays so.
            layout = replace(layout, complete=layout.complete or sent.complete)
        if layout == sent:
            return
        self._sent = layout
        blueprint = self._made(layout)
        self._recording.send_blueprint(blueprint, make_active=True, make_default=True)

    def _made(self, layout: Layout) -> rrb.Blueprint:
        boxes = [_box(robot, layout.fixed_frame) for robot in self._robots]
        known = [box for box in boxes if box is not None]
        bounds = box_around(np.concatenate(known)) if known else None
        eye, target = (None, None) if bounds is None else fitting_eye(bounds)
        camera, follow = layout.camera, self.followed(layout.camera.follow)
        if len(self._robots) > 1 and camera.follow and follow is None:
            camera = CameraSettings()  # the view's camera was set up for a single robot
        camera = replace(camera, eye=camera.eye or eye, target=camera.target or target)
        grid = replace(layout.grid, spacing=layout.grid.spacing or fitting_spacing(bounds))
        layout = replace(layout, camera=camera, grid=grid)
        return make_blueprint(layout, follow, self._from_start)

    def followed(self, wanted: str) -> str | None:
        """Return the entity that moves with a link; among several robots, links go by frame."""
        for candidate in self._robots:
            robot = candidate.description
            for link in robot.link_names if wanted and robot is not None else ():
                if wanted == (link if len(self._robots) == 1 else candidate.frame_of(link)):
                    return candidate.entity_of(link)
        return None


def _box(shown: ShownRobot, fixed_frame: str) -> Floats | None:
    """Return the (2, 3) box around a robot, in meters, in a frame."""
    robot = shown.description
    if robot is None:
        return None
    links = {shown.frame_of(link): link for link in robot.link_names}
    poses = shown.frames.poses(links, fixed_frame)
    return robot_bounds(robot, {links[frame]: pose for frame, pose in poses.items()})


def fitting_eye(bounds: Floats, quarters: int = 0) -> tuple[Triple, Triple]:
    """Return eye and target, meters, that show the whole (2, 3) box from the front left, above.

    Args:
        bounds: the box.
        quarters: quarter turns to the left, to look from another side.
    """
    center = bounds.mean(axis=0)
    radius = max(diagonal(bounds) / 2, 0.01)
    direction = np.array([1.0, 0.75, 0.65])
    for _ in range(quarters):
        direction = np.array([-direction[1], direction[0], direction[2]])
    # The factor fits a field of view of about 55 degrees, with some space around the robot.
    eye = center + direction / np.linalg.norm(direction) * radius * 2.6
    return _vector(eye), _vector(center)


def fitting_spacing(bounds: Floats | None) -> float:
    """Return the spacing of a grid that suits a (2, 3) box, meters."""
    return 1.0 if bounds is None or diagonal(bounds) > 1.0 else 0.1


def _vector(values: Floats) -> Triple:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z


def _without(part: LayoutPart, entities: Container[str]) -> LayoutPart:
    return replace(
        part,
        views=tuple(view for view in part.views if view.entity not in entities),
        shown=tuple(entity for entity in part.shown if entity not in entities),
    )


def make_blueprint(
    layout: Layout, follow: str | None = None, from_start: bool = False
) -> rrb.Blueprint:
    """Return the blueprint of ``layout``; the camera moves with the entity ``follow``, if any."""
    robot: rrb.View | rrb.Container = _robot_view(layout, follow)
    wide = [view.view() for part in layout.parts for view in part.wide]
    if wide:
        robot = rrb.Vertical(robot, *wide, row_shares=[4, *[1] * len(wide)])
    columns = _columns(layout)
    if layout.tabs:
        robot = rrb.Tabs(robot, *columns) if columns else robot
    elif columns:
        # With several robots, each has a tab, and only one of them is drawn.
        beside = rrb.Tabs(*columns) if len(columns) > 1 else columns[0]
        shares = [3, 2 if isinstance(beside, rrb.Grid) else 1]
        robot = rrb.Horizontal(robot, beside, column_shares=shares)
    return rrb.Blueprint(robot, *_panels(layout.panels, from_start))


def _columns(layout: Layout) -> list[rrb.Container]:
    """Return the views beside the robots' own, one container per robot."""
    columns: list[rrb.Container] = []
    for robot, of_robot in groupby(layout.parts, key=lambda part: part.robot):
        views = [view.view() for part in of_robot for view in part.views]
        name = robot or (_BESIDE if layout.tabs else None)
        if len(views) > (1 if layout.tabs else _IN_A_COLUMN):
            columns.append(rrb.Grid(*views, grid_columns=2, name=name))
        elif views:
            columns.append(rrb.Vertical(*views, name=name))
    return columns


def _robot_view(layout: Layout, follow: str | None) -> rrb.Spatial3DView:
    optional: dict[str, Any] = {}
    if layout.background is not None:
        optional["background"] = rrb.Background(color=layout.background)
    windows = chain.from_iterable(part.windows for part in layout.parts)
    hidden = (f"- /{entity}/**" for part in layout.parts for entity in part.hidden)
    shown = (f"+ /{entity}/**" for part in layout.parts for entity in part.shown)
    view = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", *hidden, *shown],
        name=ROBOT_VIEW,
        overrides={
            **{
                entity: rrb.EntityBehavior(visible=visible)
                for part in layout.parts
                for entity, visible in part.visible
            },
            **{entity: last(seconds) for entity, seconds in windows},
        },
        line_grid=rrb.LineGrid3D(
            visible=layout.grid.visible,
            spacing=layout.grid.spacing,
            plane=rr.components.Plane3D((0.0, 0.0, 1.0), layout.grid.height),
        ),
        spatial_information=rrb.SpatialInformation(
            target_frame=layout.fixed_frame, show_axes=False
        ),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=layout.camera.eye,
            look_target=layout.camera.target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=follow,
        ),
        **optional,
    )
    # Rerun moves the eye close to an entity when a view begins to follow it. With the same id, the
    # view of a new layout counts as the previous view, which already follows the entity.
    view.id = _ROBOT_VIEW_ID
    return view


def _panels(panels: PanelsSettings, from_start: bool) -> tuple[Any, ...]:
    state: Any = panels
    time = rrb.TimePanel(state=state.time, timeline=TIMELINE, play_state="following")
    if from_start:
        time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing")
    return (
        rrb.BlueprintPanel(state=state.blueprint),
        rrb.SelectionPanel(state=state.selection),
        time,
        rrb.TopPanel(state=state.top),
    )
