"""The driven wheel, and the caster: a fork that swivels about z below the base, and its wheel.

The axle of a wheel is y; the face of the driven wheel is at +y. Wheels are drawn about z, then
turned. The fork's frame is where the swivel axis meets the base.
"""

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np
from manifold3d import CrossSection, Manifold

from onebot_description.cad.solids import Part, around, box, lathe, prism_x, ring, rod_y, weigh
from onebot_description.geometry.poses import Triple

# A multiple of 4, so that the tyre reaches its radius along x and z exactly.
_SEGMENTS = 60
_TYRE = ((-0.09, 0.72), (0.03, 0.88), (0.35, 1), (0.62, 0.98), (0.84, 0.86), (0.96, 0.66), (1, 0.4))
_RIM = ((0.9, 0.7), (0.92, 0.8), (1.01, 0.8), (0.99, 0.6), (0.99, -0.8), (0.92, -0.8), (0.92, 0.45))
_STRIPE = ((0.905, 0.3), (0.932, 0.3), (0.932, 0.66), (0.88, 0.66))  # around the rim's inside
_HUB = ((0, -0.9), (1, -0.9), (1, 0.84), (0.9, 0.93), (0.62, 0.93), (0.56, 0.8), (0, 0.8))

_CASTER_TYRE = ((0, 0.8), (0.25, 0.95), (0.55, 0.92), (0.8, 0.74), (0.95, 0.45), (1, 0.16))
_CASTER_RIM = ((1.02, 0.84), (0.9, 0.84), (0.78, 0.5), (0.4, 0.55), (0.34, 1), (0, 1))
_CASTER_STRIPE = ((0.8, 0.5), (0.92, 0.86), (0.84, 0.86))  # on either side of the rim
_BEARING = ((0, 1), (0.72, 1), (0.8, 0.62), (0.8, 0.4), (1, 0.34), (1, 0), (0, 0))


def make_wheel(dimensions: SimpleNamespace) -> Part:
    """Return the part "wheel"."""
    wheel = dimensions.wheel
    half, edge = wheel.width / 2, wheel.rim_radius
    seen = {
        "rubber": ring(edge, wheel.radius, half, _TYRE, _SEGMENTS) - _grooves(wheel),
        "metal": lathe(edge, half, _RIM, _SEGMENTS) + _spokes(wheel),
        "accent": lathe(edge, half, _STRIPE, _SEGMENTS),
        "trim": lathe(wheel.hub_radius, half, _HUB),
    }
    return _upright("wheel", seen, dimensions)


def _grooves(wheel: SimpleNamespace) -> Manifold:
    """Return the slanted grooves of both shoulders, half a block apart."""
    pitch = 2 * np.pi * wheel.radius / wheel.tread_blocks
    inner, outer = wheel.width * 0.13, wheel.width * 0.6
    slant, gap, floor = 0.55 * pitch, 0.15 * pitch, wheel.radius - wheel.tread_depth
    shape = CrossSection(
        [[(-gap, inner), (gap, inner), (gap + slant, outer), (slant - gap, outer)]]
    )
    upper = prism_x(shape, floor, floor + 0.01)
    lower = prism_x(shape.rotate(180.0), floor, floor + 0.01)
    return around(upper, wheel.tread_blocks) + around(lower, wheel.tread_blocks, 0.5)


def _spokes(wheel: SimpleNamespace) -> Manifold:
    """Return forked spokes that bulge from the rim to the hub's face."""
    half, hub, rim = wheel.width / 2, wheel.hub_radius * 0.8, wheel.rim_radius - 0.003
    near = box((hub, -0.0035, half * 0.42), (hub + 0.003, 0.0035, half * 0.86))
    far = box((rim - 0.001, -0.0023, half * 0.25), (rim, 0.0023, half * 0.6))
    prong = Manifold.batch_hull([near, far.rotate((0.0, 0.0, 15.0))])
    return around(prong + prong.mirror((0.0, 1.0, 0.0)), wheel.spokes)


def make_caster_wheel(dimensions: SimpleNamespace) -> Part:
    """Return the part "caswheel"."""
    wheel = dimensions.caster.wheel
    half, edge = wheel.width / 2, wheel.rim_radius
    hole = Manifold.cylinder(wheel.width, edge * 0.14, -1.0, 12, True)
    stripe = lathe(edge, half, _CASTER_STRIPE)
    seen = {
        "rubber": ring(edge, wheel.radius, half, _CASTER_TYRE),
        "metal": ring(0.0, edge, half, _CASTER_RIM)
        - around(hole.translate((edge * 0.59, 0, 0)), 6),
        "accent": stripe + stripe.mirror((0.0, 0.0, 1.0)),
    }
    return _upright("caswheel", seen, dimensions)


def make_fork(dimensions: SimpleNamespace) -> Part:
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


def axle_position(caster: SimpleNamespace) -> Triple:
    """Return the position of the wheel's axle in the fork's frame, with the wheel on the ground."""
    return (-caster.trail, 0.0, caster.wheel.radius - caster.mount_height)


def _upright(name: str, seen: Mapping[str, Manifold], dimensions: SimpleNamespace) -> Part:
    """Return a part that is drawn about z, with its axle along y."""
    upright = {material: solid.rotate((-90.0, 0.0, 0.0)) for material, solid in seen.items()}
    return Part(name, upright, weigh(upright.items(), dimensions.densities))
