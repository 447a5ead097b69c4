"""The caster: a fork that swivels about z below the base, and the wheel in it.

The fork's frame is where the swivel axis meets the base; the wheel's y axis is its axle.
"""

from manifold3d import CrossSection, Manifold

from onebot_description.cad.dimensions import Section
from onebot_description.cad.solids import Part, around, box, lathe, ring, rod_y, weigh
from onebot_description.geometry.poses import Triple

_TYRE = ((0, 0.8), (0.25, 0.95), (0.55, 0.92), (0.8, 0.74), (0.95, 0.45), (1, 0.16))
_RIM = ((1.02, 0.84), (0.9, 0.84), (0.78, 0.5), (0.4, 0.55), (0.34, 1), (0, 1))
_STRIPE = ((0.8, 0.5), (0.92, 0.86), (0.84, 0.86))  # on either side of the rim
_BEARING = ((0, 1), (0.72, 1), (0.8, 0.62), (0.8, 0.4), (1, 0.34), (1, 0), (0, 0))


def make_caster_wheel(dimensions: Section) -> Part:
    """Return the part "caswheel", which is drawn about z."""
    wheel = dimensions.caster.wheel
    half, edge = wheel.width / 2, wheel.rim_radius
    hole = Manifold.cylinder(wheel.width, edge * 0.14, -1.0, 12, True)
    stripe = lathe(edge, half, _STRIPE)
    seen = {
        "rubber": ring(edge, wheel.radius, half, _TYRE),
        "metal": ring(0.0, edge, half, _RIM) - around(hole.translate((edge * 0.59, 0, 0)), 6),
        "accent": stripe + stripe.mirror((0.0, 0.0, 1.0)),
    }
    upright = {name: solid.rotate((-90.0, 0.0, 0.0)) for name, solid in seen.items()}
    return Part("caswheel", upright, weigh(upright.items(), dimensions.densities))


def make_fork(dimensions: Section) -> Part:
    """Return the part "caster_base2"."""
    caster = dimensions.caster
    # The legs are drawn about the wheel's axle: inner and outer face, lower and upper crown end.
    inner = caster.wheel.width / 2 + caster.gap
    outer = inner + caster.leg_thickness
    low = caster.wheel.radius + caster.crown_gap
    high = low + 0.005
    boss, corner = CrossSection.circle(caster.boss_radius, 24), CrossSection.circle(0.004, 16)
    ends = [corner.translate((caster.trail + x, high - 0.004)) for x in (-0.021, 0.010)]
    side = CrossSection.batch_hull([boss, *ends])
    slab = Manifold.extrude(side, 2 * outer).rotate((90.0, 0.0, 0.0)).translate((0, outer, 0))
    bosses = rod_y(caster.boss_radius * 0.85, 2 * outer + 0.0024, 24)
    legs = slab + bosses - box((-0.1, -inner, low - 0.2), (0.1, inner, low))
    axle = rod_y(0.0028, 2 * (outer + caster.axle_end), 6)
    place = axle_position(caster)
    seen = {
        "metal": lathe(caster.plate_radius, low + place[2] + 0.004, _BEARING),
        "trim": legs.translate(place),
        "accent": axle.translate(place),
    }
    return Part("caster_base2", seen, weigh(seen.items(), dimensions.densities))


def axle_position(caster: Section) -> Triple:
    """Return the position of the wheel's axle in the fork's frame, with the wheel on the ground."""
    return (-caster.trail, 0.0, caster.wheel.radius - caster.mount_height)
