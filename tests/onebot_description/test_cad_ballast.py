from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("manifold3d", reason="the CAD needs the extra cad")

from onebot_description.cad.base import solve_ballast  # noqa: E402
from onebot_description.cad.dimensions import read_dimensions  # noqa: E402
from onebot_description.cad.solids import (  # noqa: E402
    box,  # noqa: E402
    total,
    weigh_box,
)
from onebot_description.description.packages import package_share  # noqa: E402
from onebot_description.errors import OneBotError  # noqa: E402

DIMENSIONS = read_dimensions(package_share("onebot_description") / "config/dimensions.yaml")
ROOM = box((-2, -2, -2), (2, 2, 2))
REST = weigh_box(1.5, np.array([-0.06, 0.0, 0.0]), (0.4, 0.25, 0.1))


@given(st.floats(1.4, 3.0), st.tuples(*[st.floats(-0.2, 0.2)] * 3))
def test_the_ballast_gives_the_wanted_mass_and_centre(mass, center):
    """Whatever the rest of the base weighs, and wherever its centre is."""
    rest = weigh_box(mass, np.array(center), (0.4, 0.25, 0.1))
    base = total([rest, solve_ballast(DIMENSIONS, rest, ROOM)])
    assert base.mass == pytest.approx(DIMENSIONS.base_mass, abs=1e-12)
    np.testing.assert_allclose(base.center, DIMENSIONS.base_center_of_mass, atol=1e-12)


def test_what_cannot_be_solved_is_said():
    """Too heavy without ballast, a ballast denser than steel, or one that sticks out."""
    heavy = weigh_box(5.0, np.zeros(3), (1, 1, 1))
    with pytest.raises(OneBotError, match="weighs 5.000 kg without ballast, more than 3.978"):
        solve_ballast(DIMENSIONS, heavy, ROOM)
    with pytest.raises(OneBotError, match="sticks out of the hull by 100.0%"):
        solve_ballast(DIMENSIONS, REST, box((1, 1, 1), (2, 2, 2)))
    small = replace(DIMENSIONS.base.ballast, height=0.002)
    thin = replace(DIMENSIONS, base=replace(DIMENSIONS.base, ballast=small))
    with pytest.raises(OneBotError, match="more than steel"):
        solve_ballast(thin, REST, ROOM)
