"""Range sensors: the cone in the file."""

import numpy as np
import pytest
from sensor_msgs.msg import Range

from tests.onebot_bringup.drive_support import column, frames
from tests.onebot_bringup.viewer_support import drawn, show, stamped

ENTITY, TOPIC = "/range/sonar", "/sonar"
INF, NAN = float("inf"), float("nan")


def echo(measured, least=0.1, most=4.0, view=np.pi / 2) -> Range:
    """A measured distance."""
    return stamped(Range(field_of_view=view, min_range=least, max_range=most, range=measured))


def cones(file):
    """The corners of each row, (N, 3)."""
    rows = column(file, ENTITY, "Mesh3D:vertex_positions")
    return [np.array(row).reshape(-1, 3) for row in rows]


def test_the_cone_goes_as_far_as_was_measured(tmp_path):
    """Along x of the sensor's frame, as wide as its field of view."""
    file = drawn(tmp_path, "range: {color: [1, 2, 3], alpha: 0.2}", (TOPIC, echo(2.0)))
    [found] = cones(file)
    np.testing.assert_allclose(found[0], 0.0)
    np.testing.assert_allclose(found[1:, 0], 2.0)
    np.testing.assert_allclose(np.linalg.norm(found[1:-1, 1:], axis=1), 2.0, rtol=1e-6)
    assert frames(file, ENTITY) == ["tip"]
    assert column(file, ENTITY, "Mesh3D:albedo_factor") == [[0x01020333]]
    [triangles] = column(file, ENTITY, "Mesh3D:triangle_indices")
    assert (np.array(triangles).max(), len(triangles)) == (len(found) - 1, 64)
    corners = found[np.array(triangles)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) - found.mean(axis=0)
    assert ((normals * outward).sum(axis=1) > 0).all()


@pytest.mark.parametrize(
    ("message", "reach"),
    [
        (echo(0.1), 0.1),
        (echo(4.0), 4.0),
        (echo(0.05), 0.0),
        (echo(INF), 0.0),
        (echo(-INF), 0.0),
        (echo(NAN), 0.0),
        (echo(-INF, 2.0, 2.0), 2.0),  # it detects at one distance
        (echo(INF, 2.0, 2.0), 0.0),
    ],
)
def test_what_is_out_of_range_is_not_drawn(message, reach, tmp_path):
    """As RViz has it; the cone before it vanishes."""
    file = drawn(tmp_path, "", (TOPIC, echo(1.0)), (TOPIC, message))
    before, found = cones(file)
    assert len(before) and (found[1, 0] if len(found) else 0.0) == pytest.approx(reach)


def test_a_very_wide_field_of_view_has_an_end(tmp_path):
    """Its cone is as wide as can still be seen."""
    file, _ = show(tmp_path, "", (TOPIC, echo(1.0, view=3e38)))
    assert np.abs(cones(file)[0]).max() < 20.0
