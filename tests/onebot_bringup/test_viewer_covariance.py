"""How sure a pose is: the shapes, and what Rerun shows of them."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.poses import (
    Ellipse,
    ellipse_outline,
    heading_deviation,
    place_ellipse,
    sector_outline,
)
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import parse_view
from tests.onebot_bringup.drive_support import chunks, column, frames, odometry
from tests.onebot_bringup.viewer_support import (
    ARM,
    START_NS,
    describe,
    take_odometry,
    take_tf,
    transforms,
)

TENTH = 10**8
# From behind and above: +y is to the left in the picture, +x up.
VIEW = """
fixed_frame: odom
axes: {visible: false}
grid: {visible: false}
camera: {eye: [-3.0, 0.0, 8.0], target: [0.0, 0.0, 0.0]}
joint_plot: {positions: false, velocities: false}
covariance:
  pose: {topic: odom, color: [0, 220, 60], sigma: 2.0, heading: 0, width: 0.05, height: 1.0}
"""


def _covariance(xx=0.0, yy=0.0, xy=0.0, yaw=0.0):
    matrix = np.zeros((6, 6))
    matrix[0, 0], matrix[1, 1], matrix[0, 1], matrix[1, 0] = xx, yy, xy, xy
    matrix[5, 5] = yaw
    return matrix.ravel()


@given(along=st.floats(0.01, 10), ratio=st.floats(0.05, 0.95), angle=st.floats(-math.pi, math.pi))
def test_the_ellipse_has_the_deviations_that_went_in(along, ratio, angle):
    """A covariance made of two deviations and a direction gives them back."""
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, -sin], [sin, cos]])
    matrix = turn @ np.diag([along**2, (ratio * along) ** 2]) @ turn.T
    found = place_ellipse(_covariance(matrix[0, 0], matrix[1, 1], matrix[0, 1]))
    assert found is not None
    np.testing.assert_allclose(found[:2], [along, ratio * along], rtol=1e-6)
    assert abs(math.sin(found.angle - angle)) < 1e-5


@pytest.mark.parametrize(
    "covariance",
    [
        _covariance(),  # as the truth, and who does not know, publish it
        _covariance(-1.0, 1.0),
        _covariance(math.nan, 1.0),
        _covariance(math.inf, 1.0),
        _covariance(1.0, 1.0, 2.0),  # no covariance: one direction would be less than sure
    ],
)
def test_an_unknown_place_has_no_ellipse(covariance):
    """Nothing is drawn of what means nothing."""
    assert place_ellipse(covariance) is None


def test_a_place_sure_in_one_direction_is_a_line():
    """A covariance of rank one is drawn as what it is."""
    found = place_ellipse(_covariance(0.5, 0.5, 0.5))
    assert found is not None and found.across == pytest.approx(0.0, abs=1e-7)
    outline = ellipse_outline(found, 3.0)
    assert np.isfinite(outline).all()
    np.testing.assert_allclose(outline[:, 0], outline[:, 1], atol=1e-6)


def test_the_sector_is_as_wide_as_the_heading_is_unsure():
    """It opens to either side of x, at most all round; an unknown yaw has none."""
    assert heading_deviation(_covariance(yaw=0.04)) == pytest.approx(0.2)
    points = sector_outline(0.2, 3.0, 0.5)[1:-1]
    angles = np.arctan2(points[:, 1], points[:, 0])
    assert angles.min() == pytest.approx(-0.6) and angles.max() == pytest.approx(0.6)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.5)
    assert np.ptp(np.unwrap(np.arctan2(*sector_outline(50.0, 3.0, 0.5)[1:-1, 1::-1].T))) < 6.29
    for unknown in (0.0, -1.0, math.nan, math.inf):
        assert heading_deviation(_covariance(yaw=unknown)) is None


@given(
    along=st.floats(0.01, 3.0),
    across=st.floats(0.0, 3.0),
    angle=st.floats(-4.0, 4.0),
    sigma=st.floats(0.5, 4.0),
)
def test_an_outline_is_the_ellipse_itself(along, across, angle, sigma):
    """Closed, on the ground, as far as ``sigma`` deviations in its own directions."""
    points = ellipse_outline(Ellipse(along, across, angle), sigma)
    assert points.shape == (49, 3) and not points[:, 2].any()
    np.testing.assert_allclose(points[0], points[-1], atol=1e-9)
    forward = np.array([math.cos(angle), math.sin(angle)])
    ahead = points[:, :2] @ forward
    aside = points[:, :2] @ np.array([-forward[1], forward[0]])
    turns = np.linspace(0.0, math.tau, 49)
    np.testing.assert_allclose(ahead, sigma * along * np.cos(turns), atol=1e-9)
    np.testing.assert_allclose(aside, sigma * across * np.sin(turns), atol=1e-9)


def _recorded(tmp_path: Path, covariances, view=VIEW, place=(0.5, -1.0)) -> Path:
    recording = open_recording(save=tmp_path / "x.rrd")
    live = RobotView(recording.stream, parse_view(view))
    describe(live, ARM)
    for step, covariance in enumerate(covariances):
        stamp = START_NS + step * TENTH
        take_tf(live, transforms("odom", "base", 0.0, stamp))
        take_tf(live, transforms("base", "tip", 0.5, stamp))
        sample = odometry(*place)._replace(covariance=covariance)
        take_odometry(live, "odom", stamp, sample)
        live.tick(stamp)
        live.tick(stamp + TENTH // 2)
    live.finish()
    recording.close()
    return tmp_path / "x.rrd"


def test_a_steady_covariance_is_logged_once_however_far_the_robot_drives(tmp_path):
    """It costs a shape, and where it lies."""
    view = VIEW.replace("heading: 0,", "heading: 0.5,")
    file = _recorded(tmp_path, [_covariance(0.01, 0.01, yaw=0.01)] * 200, view)
    for shape in ("place", "heading"):
        entity = f"/covariance/pose/{shape}"
        assert len(chunks(file, entity)) == 1
        assert frames(file, entity) == [entity[1:]]
        children = column(file, f"/placed{entity}", "Transform3D:child_frame")
        assert children == [[entity[1:]]] * 200


def test_it_goes_when_it_is_unknown(tmp_path):
    """Of one unknown, or as large as none, in the end nothing is left."""
    known = _covariance(0.36, 0.04)
    for last in (_covariance(-1.0, -1.0), _covariance(1e6, 1e6)):
        file = _recorded(tmp_path, [known] * 5 + [last] * 5)
        assert column(file, "/covariance/pose/place", "LineStrips3D:strips")
        assert column(file, "/covariance/pose/place", "Clear:is_recursive") == [[False]]
