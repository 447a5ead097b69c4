"""What Rerun draws of messages: one picture of all displays."""

import numpy as np
import pytest

from onebot_bringup.viewer.rendering import headless_viewer, render
from onebot_description.ros.wire.message_arrays import TfArrays
from onebot_description.ros.wire.messages import time_message, transforms_message
from tests.onebot_bringup.test_viewer_camera_info import camera
from tests.onebot_bringup.test_viewer_image import image
from tests.onebot_bringup.test_viewer_imu import imu
from tests.onebot_bringup.test_viewer_laser_scan import scan
from tests.onebot_bringup.test_viewer_map import grid
from tests.onebot_bringup.test_viewer_marker import marker
from tests.onebot_bringup.test_viewer_paths import path
from tests.onebot_bringup.test_viewer_point_cloud2 import cloud, packed, xyz
from tests.onebot_bringup.test_viewer_range import echo
from tests.onebot_bringup.viewer_support import START_NS, show
from tests.support_rendering import center, colored, pixels, require_renderer

GREEN, PINK, YELLOW, CYAN = (0, 220, 60), (240, 60, 140), (230, 230, 0), (0, 200, 220)
VIOLET, MAGENTA = (130, 40, 255), (255, 0, 255)
COLORS = (GREEN, PINK, YELLOW, CYAN, VIOLET, MAGENTA)
# From above and behind: +y is to the left, +x up.
VIEW = f"""
fixed_frame: base
axes: {{visible: false}}
grid: {{visible: false}}
camera: {{eye: [-1.0, 0.0, 9.0], target: [0.0, 0.0, 0.0]}}
joint_plot: {{positions: false, velocities: false}}
laser_scan: {{color: {[*GREEN]}, size: 0.2}}
point_cloud2: {{color_transformer: FlatColor, color: {[*PINK]}, size: 0.2}}
range: {{color: {[*YELLOW]}, alpha: 1.0}}
camera_info: {{far_clip: 1.0}}
path: {{color: {[*VIOLET]}, line_width: 0.2}}
curves: {{lines: {{turn: {{topic: imu, field: angular_velocity.z}}}}}}
"""


@pytest.mark.slow
def test_the_picture_has_all_of_them(tmp_path):
    """Each where it was measured, without an error; the camera's picture in a view, too."""
    require_renderer()
    # Looks along x, to the right of the robot.
    place, turn = np.array([[0.0, -1.5, 0.3]]), np.array([[-0.5, 0.5, -0.5, 0.5]])
    lens = TfArrays(("base",), ("lens",), np.array([START_NS]), place, turn)
    places = np.stack(np.meshgrid(np.linspace(-2, -1, 9), np.linspace(1, 2, 9), [0.0]), -1)
    calibration, picture = camera(), image("rgb8", np.full((30, 40, 3), CYAN, np.uint8))
    calibration.header.frame_id = "lens"
    file, said = show(
        tmp_path,
        VIEW,
        ("/tf_static", _static(lens)),
        ("/cam/camera_info", calibration),
        ("/cam/image_raw", picture),
        ("/scan", scan((2.5, 2.5, 2.0), frame="base")),
        ("/cloud", cloud(packed("x", "y", "z"), frame="base", **xyz(places.reshape(-1, 3)))),
        ("/sonar", echo(2.0)),
        ("/imu", imu(frame="base")),
        ("/plan", path([(1.5, -2.5, 0.0), (1.5, -1.5, 0.0)])),
        ("/mark", marker(at=(-1.5, -1.0, 0.0), color=(1.0, 0.0, 1.0, 1.0), scale=(0.5, 0.5, 0.5))),
        ("/mark", marker(ns="gone")),
        ("/mark", marker(ns="gone", action=2)),
        ("/map", grid(np.full((2, 2), 50), x=3.0)),
    )
    assert said == []
    with headless_viewer(str(file), 800, 600) as client:
        views = client.get_state().views
        assert len(views) == 3 and not any(view.reports for view in views)
    render(file, tmp_path / "x.png", 800, 600)
    drawn = pixels(tmp_path / "x.png")
    robot, beside = drawn[:, :598], drawn[:, 602:]
    where = {name: center(colored(robot, name)) for name in COLORS}
    assert where[PINK][0] < 0.4 and where[PINK][1] > 0.6  # left, behind
    assert where[CYAN][0] > 0.6 and where[CYAN][1] < 0.45  # right, ahead
    assert where[YELLOW][0] < 0.5 and where[YELLOW][1] < 0.5  # ahead of the tip
    assert where[VIOLET][0] > 0.5 and where[VIOLET][1] < 0.5  # right, ahead
    assert where[MAGENTA][0] > 0.5 and where[MAGENTA][1] > 0.5  # right, behind
    assert colored(robot, GREEN).sum() > 20
    assert colored(beside, CYAN).mean() > 0.1


def _static(arrays: TfArrays):
    values = np.hstack([arrays.translations, arrays.rotations])
    return transforms_message(time_message(START_NS), arrays.parents, arrays.children, values)
