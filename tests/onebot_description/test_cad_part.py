import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("manifold3d", reason="the CAD needs the extra cad")

from onebot_description.cad.solids import (  # noqa: E402
    box,  # noqa: E402
    total,
    weigh,
    weigh_all,
    weigh_box,
)

LENGTHS = st.floats(0.01, 1.0)
PLACES = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(st.tuples(LENGTHS, LENGTHS, LENGTHS), PLACES, st.floats(1.0, 8000.0))
def test_a_solid_box_weighs_as_the_formula_says(size, low, density):
    """Mass, centre and inertia from the skin equal m (b^2 + c^2) / 12 and so on."""
    high = tuple(np.add(low, size))
    found = weigh(box(low, high), density)
    mass = density * np.prod(size)
    expected = weigh_box(mass, np.add(low, high) / 2, size)
    assert found.mass == pytest.approx(mass)
    np.testing.assert_allclose(found.center, expected.center, atol=1e-6)
    scale = np.trace(expected.inertia)
    np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-5 * scale)


@given(st.floats(0.1, 0.9), PLACES)
def test_two_halves_weigh_what_the_whole_does(cut, low):
    """The parallel axis theorem: cutting a body and adding its pieces changes nothing."""
    middle, high = (
        (low[0] + cut, low[1] + 0.5, low[2] + 0.3),
        (low[0] + 1, low[1] + 0.5, low[2] + 0.3),
    )
    whole = weigh(box(low, high), 900.0)
    pieces = [
        ("left", box(low, middle)),
        ("right", box((middle[0], low[1], low[2]), high)),
    ]
    sum_of_both = weigh_all(pieces, {"left": 900.0, "right": 900.0})
    assert sum_of_both.mass == pytest.approx(whole.mass)
    np.testing.assert_allclose(sum_of_both.center, whole.center, atol=1e-6)
    np.testing.assert_allclose(sum_of_both.inertia, whole.inertia, atol=1e-3)


def test_a_dumbbell_has_the_inertia_of_two_points():
    """Two small heavy blocks two metres apart: m r^2 across, next to nothing along."""
    blocks = [weigh_box(3.0, np.array([x, 0.0, 0.0]), (1e-3, 1e-3, 1e-3)) for x in (-1.0, 1.0)]
    both = total(blocks)
    np.testing.assert_allclose(both.center, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diag(both.inertia), (0.0, 6.0, 6.0), atol=1e-5)
