"""The base: a swept shell in two tones, with bumper, face, sensor dome, deck, handle and lights."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
from manifold3d import CrossSection, Manifold

from onebot_description.arrays import Floats
from onebot_description.cad.solids import (
    Part,
    Points,
    box,
    lathe,
    prism_x,
    rod_y,
    round_rectangle,
    union,
    weigh,
)
from onebot_description.errors import OneBotError
from onebot_description.model.rigid_bodies import Body

_SECTION_POWER = 5.0  # a superellipse's: 2 is an ellipse, a high power a rectangle
_LEAN = 0.07  # the sides lean inwards, by this share of the half width
# Distance from nose and tail where the width, the top and the bottom begin to close (m), and the
# power of the superellipse along which they close.
_NOSE = {"width": (0.115, 2.5), "top": (0.155, 2.3), "bottom": (0.06, 2.6)}
_TAIL = {"width": (0.085, 2.8), "top": (0.085, 2.5), "bottom": (0.05, 2.4)}
_RAMP = 0.028  # length of the rise from the bottom to the tail's
_NOSE_HEIGHT = -0.027  # m, height of the foremost point
_TAIL_HEIGHT = 0.031  # m
_STATIONS = 35  # sections along the hull; one lies at either end of the ramp
_FAR = 1.0  # m, beyond all parts, for cuts
# The sensor's profiles, as shares of its radius and its height.
_FOOT = ((0, -0.2), (1, -0.2), (1, 0.16), (0.94, 0.24), (0, 0.24))
_CAP = ((0, 0.68), (0.9, 0.68), (0.9, 0.82), (0.84, 0.93), (0.7, 0.985), (0.5, 1), (0, 1))
_WINDOW = ((0, 0.24), (0.84, 0.24), (0.84, 0.68), (0, 0.68))
_RING = ((0.7, 0.26), (0.87, 0.26), (0.87, 0.32), (0.7, 0.32))
_INSIDE = ((0, -0.3), (0.76, -0.3), (0.76, 0.9), (0, 0.9))


def hull(base: SimpleNamespace, grown: float = 0.0) -> Manifold:
    """Return the hull's solid, its skin moved outwards by ``grown`` meters (inwards if < 0)."""
    tail, nose = base.rear - grown, base.front - base.bumper + grown

    def closing(what: str) -> Floats:
        """Return 1 amidships, falling to 0 at either end along a superellipse."""
        result = np.ones(_STATIONS)
        for end, (length, power) in ((nose, _NOSE[what]), (tail, _TAIL[what])):
            depth = np.clip(1 - np.abs(x - end) / length, 0.0, 1.0)
            result *= (1 - depth**power) ** (1 / power)
        return result

    def place(points: Floats) -> Floats:
        """Give each section its place and size."""
        station = np.rint(points[:, 2] * (_STATIONS - 1)).astype(int)
        across, up = (np.sign(points) * np.abs(points) ** (2 / _SECTION_POWER))[:, :2].T
        across *= 1 - _LEAN * (1 + up) / 2
        across *= width[station] / np.abs(across).max()
        height = (top + bottom)[station] / 2 + (top - bottom)[station] / 2 * up
        return np.column_stack([x[station], across, height])

    # Dense towards the ends, where the hull closes.
    x: Floats = tail + (nose - tail) * (1 - np.cos(np.linspace(0.0, np.pi, _STATIONS))) / 2
    rise = np.clip((base.tail_start + _RAMP - x) / _RAMP, 0.0, 1.0)
    floor = base.bottom + (base.tail_bottom - base.bottom) * rise**2 * (3 - 2 * rise) - grown
    middle = np.interp(x, [tail, nose], [_TAIL_HEIGHT, _NOSE_HEIGHT])
    width = (base.width / 2 + grown) * closing("width")
    bottom = middle - (middle - floor) * closing("bottom")
    top = middle + (base.deck + grown - middle) * closing("top")
    section = CrossSection.circle(1.0, 36)
    return Manifold.extrude(section, 1.0, n_divisions=_STATIONS - 2).warp_batch(place)


def make_base(dimensions: SimpleNamespace) -> Part:
    """Return the part "base_link"."""
    base, half_seam = dimensions.base, dimensions.base.seam_width / 2
    skin, set_back = hull(base), hull(base, -0.0012)
    strip = _below_seam(base, _above_seam(base, set_back, -half_seam), half_seam)
    face = _window(0.15, 0.034, 0.0165, (0.0, 0.008))
    eyes = union(_window(0.013, 0.019, 0.006, (y, 0.009)) for y in (-0.03, 0.03))
    tail_light = box((-_FAR, -0.055, 0.038), (-0.25, 0.055, 0.044))
    bumper = box((0.012, -_FAR, -0.038), (_FAR, _FAR, -0.017))
    # A line across the shell, ahead of the sensor.
    stripe = _above_seam(base, box((-0.0775, -_FAR, 0.0), (-0.0715, _FAR, _FAR)), half_seam)
    seen = {
        "shell": _above_seam(base, skin, half_seam) - _deck(base, 0.0012) - _vents(base),
        "tray": _below_seam(base, skin, -half_seam) + _mounts(dimensions),
        "trim": _dome(base, _FOOT) + _dome(base, _CAP),
        "deck": (set_back ^ _deck(base, 0.0)) - _holes(base),
        "glass": (hull(base, 0.0009) ^ face) + _dome(base, _WINDOW),
        "glow": strip - face + (hull(base, 0.0016) ^ eyes) + _dome(base, _RING),
        "tail_light": hull(base, 0.0008) ^ tail_light,
        "accent": _handle(base) + (hull(base, 0.0004) ^ stripe),
        "rubber": hull(base, base.bumper) ^ bumper,
    }
    inertial = weigh(_hollow(base, seen), dimensions.densities)
    add_ballast(dimensions, inertial)
    return Part("base_link", seen, inertial)


def _hollow(base: SimpleNamespace, seen: dict[str, Manifold]) -> list[tuple[str, Manifold]]:
    """Return walls and motors; where two solids overlap, the later one displaces the earlier."""
    end = base.width / 2 - base.wall
    motors = rod_y(base.motor.radius, 2 * end) - rod_y(_FAR, 2 * (end - base.motor.length))
    bodies = [("motor", motors)]
    space = hull(base, -base.wall) + _dome(base, _INSIDE)
    for name, solid in reversed(seen.items()):
        bodies.append((name, solid - space))
        space += solid
    return bodies


def add_ballast(dimensions: SimpleNamespace, body: Body) -> None:
    """Add a block that gives a body the wanted mass and center of mass.

    Raises OneBotError if its mass would be negative.
    """
    mass = dimensions.base_mass - body.mass
    if mass <= 0:
        raise OneBotError(
            f"the base weighs {body.mass:.3f} kg without ballast, more than {dimensions.base_mass}"
        )
    moment = dimensions.base_mass * np.array(dimensions.base_center_of_mass)
    center = (moment - body.mass * body.center) / mass
    ballast = dimensions.base.ballast
    size = np.array([ballast.length, ballast.width, ballast.height])
    body.add_mass(mass, center, np.diag(mass * (size @ size - size**2) / 12))


def _above_seam(base: SimpleNamespace, solid: Manifold, shift: float) -> Manifold:
    """Cut off everything below the plane ``shift`` meters above the seam's middle."""
    return solid.trim_by_plane((-base.seam_slope, 0.0, 1.0), base.seam_height + shift)


def _below_seam(base: SimpleNamespace, solid: Manifold, shift: float) -> Manifold:
    """Cut off everything above the plane ``shift`` meters above the seam's middle."""
    return solid.trim_by_plane((base.seam_slope, 0.0, -1.0), -base.seam_height - shift)


def _window(width: float, height: float, radius: float, middle: tuple[float, float]) -> Manifold:
    """Return a bar along x with round edges; ``middle``: its y and z."""
    return prism_x(round_rectangle(width, height, radius).translate(middle), 0.0, _FAR)


def _dome(base: SimpleNamespace, profile: Points) -> Manifold:
    """Turn a profile about the sensor's axis."""
    solid = lathe(base.sensor.radius, base.sensor.height, profile, 36)
    return solid.translate((base.sensor.x, 0.0, base.deck))


def _mounts(dimensions: SimpleNamespace) -> Manifold:
    """Return the stubs that carry the wheels and the caster's mount."""
    base, caster = dimensions.base, dimensions.caster
    low = caster.mount_height - dimensions.wheel.radius
    plinth = Manifold.cylinder(0.02 - low, 0.023, 0.027, 40).translate((caster.x, 0.0, low))
    return rod_y(base.axle_radius, base.axle_length) + plinth


def _deck(base: SimpleNamespace, margin: float) -> Manifold:
    """Return the space of the payload plate."""
    shape = round_rectangle(0.165 + 2 * margin, 0.15 + 2 * margin, 0.018 + margin)
    return Manifold.extrude(shape, 0.058).translate((-0.165, 0.0, base.deck - 0.008))


def _holes(base: SimpleNamespace) -> Manifold:
    """Return a grid of threaded holes in the deck."""
    hole = Manifold.cylinder(0.02, 0.0026, circular_segments=8).translate((0, 0, base.deck - 0.004))
    return union(
        hole.translate((-0.165 + x, y, 0.0)) for x in (-0.06, 0.0, 0.06) for y in (-0.05, 0.0, 0.05)
    )


def _vents(base: SimpleNamespace) -> Manifold:
    """Return slanted slots in both sides, behind the wheels."""
    slot = Manifold.cube((0.004, _FAR, 0.022), True).rotate((0.0, 24.0, 0.0))
    slots = [slot.translate((-0.1435 - 0.0095 * index, 0.0, 0.025)) for index in range(6)]
    return union(slots) - hull(base, -0.004)


def _handle(base: SimpleNamespace) -> Manifold:
    """Return the carrying handle, an arch that leans backwards."""
    ball = Manifold.sphere(0.004, 12).scale((2.0, 1.0, 1.0))
    turn = np.linspace(0.0, np.pi, 13)
    across = 0.062 * np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** 0.45
    up = 0.036 * np.sin(turn) ** 0.55 - 0.008
    path = np.column_stack([-0.268 - 0.25 * up, across, base.deck + up])
    joints = [ball.translate(point) for point in path]
    return union(Manifold.batch_hull(pair) for pair in pairwise(joints))
