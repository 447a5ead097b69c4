"""The caster: a fork that swivels about z below the base, and the wheel in it.

The fork's frame is where the swivel axis meets the base; the wheel's is on its axle, which is y.
"""

from manifold3d import CrossSection, Manifold

from onebot_description.cad.dimensions import Caster, CasterWheel, Dimensions
from onebot_description.cad.primitives import Part, cylinder_y, lathe, lathe_y, weigh_all

_SEGMENTS = 40  # a multiple of 4, as for the driven wheels


def make_caster_wheel(dimensions: Dimensions) -> Part:
    """Return the part "caswheel"."""
    wheel = dimensions.caster.wheel
    seen = (("rubber", _tyre(wheel)), ("metal", _rim(wheel)), ("accent", _cap(wheel)))
    return Part("caswheel", seen, weigh_all(seen, dimensions.densities))


def _tyre(wheel: CasterWheel) -> Manifold:
    half, top, seat = wheel.width / 2, wheel.radius, wheel.rim_radius
    wall = top - seat
    side = [
        (seat, half * 0.80),
        (seat + wall * 0.25, half * 0.95),
        (seat + wall * 0.55, half * 0.92),
        (seat + wall * 0.80, half * 0.74),
        (seat + wall * 0.95, half * 0.45),
        (top, half * 0.16),
    ]
    profile = side + [(radius, -y) for radius, y in reversed(side)]
    return lathe_y(profile, _SEGMENTS)


def _rim(wheel: CasterWheel) -> Manifold:
    half, edge = wheel.width / 2, wheel.rim_radius
    side = [
        (0.0, half),
        (edge * 0.34, half),
        (edge * 0.40, half * 0.55),
        (edge * 0.78, half * 0.50),
        (edge * 0.90, half * 0.84),
        (edge + 0.0003, half * 0.84),
    ]
    profile = side[::-1] + [(radius, -y) for radius, y in side]
    rim = lathe_y(profile, 40)
    hole = cylinder_y(edge * 0.14, -half * 2, half * 2, 12).translate((0, 0, edge * 0.59))
    return rim - Manifold.compose([hole.rotate((0.0, 60.0 * index, 0.0)) for index in range(6)])


def _cap(wheel: CasterWheel) -> Manifold:
    """A coloured line on either side of the rim."""
    half, edge = wheel.width / 2, wheel.rim_radius
    profile = [(edge * 0.80, half * 0.5), (edge * 0.92, half * 0.86), (edge * 0.84, half * 0.86)]
    ring = lathe_y(profile, 40)
    return Manifold.compose([ring, ring.mirror((0.0, 1.0, 0.0))])


def make_fork(dimensions: Dimensions) -> Part:
    """Return the part "caster_base2"."""
    caster = dimensions.caster
    seen = (
        ("metal", _bearing(caster)),
        ("trim", _legs(caster)),
        ("accent", _axle(caster)),
    )
    return Part("caster_base2", seen, weigh_all(seen, dimensions.densities))


def _crown_height(caster: Caster) -> float:
    """Return the height of the crown's lower face above the axle."""
    return caster.wheel.radius + caster.crown_gap


def _bearing(caster: Caster) -> Manifold:
    """The swivel's bearing, from the mount down to the crown."""
    radius = caster.plate_radius
    crown = _crown_height(caster) - caster.axle_drop + 0.004
    profile = [
        (0.0, crown),
        (radius * 0.72, crown),
        (radius * 0.80, crown * 0.62),
        (radius * 0.80, crown * 0.40),
        (radius, crown * 0.34),
        (radius, 0.0),
        (0.0, 0.0),
    ]
    return lathe(profile, 40)


def _legs(caster: Caster) -> Manifold:
    """Two legs, broad at the crown and round about the axle, that the crown joins."""
    low, high = _crown_height(caster), _crown_height(caster) + 0.005
    inner = caster.wheel.width / 2 + caster.gap
    outer = inner + caster.leg_thickness
    # Drawn from the side, in x and z about the axle; the swivel axis is ahead, at x = trail.
    boss = CrossSection.circle(caster.boss_radius, 24)
    back = CrossSection.circle(0.004, 16).translate((caster.trail - 0.021, high - 0.004))
    head = CrossSection.circle(0.004, 16).translate((caster.trail + 0.010, high - 0.004))
    side = CrossSection.batch_hull([boss, back, head]) - CrossSection.square(
        (0.1, 0.02), center=True
    ).translate((0.0, high + 0.01))
    slab = Manifold.extrude(side, 2 * outer).rotate((90.0, 0.0, 0.0)).translate((0, outer, 0))
    # The space of the wheel: between the legs, below the crown.
    room = Manifold.cube((0.2, 2 * inner, 0.2)).translate((-0.1, -inner, low - 0.2))
    bosses = [
        cylinder_y(caster.boss_radius * 0.85, outer - 0.0005, outer + 0.0012, 24),
        cylinder_y(caster.boss_radius * 0.85, -outer - 0.0012, -outer + 0.0005, 24),
    ]
    legs = slab - room + bosses[0] + bosses[1]
    return legs.translate(axle_position(caster))


def _axle(caster: Caster) -> Manifold:
    half = caster.wheel.width / 2 + caster.gap + caster.leg_thickness + caster.axle_end
    return cylinder_y(0.0028, -half, half, 6).translate(axle_position(caster))


def axle_position(caster: Caster) -> tuple[float, float, float]:
    """Return where the wheel's axle is in the fork's frame."""
    return (-caster.trail, 0.0, -caster.axle_drop)
