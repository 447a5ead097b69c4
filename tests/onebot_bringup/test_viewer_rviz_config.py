"""RViz's own files as views: displays, topics, QoS, colors and camera."""

from pathlib import Path

import pytest

from onebot_bringup.viewer.rviz_config import load_rviz
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError

FILE = Path(__file__).with_name("navigation.rviz").read_text()


def _loaded(tmp_path, text=FILE):
    file = tmp_path / "x.rviz"
    file.write_text(text)
    notices = []
    return load_rviz(file, notices.append), notices


def test_what_rviz_shows_is_shown(tmp_path):
    """And nothing else: what no display names is not shown by itself."""
    view, notices = _loaded(tmp_path)
    assert (view.fixed_frame, view.background, view.automatic) == ("map", (48, 49, 50), False)
    assert (view.grid.visible, view.grid.spacing, view.grid.height) == (True, 2.0, -0.5)
    assert (view.axes.visible, view.axes.names, view.axes.frames) == (True, False, ("base_link",))
    assert view.collision
    looks = view.path.topics
    assert set(looks) == {"plan"}
    assert (looks["plan"].color, looks["plan"].visible) == ((255, 0, 10), True)
    assert looks["plan"].line_width == 0.029999999329447746
    assert (looks["plan"].reliability, looks["plan"].depth) == ("best_effort", 7)
    [notice] = notices
    assert notice.endswith('not shown: ParticleCloud "Amcl Particle Swarm"')


def test_groups_of_properties(tmp_path):
    """Those of a shape are the display's; a covariance has colors of its own."""
    view, notices = _loaded(tmp_path)
    pose, odometry = view.pose_with_covariance.topics["/amcl_pose"], view.odometry.topics["/odom"]
    assert (pose.shape, pose.color, pose.covariance) == ("Axes", (1, 2, 3), False)
    assert (odometry.shape, odometry.color) == ("Axes", (4, 5, 6))
    assert (odometry.axes_length, odometry.keep) == (0.3, 7)
    assert len(notices) == 1


def test_displays_of_sensors_have_the_same_settings(tmp_path):
    """By the same names; those of RViz that have no effect here are left out in silence."""
    view, [notice] = _loaded(tmp_path)
    assert "PointCloud2" not in notice
    [cloud] = view.point_cloud2.topics.values()
    assert (cloud.color_transformer, cloud.channel_name) == ("AxisColor", "ring")
    assert not cloud.autocompute_value_bounds and not cloud.autocompute_intensity_bounds
    assert (cloud.min_value, cloud.max_value) == (-3.0, 7.0)
    assert (cloud.use_rainbow, cloud.min_color) == (False, (0, 0, 10))
    assert (cloud.size, cloud.decay_time) == (0.02, 2.0)
    [scan] = view.laser_scan.topics.values()
    assert (scan.color_transformer, scan.size) == ("auto", 0.0)
    assert set(view.image.topics) == {"/camera/image_raw"}


def test_namespaces_of_markers_are_hidden_as_in_rviz(tmp_path):
    """Whatever their names; of arrays, too."""
    view, _ = _loaded(tmp_path)
    assert view.marker.topics["/marks"].visible
    assert view.marker.topics["/marks"].hidden_namespaces == ("noise", "visible", "1")


def test_an_orbit_looks_from_where_rviz_does(tmp_path):
    """Pitch is up, yaw around, from the focal point; a target frame of its own is followed."""
    view, _ = _loaded(tmp_path)
    assert view.camera.target == (1.0, 2.0, 3.0)
    assert view.camera.eye == pytest.approx((1.0, 2.0 + 10 * 0.75**0.5, 3.0 + 5.0))
    assert view.camera.follow == ""
    following, _ = _loaded(tmp_path, FILE.replace("<Fixed Frame>", "base_link"))
    assert following.camera.follow == "base_link"


def test_a_view_from_above(tmp_path):
    """As high as fits RViz's pixels per meter."""
    camera = "{Class: rviz_default_plugins/TopDownOrtho, Scale: 80, X: 3, Y: 4}"
    start = FILE.index("    Current:")
    view, _ = _loaded(tmp_path, f"{FILE[:start]}    Current: {camera}\n")
    assert view.camera.eye == pytest.approx((3.0, 4.0, 10.0), abs=0.01)
    assert view.camera.target == pytest.approx((3.0, 4.0, 0.0))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [", "is not an RViz file"),
        ("a: 1", 'it has no "Visualization Manager"'),
        ("", 'it has no "Visualization Manager"'),
    ],
)
def test_other_files_are_refused(tmp_path, text, said):
    """With what is wrong."""
    with pytest.raises(OneBotError, match=said):
        _loaded(tmp_path, text)


def test_odd_values_cost_nothing_else(tmp_path):
    """A value that a setting cannot have is left out, and said."""
    text = FILE.replace("Cell Size: 2", "Cell Size: -2").replace("Yaw: 1.57", "Yaw: .nan #")
    view, [notice] = _loaded(tmp_path, text)
    assert view.grid.spacing == 0.0 and "grid.spacing: -2" in notice
    assert view.fixed_frame == "map"


def test_it_is_saved_as_a_view_of_ours(tmp_path):
    """Into a file of our own format."""
    file = tmp_path / "x.rviz"
    file.write_text(FILE)
    source = ViewSource(str(file), print)
    saved = source.save(tmp_path / "x.yaml")
    assert ViewSource(str(saved)).view == source.view
