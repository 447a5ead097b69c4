"""Another view of a robot that is on show, and layouts arranged and saved in the viewer."""

import numpy as np
import rerun.blueprint as rrb

from onebot_bringup.viewer.core.display import COLORS
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup.drive_support import column, odometry
from tests.onebot_bringup.viewer_support import (
    START_NS,
    Shown,
    take_odometry,
    take_tf,
    transforms,
)

VIEW = """
fixed_frame: odom
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 2.0, 8.0], target: [0.0, 2.0, 0.0]}
joint_plot: {positions: false, velocities: false}
trails:
  a: {topic: odom, color: [0, 220, 60], width: 0.2, height: 1.0}
"""


def _drive(live: RobotView, start: int) -> None:
    for step in range(start, start + 4):
        stamp, y = START_NS + step * 10**8, 0.1 * step
        take_tf(live, transforms("base", "tip", 0.5, stamp))
        take_tf(live, transforms("odom", "base", y, stamp))
        take_odometry(live, "odom", stamp, odometry(1, y))
        live.tick(stamp)


def _sent(live: RobotView, sent: list, view: str, start: int) -> int:
    """How many layouts are sent for a view."""
    live.set_view(parse_view(view))
    before = len(sent)
    _drive(live, start)
    return len(sent) - before


def test_only_what_is_in_a_layout_sends_another(tmp_path, monkeypatch):
    """Colors, lengths and topics do not: a camera turned by hand stays."""
    view = VIEW + "speeds: {lines: {v: {topic: odom}}}\n"
    live = Shown(tmp_path, view).view
    sent: list[object] = []
    stream = live.stage.recording
    monkeypatch.setattr(stream, "send_blueprint", lambda item, **_: sent.append(item))
    _drive(live, 0)
    assert len(sent) == 1
    for number, (old, new) in enumerate(
        [
            ("[0, 220, 60]", "[230, 20, 200]"),
            ("width: 0.2, height: 1.0", "width: 0.1"),
            ("axes: {visible: false}", "axes: {visible: false, length: 0.3, names: false}"),
            ("v: {topic: odom}", "v: {topic: odom, type: Odometry, color: [1, 2, 3]}"),
            ("velocities: false}", "velocities: false, limits: true}"),
            ("fixed_frame: odom", ""),
        ]
    ):
        assert old in view
        assert _sent(live, sent, view.replace(old, new), 20 * (2 * number + 1)) == 0, new
        assert _sent(live, sent, view, 20 * (2 * number + 2)) == 0, new
    for number, (old, new) in enumerate(
        [
            ("grid: {visible: false}", "grid: {visible: true}"),
            ("grid:", "collision: true\ngrid:"),
            ("fixed_frame: odom", "fixed_frame: base"),
            ("  a:", "  b:"),
            ("height: 1.0", "height: 1.0, length: 5.0"),
            ("v: {topic", "w: {topic"),
            ("axes: {visible: false}", "axes: {visible: true}"),
        ]
    ):
        view = view.replace(old, new)
        assert _sent(live, sent, view, 20 * (20 + number)) == 1, new


def test_a_page_around_the_view_lays_it_out_anew(tmp_path, monkeypatch):
    """Once when it comes, when it shows another camera, and when it is gone."""
    live = Shown(tmp_path, VIEW).view
    sent: list[rrb.Blueprint] = []
    stream = live.stage.recording
    monkeypatch.setattr(stream, "send_blueprint", lambda item, **_: sent.append(item))
    live.offer({"/cam/image_raw": "sensor_msgs/msg/Image"})
    kinds = []
    for number, cameras in enumerate([None, {"/other"}, {"/cam/image_raw"}, None]):
        live.page_cameras = cameras
        _drive(live, 20 * number)
        assert len(sent) == number + 1
        kinds.append(sent[-1].root_container)
    assert [type(kind) for kind in kinds[1:3]] == [rrb.Tabs, rrb.Tabs]
    assert [len(kind.contents) for kind in kinds[1:3]] == [2, 1]
    assert all("- /image/cam/image_raw/**" in kind.contents[0].contents for kind in kinds)
    assert isinstance(kinds[0], rrb.Horizontal) and isinstance(kinds[3], rrb.Horizontal)
    # Else Rerun moves the eye close to the robot that it follows.
    assert len({kind.contents[0].id for kind in kinds}) == 1, "the same view in each layout"


def test_a_legend_explains_trails_and_covariances(tmp_path):
    """As the view names and colors them; robots that are drawn alike share its entries."""
    view = VIEW + "covariance: {b: {topic: odom, color: [1, 2, 3]}, c: {topic: pose}}\n"
    robots = [RobotToShow(f"/robot{number}") for number in range(2)]
    for shown in (Shown(tmp_path, view), Shown(tmp_path, view, robot=False, robots=robots)):
        assert shown.view.legend == [
            ("trail", "a", (0, 220, 60)),
            ("covariance", "b", (1, 2, 3)),
            ("covariance", "c", COLORS[1]),
        ]
        shown.end()


def test_axes_change_their_length_without_another_layout(tmp_path):
    """Longer by a parameter, and of a fitting length again."""
    shown = Shown(tmp_path, VIEW)
    live = shown.view
    _drive(live, 0)
    for start, length in ((20, ", length: 0.7"), (40, "")):
        live.set_view(
            parse_view(VIEW.replace("axes: {visible: false", "axes: {visible: false" + length))
        )
        _drive(live, start)
    lengths = column(shown.end(), "/frames/tip", "TransformAxes3D:axis_length")
    [fitting, longer, again] = lengths
    assert longer == [np.float32(0.7)] and again == fitting != longer
