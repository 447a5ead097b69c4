import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("manifold3d", reason="the CAD needs the extra cad")

from onebot_description.cad.solids import (  # noqa: E402
    box,
    cylinder_y,
    lathe,
    lathe_y,
    loft,
    outline,
    prism_x,
    rounded_rectangle,
    to_mesh,  # noqa: E402
    tube,
)

LENGTHS = st.floats(0.01, 1.0)


@given(LENGTHS, LENGTHS, LENGTHS, st.booleans())
def test_a_loft_of_rectangles_is_a_box(x, y, z, backwards):
    """Its volume is that of the box, whichever way round the sections run."""
    section = np.array([(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)], float)
    if backwards:
        section = section[::-1]
    solid = loft(np.stack([section, section + (x / 2, 0, 0), section + (x, 0, 0)]))
    assert solid.volume() == pytest.approx(x * y * z, rel=1e-6)
    assert to_mesh(solid).is_watertight


def test_a_loft_may_end_in_points():
    """Sections that shrink to a point close like a double pyramid."""
    square = np.array([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)], float)
    solid = loft(np.stack([square * 0 + (-1, 0, 0), square, square * 0 + (1, 0, 0)]))
    assert solid.volume() == pytest.approx(2 * 4 / 3)


def test_a_loft_that_is_no_solid_is_refused():
    """Sections without any area enclose nothing."""
    with pytest.raises(ValueError, match="no solid"):
        loft(np.zeros((3, 4, 3)))


@given(LENGTHS, LENGTHS)
def test_turning_a_rectangle_gives_a_cylinder(radius, height):
    """Lathe and extrusion agree, about z and about y, whichever way round the profile runs."""
    profile = [(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)]
    volume = 0.5 * 48 * radius**2 * np.sin(2 * np.pi / 48) * height
    for solid in (lathe(profile, 48), lathe(profile[::-1], 48), lathe_y(profile, 48)):
        assert solid.volume() == pytest.approx(volume, rel=1e-6)
    expected = cylinder_y(radius, 0.0, height).bounding_box()
    np.testing.assert_allclose(lathe_y(profile, 48).bounding_box(), expected, atol=1e-6)


def test_a_prism_along_x_lies_as_it_was_drawn():
    """The section's first axis is y, its second z."""
    solid = prism_x(outline([(0, 0), (2, 0), (2, 1), (0, 1)]), 3.0, 4.0, (10.0, 20.0))
    np.testing.assert_allclose(solid.bounding_box(), (3, 10, 20, 4, 12, 21), atol=1e-9)
    np.testing.assert_allclose(box((3, 10, 20), (4, 12, 21)).bounding_box(), solid.bounding_box())


def test_a_rounded_rectangle_keeps_its_size():
    """Round corners take area, not width or height."""
    section = rounded_rectangle(0.4, 0.2, 0.05, 16)
    np.testing.assert_allclose(section.bounds(), (-0.2, -0.1, 0.2, 0.1), atol=1e-9)
    assert section.area() == pytest.approx(0.08 - (4 - np.pi) * 0.05**2, rel=1e-3)


def test_a_straight_tube_is_an_elliptic_cylinder():
    """Its width lies across the path, its height at right angles to that."""
    path = np.column_stack([np.zeros(5), np.zeros(5), np.linspace(0, 1, 5)])
    solid = tube(path, (1.0, 0.0, 0.0), 0.4, 0.2)
    np.testing.assert_allclose(solid.bounding_box(), (-0.2, -0.1, 0, 0.2, 0.1, 1), atol=1e-9)
