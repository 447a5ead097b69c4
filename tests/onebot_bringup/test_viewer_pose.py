"""Poses, points and polygons: shapes, places and colors, and what is bad."""

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
)

from tests.onebot_bringup.drive_support import column, frames, stamps
from tests.onebot_bringup.viewer_support import START_NS, drawn, show, stamped

RED, GREEN, BLUE = 0xCC3333FF, 0x33CC33FF, 0x3366FFFF
QUARTER = (0.0, 0.0, 2.0, 2.0)  # turned to the left; of any length
COLOR = "color: [1, 2, 3]"
COLORED = [0x010203FF]


def pose(x, y=0.0, turn=(0.0, 0.0, 0.0, 0.0)) -> Pose:
    """A pose on the ground."""
    found = Pose()
    found.position.x, found.position.y = float(x), float(y)
    rotation = found.orientation
    rotation.x, rotation.y, rotation.z, rotation.w = turn
    return found


def arrows(file, entity) -> tuple:
    """The last row: where arrows begin, and where to they lead."""
    return tuple(
        np.array(column(file, entity, f"Arrows3D:{name}")[-1]) for name in ("origins", "vectors")
    )


def test_a_pose_is_an_arrow(tmp_path):
    """Along its x, from its place, in its frame, at its time."""
    message = stamped(PoseStamped(pose=pose(1, 2, QUARTER)), START_NS + 7000)
    look = f"{COLOR}, shaft_length: 1.0, shaft_radius: 0.05, head_length: 0.5"
    file = drawn(tmp_path, f"pose: {{{look}}}", ("/goal", message))
    origins, vectors = arrows(file, "/pose/goal")
    np.testing.assert_allclose(origins, [[1, 2, 0]])
    np.testing.assert_allclose(vectors, [[0, 1.5, 0]], atol=1e-7)
    assert column(file, "/pose/goal", "Arrows3D:colors") == [COLORED]
    assert column(file, "/pose/goal", "Arrows3D:radii") == [[pytest.approx(0.05)]]
    assert frames(file, "/pose/goal") == ["tip"]
    assert stamps(file, "/pose/goal") == [START_NS + 7000]


def test_a_pose_is_axes(tmp_path):
    """A null rotation is none, as in RViz."""
    view = "pose: {shape: Axes, axes_length: 0.5, axes_radius: 0.02}"
    file = drawn(tmp_path, view, ("/goal", stamped(PoseStamped(pose=pose(1)))))
    origins, vectors = arrows(file, "/pose/goal")
    np.testing.assert_allclose(origins, [[1, 0, 0]] * 3)
    np.testing.assert_allclose(vectors, 0.5 * np.eye(3))
    assert column(file, "/pose/goal", "Arrows3D:colors") == [[RED, GREEN, BLUE]]


PARTICLES = [pose(1), pose(np.nan), pose(2, 1, QUARTER), pose(1e300)]


def test_many_poses_are_flat_arrows(tmp_path):
    """As RViz's; those that are not finite are left out, none clear them."""
    many = stamped(PoseArray(poses=PARTICLES))
    none = stamped(PoseArray(), START_NS + 1)
    file, warnings = show(
        tmp_path, f"pose_array: {{arrow_length: 1.0, {COLOR}}}", ("/a", many), ("/a", none)
    )
    assert warnings == []
    found, empty = column(file, "/pose_array/a", "LineStrips3D:strips")
    assert not empty
    first, second = np.array(found)
    ends = [[1, 0, 0], [2, 0, 0], [1.75, 0.2, 0], [2, 0, 0], [1.75, -0.2, 0]]
    np.testing.assert_allclose(first, ends, atol=1e-6)
    np.testing.assert_allclose(second[1:3], [[2, 2, 0], [1.8, 1.75, 0]], atol=1e-6)
    assert column(file, "/pose_array/a", "LineStrips3D:colors")[0] == COLORED


def covariant(variances) -> PoseWithCovarianceStamped:
    """A pose at (1, 0), turned to the left, of these variances by their numbers."""
    message = stamped(PoseWithCovarianceStamped())
    message.pose.pose = pose(1, 0, QUARTER)
    for place, variance in variances.items():
        message.pose.covariance[place] = variance
    return message


def test_a_pose_with_its_covariance(tmp_path):
    """The ellipse and the sector are at its place, with a surface in each."""
    message = covariant({0: 0.04, 7: 0.01, 35: 0.01})
    view = "pose_with_covariance: {sigma: 2.0, heading: 1.0, color: [1, 2, 3]}"
    file = drawn(tmp_path, view, ("/amcl_pose", message))
    entity = "/pose_with_covariance/amcl_pose"
    np.testing.assert_allclose(arrows(file, entity)[0], [[1, 0, 0]])
    [[ellipse, sector]] = column(file, entity, "LineStrips3D:strips")
    np.testing.assert_allclose(np.max(ellipse, axis=0), [1.4, 0.2, 0], atol=1e-3)
    np.testing.assert_allclose(np.max(sector, axis=0), [1 + np.sin(0.2), 1, 0], atol=1e-3)
    [corners] = column(file, entity, "Mesh3D:vertex_positions")
    [triangles] = column(file, entity, "Mesh3D:triangle_indices")
    assert np.max(triangles) == len(corners) - 1


@pytest.mark.parametrize(
    ("settings", "variances"),
    [
        ("{}", {}),
        ("{covariance: false}", {0: 0.04, 7: 0.01, 35: 0.01}),
    ],
)
def test_a_covariance_that_is_unknown_is_not_drawn(tmp_path, settings, variances):
    """The pose is."""
    view = f"pose_with_covariance: {settings}"
    file = drawn(tmp_path, view, ("/a", covariant(variances)))
    assert column(file, "/pose_with_covariance/a", "LineStrips3D:strips") == [[]]
    assert len(arrows(file, "/pose_with_covariance/a")[0]) == 1


def point(x, stamp_ns=START_NS, frame="base") -> PointStamped:
    """A point on the x axis."""
    message = stamped(PointStamped(), stamp_ns, frame)
    message.point.x = float(x)
    return message


def test_points_have_a_history(tmp_path):
    """Of the last ones in one frame."""
    view = f"point_stamped: {{radius: 0.1, history_length: 2, {COLOR}}}"
    points = [point(x, START_NS + x) for x in (1, 2, 3)]
    points += [point(4, START_NS + 4, "tip")]
    file = drawn(tmp_path, view, *(("/clicked_point", each) for each in points))
    entity = "/point_stamped/clicked_point"
    rows = column(file, entity, "Points3D:positions")
    assert [[x for x, _, _ in row] for row in rows] == [[1], [1, 2], [2, 3], [4]]
    assert column(file, entity, "Points3D:colors") == [COLORED]
    assert column(file, entity, "Points3D:radii") == [[pytest.approx(0.1)]]
    assert frames(file, entity) == ["base", "tip"]


def test_a_polygon_is_a_closed_line(tmp_path):
    """In its frame; one without points clears it."""
    corners = [(0, 0), (1, 0), (np.nan, 0), (1, 1)]
    message = stamped(PolygonStamped())
    message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in corners]
    empty = stamped(PolygonStamped(), START_NS + 1)
    view = f"polygon: {{{COLOR}}}"
    file = drawn(tmp_path, view, ("/footprint", message), ("/footprint", empty))
    [line], none = column(file, "/polygon/footprint", "LineStrips3D:strips")
    assert line == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0]] and not none
    assert column(file, "/polygon/footprint", "LineStrips3D:colors") == [COLORED]
    assert frames(file, "/polygon/footprint") == ["tip"]
