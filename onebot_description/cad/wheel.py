"""The driven wheel: a tyre with tread, a rim, spokes and a hub. Its axle is y, its face at +y."""

import numpy as np
from manifold3d import Manifold, OpType

from onebot_description.cad.dimensions import Dimensions, Wheel
from onebot_description.cad.primitives import Part, box, cylinder_y, lathe_y, outline, weigh_all

# A multiple of 4, so that the tyre reaches its radius along x and z exactly.
_SEGMENTS = 60


def make_wheel(dimensions: Dimensions) -> Part:
    """Return the part "wheel"."""
    wheel = dimensions.wheel
    seen = (
        ("rubber", _tyre(wheel)),
        ("metal", _rim(wheel) + _spokes(wheel)),
        ("accent", _ring(wheel)),
        ("trim", _hub(wheel)),
    )
    return Part("wheel", seen, weigh_all(seen, dimensions.densities))


def _tyre(wheel: Wheel) -> Manifold:
    half, top, seat = wheel.width / 2, wheel.radius, wheel.rim_radius
    wall = top - seat
    side = [
        (seat - 0.0015, half * 0.72),
        (seat + 0.0005, half * 0.88),
        (seat + wall * 0.35, half),
        (seat + wall * 0.62, half * 0.985),
        (top - 0.0026, half * 0.86),
        (top - 0.0007, half * 0.66),
        (top, half * 0.40),
    ]
    profile = side + [(radius, -y) for radius, y in reversed(side)]
    return lathe_y(profile, _SEGMENTS) - _grooves(wheel)


def _grooves(wheel: Wheel) -> Manifold:
    """The slanted grooves of both shoulders, half a block apart."""
    step = 360.0 / wheel.tread_blocks
    pitch = 2 * np.pi * wheel.radius / wheel.tread_blocks
    inner, outer = wheel.width * 0.13, wheel.width * 0.6
    slant, gap, floor = 0.55 * pitch, 0.15 * pitch, wheel.radius - wheel.tread_depth
    left = [(-gap, inner), (gap, inner), (gap + slant, outer), (-gap + slant, outer)]
    right = [(-x, -y) for x, y in left]
    cuts = []
    for corners, start in ((left, 0.0), (right, 0.5)):
        # Drawn in x and y, cut from the tyre's top, then turned about the axle.
        cut = Manifold.extrude(outline(corners), 0.01).translate((0, 0, floor))
        cuts += [
            cut.rotate((0.0, (start + index + 0.25) * step, 0.0))
            for index in range(wheel.tread_blocks)
        ]
    return Manifold.compose(cuts)


def _rim(wheel: Wheel) -> Manifold:
    half, edge = wheel.width / 2, wheel.rim_radius
    profile = [
        (edge - 0.0045, half * 0.70),
        (edge - 0.0035, half * 0.80),
        (edge + 0.0004, half * 0.80),
        (edge - 0.0005, half * 0.60),
        (edge - 0.0005, -half * 0.80),
        (edge - 0.0035, -half * 0.80),
        (edge - 0.0035, half * 0.45),
    ]
    return lathe_y(profile, _SEGMENTS)


def _ring(wheel: Wheel) -> Manifold:
    """A coloured line around the rim's inside."""
    half, edge = wheel.width / 2, wheel.rim_radius
    low, high = half * 0.30, half * 0.66
    profile = [
        (edge - 0.0042, low),
        (edge - 0.003, low),
        (edge - 0.003, high),
        (edge - 0.0052, high),
    ]
    return lathe_y(profile, _SEGMENTS)


def _spokes(wheel: Wheel) -> Manifold:
    """Forked spokes, that bulge from the rim to the hub's face."""
    half = wheel.width / 2
    hub, rim = wheel.hub_radius * 0.8, wheel.rim_radius - 0.003
    prong = Manifold.batch_hull(
        [
            box((-0.0035, half * 0.42, hub), (0.0035, half * 0.86, hub + 0.003)),
            box((-0.0023, half * 0.25, rim - 0.001), (0.0023, half * 0.60, rim)).rotate(
                (0.0, 15.0, 0.0)
            ),
        ]
    )
    spoke = prong + prong.mirror((1.0, 0.0, 0.0))
    step = 360.0 / wheel.spokes
    return Manifold.batch_boolean(
        [spoke.rotate((0.0, index * step, 0.0)) for index in range(wheel.spokes)], OpType.Add
    )


def _hub(wheel: Wheel) -> Manifold:
    half, radius = wheel.width / 2, wheel.hub_radius
    profile = [
        (0.0, -half * 0.9),
        (radius, -half * 0.9),
        (radius, half * 0.84),
        (radius * 0.9, half * 0.93),
        (radius * 0.62, half * 0.93),
        (radius * 0.56, half * 0.80),
        (0.0, half * 0.80),
    ]
    hub = lathe_y(profile, 40)
    bolt = cylinder_y(0.0013, half * 0.8, half * 0.97, 6).translate((0, 0, radius * 0.76))
    step = 360.0 / wheel.spokes
    bolts = [bolt.rotate((0.0, (index + 0.5) * step, 0.0)) for index in range(wheel.spokes)]
    return Manifold.batch_boolean([hub, *bolts], OpType.Add)
