"""The driven wheel: a tyre with tread, a rim, spokes and a hub.

Its axle is y, and its face is at +y. It is drawn about z, then turned.
"""

import numpy as np
from manifold3d import CrossSection, Manifold

from onebot_description.cad.dimensions import Section
from onebot_description.cad.solids import Part, around, box, lathe, prism_x, ring, weigh

# A multiple of 4, so that the tyre reaches its radius along x and z exactly.
_SEGMENTS = 60
_TYRE = ((-0.09, 0.72), (0.03, 0.88), (0.35, 1), (0.62, 0.98), (0.84, 0.86), (0.96, 0.66), (1, 0.4))
_RIM = ((0.9, 0.7), (0.92, 0.8), (1.01, 0.8), (0.99, 0.6), (0.99, -0.8), (0.92, -0.8), (0.92, 0.45))
_STRIPE = ((0.905, 0.3), (0.932, 0.3), (0.932, 0.66), (0.88, 0.66))  # around the rim's inside
_HUB = ((0, -0.9), (1, -0.9), (1, 0.84), (0.9, 0.93), (0.62, 0.93), (0.56, 0.8), (0, 0.8))


def make_wheel(dimensions: Section) -> Part:
    """Return the part "wheel"."""
    wheel = dimensions.wheel
    half, edge = wheel.width / 2, wheel.rim_radius
    seen = {
        "rubber": ring(edge, wheel.radius, half, _TYRE, _SEGMENTS) - _grooves(wheel),
        "metal": lathe(edge, half, _RIM, _SEGMENTS) + _spokes(wheel),
        "accent": lathe(edge, half, _STRIPE, _SEGMENTS),
        "trim": lathe(wheel.hub_radius, half, _HUB),
    }
    upright = {name: solid.rotate((-90.0, 0.0, 0.0)) for name, solid in seen.items()}
    return Part("wheel", upright, weigh(upright.items(), dimensions.densities))


def _grooves(wheel: Section) -> Manifold:
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


def _spokes(wheel: Section) -> Manifold:
    """Return forked spokes that bulge from the rim to the hub's face."""
    half, hub, rim = wheel.width / 2, wheel.hub_radius * 0.8, wheel.rim_radius - 0.003
    near = box((hub, -0.0035, half * 0.42), (hub + 0.003, 0.0035, half * 0.86))
    far = box((rim - 0.001, -0.0023, half * 0.25), (rim, 0.0023, half * 0.6))
    prong = Manifold.batch_hull([near, far.rotate((0.0, 0.0, 15.0))])
    return around(prong + prong.mirror((0.0, 1.0, 0.0)), wheel.spokes)
