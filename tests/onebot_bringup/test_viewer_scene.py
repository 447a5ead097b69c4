"""The scene as Rerun itself shows it: its transform graph, its reports and its picture."""

from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

from onebot_bringup.viewer.core.scene import Scene
from onebot_bringup.viewer.core.shown_robot import RobotToShow
from onebot_bringup.viewer.display_server import APPLICATION, open_recording
from onebot_bringup.viewer.rendering import headless_viewer, still
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import ViewConfig, parse_view
from onebot_description.description import parse_description
from onebot_description.ros.wire.messages import TfArrays
from tests.onebot_bringup.drive_support import column
from tests.onebot_bringup.viewer_support import (
    ARM,
    BLUE,
    ORANGE,
    START_NS,
    VIEW,
    Shown,
    describe,
    take_joints,
    take_tf,
    transforms,
)
from tests.support import wait_for
from tests.support_rendering import center, colored, pixels, require_renderer


def _record(path: Path, view: ViewConfig | None, urdf: str = ARM) -> list[str]:
    """Write a file of the arm with its tip one metre to the right; what was complained about."""
    recording = open_recording(save=path)
    live = RobotView(recording.stream, view)
    describe(live, urdf)
    take_tf(live, transforms("base", "tip", 1.0))
    take_joints(live, START_NS, ("slide",), np.array([1.0]), np.array([0.0]))
    problems = live.tick(START_NS) + live.finish()
    recording.close()
    return problems


def _graph(client) -> dict[tuple[str, str], np.ndarray]:
    graph = client.get_transform_graph(frame_filter="named", include_transforms=True)
    return {
        (edge["parent"], edge["child"]): np.array(edge["source"]["parent_from_child"])
        for edge in graph["edges"]
    }


def _reports(client) -> list[str]:
    return [report.summary for view in client.get_state().views for report in view.reports]


def _wait_until_shown(client, *colors: tuple[int, int, int]) -> None:
    """A live source never counts as loaded: what it serves comes bit by bit."""

    def shown() -> bool:
        image = pixels(still(client))
        return all(colored(image, color).mean() > 0.002 for color in colors)

    wait_for(shown, f"the colours {colors} in the picture")


@pytest.mark.slow
def test_a_recording_shows_the_robot_solid_in_its_colours_in_its_place(tmp_path):
    """Opened later, without an error: a blue box on the left, an orange cylinder on the right."""
    require_renderer()
    text = VIEW.replace("joint_plot: {positions: false, velocities: false}", "")
    assert _record(tmp_path / "arm.rrd", parse_view(text)) == []
    with headless_viewer(str(tmp_path / "arm.rrd")) as client:
        assert _reports(client) == []
        names = {shown.name for shown in client.get_state().views}
        assert names == {"Robot", "Joint positions (rad, m)", "Joint velocities (rad/s, m/s)"}
        [(edge, matrix)] = _graph(client).items()
        assert edge == ("base", "tip")
        np.testing.assert_allclose(matrix[:3, 3], [0, 1, 0])
        image = pixels(still(client))[:, :900]
    blue, orange = colored(image, BLUE), colored(image, ORANGE)
    # Each covers a good part of the picture, and hidden collision shapes cover none.
    assert blue.mean() > 0.02 and orange.mean() > 0.02
    assert center(blue)[0] < 0.45 < 0.55 < center(orange)[0]
    assert center(orange)[1] < center(blue)[1], "the cylinder stands 0.1 m higher"
    # The exact bytes of the URDF are on the side that faces the light, as in RViz.
    assert (np.abs(image - np.array(ORANGE)).max(axis=2) <= 40).any()


def test_a_new_description_replaces_the_robot(tmp_path):
    """A shape of a link that is gone is emptied, in a frame that exists; others are drawn."""
    shown = Shown(tmp_path)
    shown.tick()
    describe(shown.view, ARM.replace('"tip"', '"hand"'))
    take_tf(shown.view, transforms("base", "hand", 1.0, START_NS + 1))
    shown.tick(START_NS + 10**9)
    file = shown.end()
    for link, homes in (("tip", ["base", "tip"]), ("hand", ["hand"]), ("base", ["base"])):
        entity = f"/robot/visual/{link}/0"
        assert sorted(home for [home] in column(file, entity, "CoordinateFrame:frame")) == homes
        assert sum(map(bool, column(file, entity, "Asset3D:blob"))) == 1


def test_a_bad_description_keeps_the_last_good_robot(tmp_path):
    """A typing error while editing does not empty the view."""
    shown = Shown(tmp_path)
    shown.tick()
    describe(shown.view, ARM[:-5])
    shown.tick()
    [(_, error)] = shown.bad
    assert "malformed XML" in str(error)
    assert shown.view.robot is not None and shown.view.robot.robot_name == "arm"


def test_what_cannot_be_drawn_is_named_once_and_marked(tmp_path):
    """One reason is one sentence for all the links; a wireframe box shows where each would be."""
    lost = '<mesh filename="package://no_such_package/x.stl"/>'
    urdf = ARM.replace('<box size=".6 .6 .6"/>', lost).replace(
        '<cylinder radius=".3" length=".6"/>', lost.replace("x.stl", "y.stl")
    )
    recording = open_recording(save=tmp_path / "x.rrd")
    scene = Scene(recording.stream)
    [problem] = scene.set_robot(parse_description(urdf))
    assert problem.startswith("link base, tip: not drawn but marked by a box: mesh no ROS package")
    assert scene.visual_of("base") == "robot/visual/base/0/missing"
    assert scene.visual_of("tip") == "robot/visual/tip/0/missing"
    # Found again, it takes the place of its mark.
    assert scene.set_robot(parse_description(ARM)) == []
    assert scene.visual_of("base") == "robot/visual/base/0"
    recording.close()


@pytest.mark.slow
def test_a_late_viewer_of_a_full_server_still_sees_what_was_sent_once(monkeypatch):
    """With the memory limit reached many times over, layout, shapes and slow frames remain."""
    require_renderer()
    monkeypatch.setattr("onebot_bringup.viewer.core.rerun_limits.REPEAT_AFTER", 0.2)
    recording = open_recording(0, memory_limit="1MB")
    live = RobotView(recording.stream)
    describe(live, ARM)
    take_tf(live, transforms("odom", "base", 3.0))
    stamp = START_NS
    sent = 0

    def send() -> bool:
        nonlocal stamp, sent
        for _ in range(50):
            stamp += 10**7
            take_tf(live, transforms("base", "tip", 1.0, stamp))
            take_joints(live, stamp, ("slide",), np.ones(1), np.ones(1))
        live.tick(stamp)
        sent += 1
        return sent >= 300

    wait_for(send, "the messages to be sent")
    with headless_viewer(recording.uri) as client:
        _wait_until_shown(client, ORANGE)
        graph = _graph(client)
        assert set(graph) == {("odom", "base"), ("base", "tip")}
        assert graph[("odom", "base")][1, 3] == 3.0
        assert "Robot" in {shown.name for shown in client.get_state().views}
        assert _reports(client) == []
    recording.close()


def test_the_fixed_frame_is_the_top_one_or_the_one_asked_for(tmp_path):
    """With "" everything is shown in odom once that is heard; a wrong one is complained about."""
    live = Shown(tmp_path).view
    live.tick(START_NS)
    assert live.stage.fixed_frame == "base"
    take_tf(live, transforms("odom", "base", 0.0))
    live.tick(START_NS)
    assert live.stage.fixed_frame == "odom"

    now = [0.0]
    live = Shown(tmp_path, "fixed_frame: odm", clock=lambda: now[0]).view
    take_tf(live, transforms("odom", "base", 0.0))
    assert live.tick(START_NS) == []
    now[0] = 4.0
    [message] = live.tick(START_NS)
    assert '"odm" is not on /tf' in message and 'did you mean "odom"' in message
    assert 'shown in "odom"' in message and live.stage.fixed_frame == "odom"
    assert live.tick(START_NS) == [], "said once"


def test_the_fixed_frame_is_found_under_the_prefix(tmp_path):
    """A view for odom serves a robot whose frames carry a prefix."""
    live = Shown(tmp_path, "fixed_frame: odom", robots=[RobotToShow("", "r1/")]).view
    for parent, child, fixed in (
        ("r1/odom", "r1/base", "r1/odom"),
        ("odom", "base", "r1/odom"),  # the other robot's is no frame of this one
        ("odom", "r1/odom", "odom"),
    ):
        take_tf(live, transforms(parent, child, 1.0))
        live.tick(START_NS)
        assert live.stage.fixed_frame == fixed


def test_waiting_and_missing_frames_are_said(tmp_path):
    """It says that it waits for the description, then which link has no transform."""
    now = [0.0]
    live = Shown(tmp_path, robot=False, clock=lambda: now[0], live=True).view
    assert live.tick(START_NS) == []
    now[0] = 2.5
    [message] = live.tick(START_NS)
    assert "waiting for the robot's description on robot_description" in message
    describe(live, ARM)
    assert live.tick(START_NS) == []
    now[0] = 6.0
    [message] = live.tick(START_NS)
    assert 'no transform yet from "base" to tip' in message


def test_static_transforms_all_survive_in_a_file(tmp_path):
    """Frames that are sent in several messages are all there when it is opened later."""
    shown = Shown(tmp_path, robot=False)
    for names in (("f0", "f1"), ("f2",)):
        count = len(names)
        shifts, turns = np.full((count, 3), 2.0), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
        stamps = np.zeros(count, np.int64)
        arrays = TfArrays(("base",) * count, (*names,), stamps, shifts, turns)
        take_tf(shown.view, arrays, static=True)
        shown.tick()
    file = shown.end()
    for name in ("f0", "f1", "f2"):
        places = column(file, f"/tf_static/{name}", "Transform3D:translation")
        assert places == [[[2.0, 2.0, 2.0]]]


@pytest.mark.slow
def test_a_blueprint_saved_in_the_viewer_is_loaded(tmp_path):
    """A .rbl takes the place of the view, as it was saved."""
    require_renderer()
    saved = rrb.Blueprint(rrb.Spatial3DView(origin="/", name="My own"))
    saved.save(APPLICATION, str(tmp_path / "mine.rbl"))
    shown = Shown(tmp_path, blueprint=tmp_path / "mine.rbl")
    shown.tick()
    with headless_viewer(str(shown.end())) as client:
        assert [view.name for view in client.get_state().views] == ["My own"]
