"""Shows a robot in a notebook: as in the viewer, with a slider per joint, without a running ROS.

robot = NotebookRobot(load_description("robot.urdf.xacro"))
robot  # the last line of a cell shows it
robot.move({"elbow": 0.5})
"""

import math
import os
import warnings
from collections.abc import Mapping

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from IPython.display import display
from ipywidgets import FloatSlider, VBox

from onebot_bringup.viewer.blueprint import (
    Layout,
    fitting_eye,
    fitting_spacing,
    make_blueprint,
)
from onebot_bringup.viewer.core.display import LayoutPart
from onebot_bringup.viewer.core.robot_shapes import (
    COLLISION_ENTITY,
    RobotShapes,
    robot_bounds,
)
from onebot_bringup.viewer.view_config import CameraSettings, GridSettings, PanelsSettings
from onebot_description.arrays import Floats
from onebot_description.description import Description, Joint
from onebot_description.model import RobotModel

_SLIDERS = {"max_height": "320px", "overflow": "auto"}  # a long list scrolls


class NotebookRobot:
    """A robot in a cell's output; its sliders and ``move`` move the joints.

    Attributes:
        model: the robot's kinematics.
        recording: what the viewer shows; you can log more into it, in the frames of the links.
        sliders: one per joint that does not mimic another, by joint name.
    """

    def __init__(self, description: Description, *, height: int = 480) -> None:
        """Draw the robot with its joints at 0, or mid-range where 0 is out of range.

        Shapes that cannot be drawn are reported in warnings and marked with a box.

        Args:
            description: the robot.
            height: height of the viewer, pixels.

        Raises:
            OneBotError: its links are not one tree.
        """
        self._description = description
        self.model = RobotModel.from_description(description)
        self._drawn: Floats = np.full((len(self.model.joints), 7), math.nan)
        rests = dict(zip(self.model.joints, self.model.pose({}), strict=True))
        leading = [joint for joint in description.moving_joints if joint.mimic is None]
        self.sliders = {joint.name: _slider(joint, rests[joint.name]) for joint in leading}
        for slider in self.sliders.values():
            slider.observe(self._draw, "value")
        self.recording = rr.RecordingStream(description.robot_name)
        # Rerun's viewer is served locally, not loaded from the internet, unless the user sets it.
        os.environ.setdefault("RERUN_NOTEBOOK_ASSET", "serve-local")
        from rerun.notebook import Viewer

        self._viewer = Viewer(width="auto", height=height, recording=self.recording, theme="dark")
        self.recording.send_blueprint(self._blueprint())
        for problem in RobotShapes(self.recording).set_robot(description):
            warnings.warn(problem, stacklevel=2)
        fixed = self.model.fixed
        for parent, child, pose in zip(fixed.parents, fixed.children, fixed.constant, strict=True):
            self._place(parent, child, pose)
        self._draw()

    @property
    def positions(self) -> dict[str, float]:
        """Positions of all movable joints by name, rad or m."""
        return dict(zip(self.model.joints, self._positions.tolist(), strict=True))

    @property
    def _positions(self) -> Floats:
        return self.model.positions({name: slider.value for name, slider in self.sliders.items()})

    def move(self, positions: Mapping[str, float]) -> None:
        """Move joints; the others stay where they are.

        Args:
            positions: target positions by joint name, rad or m.

        Raises:
            OneBotError: there is no such movable joint, it mimics another one, or a limit is
                exceeded.
        """
        self.model.pose(positions)
        for name, position in positions.items():
            slider = self.sliders[name]
            # A joint without limits may go beyond the range of its slider.
            slider.min, slider.max = min(slider.min, position), max(slider.max, position)
            slider.value = position

    def _ipython_display_(self) -> None:
        self._viewer.display()
        display(VBox(list(self.sliders.values()), layout=_SLIDERS))

    def _draw(self, _: object = None) -> None:
        """Log the poses of the links whose joints have moved."""
        moving = self.model.moving
        poses = moving.transforms(self._positions)
        for row in np.flatnonzero((poses != self._drawn).any(axis=1)).tolist():
            self._place(moving.parents[row], moving.children[row], poses[row])
        self._drawn = poses
        self.recording.flush()

    def _place(self, parent: str, child: str, pose: Floats) -> None:
        """Log a frame's pose in another: x y z in meters, quaternion x y z w."""
        self.recording.log(
            rr.new_entity_path(["tf", child]),
            rr.Transform3D(
                translation=pose[:3],
                quaternion=rr.Quaternion(xyzw=pose[3:]),
                parent_frame=parent,
                child_frame=child,
            ),
            static=True,
        )

    def _blueprint(self) -> rrb.Blueprint:
        """Return a blueprint with only the robot's view, framed as in the viewer."""
        bounds = robot_bounds(self._description, self.model.link_matrices(self._positions))
        eye, target = (None, None) if bounds is None else fitting_eye(bounds)
        grid = GridSettings(spacing=fitting_spacing(bounds))
        camera, panels = CameraSettings(eye, target), PanelsSettings(*["hidden"] * 4)
        parts = (LayoutPart(visible=((COLLISION_ENTITY, False),)),)
        frame = self.model.root_link
        return make_blueprint(Layout(grid, None, camera, panels, parts, frame, True, ()))


def _slider(joint: Joint, position: float) -> FloatSlider:
    lower, upper = joint.lower, joint.upper
    if joint.kind == "continuous" or lower is None or upper is None:
        lower, upper = -math.pi, math.pi
    return FloatSlider(
        value=position,
        min=lower,
        max=upper,
        step=0.001,
        description=joint.name,
        readout_format=".3f",
        style={"description_width": "12em"},
        layout={"width": "auto"},
    )
