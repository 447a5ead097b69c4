"""The block whose mass and place give the base the centre of mass it must have."""

import numpy as np
from manifold3d import Manifold

from onebot_description.cad.dimensions import Dimensions
from onebot_description.cad.part import Inertial, weigh_box
from onebot_description.cad.shapes import box
from onebot_description.errors import OneBotError

_DENSEST = 7850.0  # kg/m3, steel


def solve_ballast(dimensions: Dimensions, rest: Inertial, room: Manifold) -> Inertial:
    """Return the ballast that, with ``rest``, has the wanted mass and centre of mass.

    Args:
        dimensions: say the wanted mass and centre, and the block's size.
        rest: everything else in the base.
        room: the hull's inside, where the block has to lie.

    Raises:
        OneBotError: it would weigh less than nothing, be denser than steel, or stick out.
    """
    mass = dimensions.base_mass - rest.mass
    if mass <= 0:
        raise OneBotError(
            f"the base weighs {rest.mass:.3f} kg without ballast, more than {dimensions.base_mass}"
        )
    wanted = dimensions.base_mass * np.array(dimensions.base_center_of_mass)
    center = (wanted - rest.mass * rest.center) / mass
    block = dimensions.base.ballast
    size = (block.length, block.width, block.height)
    density = mass / float(np.prod(size))
    if density > _DENSEST:
        raise OneBotError(
            f"the ballast would have {density:.0f} kg/m3, more than steel: enlarge it"
        )
    low, high = center - np.array(size) / 2, center + np.array(size) / 2
    outside = (box(tuple(low), tuple(high)) - room).volume() / float(np.prod(size))
    if outside > 1e-6:
        place = ", ".join(f"{value:.4f}" for value in center)
        raise OneBotError(f"the ballast, at ({place}) m, sticks out of the hull by {outside:.1%}")
    return weigh_box(mass, center, size)
