"""The base: a swept shell in two tones, with bumper, face, sensor dome, deck, handle and lights."""

from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold, OpType
from numpy.typing import NDArray

from onebot_description.cad.dimensions import Base, Dimensions
from onebot_description.cad.primitives import (
    MassProperties,
    Part,
    box,
    cylinder_y,
    lathe,
    loft,
    outline,
    prism_x,
    prism_z,
    rounded_rectangle,
    total,
    tube,
    weigh_all,
    weigh_box,
)
from onebot_description.errors import OneBotError

_SECTION_POINTS = 36
_SECTION_POWER = 5.0  # a superellipse's: 2 is an ellipse, a high power a rectangle
_LEAN = 0.07  # the sides lean inwards, by this share of the half width
# How far from nose and tail the width, the top and the bottom begin to close (m), and how squarely
# they do (the superellipse's power).
_NOSE = {"width": (0.115, 2.5), "top": (0.155, 2.3), "bottom": (0.06, 2.6)}
_TAIL = {"width": (0.085, 2.8), "top": (0.085, 2.5), "bottom": (0.05, 2.4)}
_RAMP = 0.028  # length of the rise from the bottom to the tail's
NOSE_HEIGHT = -0.027  # the foremost point's
TAIL_HEIGHT = 0.031

_FAR = 1.0  # m, beyond all parts, for cuts
_DEPTH = 0.006  # m, of insets in the shell
_HIDDEN = 0.005  # m; anything deeper inside the shell is not drawn
_SENSOR_INSIDE = [(0.0, -0.3), (0.76, -0.3), (0.76, 0.9), (0.0, 0.9)]


def hull(base: Base, grown: float = 0.0) -> Manifold:
    """Return the hull's solid, its skin moved outwards by ``grown`` metres (inwards if < 0)."""
    x = _stations(base.rear - grown, base.front - base.bumper + grown)
    width, bottom, top = _outline(base, x, grown)
    across, up = _section()
    sections = np.empty((len(x), _SECTION_POINTS, 3))
    sections[..., 0] = x[:, None]
    sections[..., 1] = width[:, None] * across
    sections[..., 2] = (top + bottom)[:, None] / 2 + (top - bottom)[:, None] / 2 * up
    return loft(sections)


def is_inside(base: Base, points: NDArray[np.float64], grown: float) -> NDArray[np.bool_]:
    """Return which of the (N, 3) points lie inside ``hull(base, grown)``."""
    x = np.clip(points[:, 0], base.rear - grown, base.front - base.bumper + grown)
    width, bottom, top = _outline(base, x, grown)
    height = np.maximum(top - bottom, 1e-9) / 2
    up = (points[:, 2] - (top + bottom) / 2) / height
    across = points[:, 1] / (np.maximum(width, 1e-9) * (1 - _LEAN * (1 + up) / 2))
    inside = np.abs(across) ** _SECTION_POWER + np.abs(up) ** _SECTION_POWER < 1
    return np.asarray(inside & (x == points[:, 0]))


def _outline(
    base: Base, x: NDArray[np.float64], grown: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return half the width, the bottom and the top at each x."""
    tail, nose = base.rear - grown, base.front - base.bumper + grown
    middle = np.interp(x, [tail, nose], [TAIL_HEIGHT, NOSE_HEIGHT])
    top = middle + (base.deck + grown - middle) * _closing(x, tail, nose, "top")
    floor = _floor(base, x) - grown
    bottom = middle - (middle - floor) * _closing(x, tail, nose, "bottom")
    return (base.width / 2 + grown) * _closing(x, tail, nose, "width"), bottom, top


def _stations(tail: float, nose: float) -> NDArray[np.float64]:
    """Return the positions of the sections along x: dense where the hull closes."""
    turn = np.linspace(0.0, np.pi / 2, 11)
    rear = tail + 0.085 * (1 - np.cos(turn))
    front = nose - 0.155 * (1 - np.cos(np.linspace(0.0, np.pi / 2, 14)))
    between = np.linspace(rear[-1], front[-1], 12)[1:-1]
    return np.concatenate([rear, between, front[::-1]])


def _closing(x: NDArray[np.float64], tail: float, nose: float, what: str) -> NDArray[np.float64]:
    """Return 1 amidships, falling to 0 at either end along a superellipse."""
    length, power = _NOSE[what]
    ahead = np.clip((x - (nose - length)) / length, 0.0, 1.0)
    closing = (1 - ahead**power) ** (1 / power)
    length, power = _TAIL[what]
    behind = np.clip(((tail + length) - x) / length, 0.0, 1.0)
    return np.asarray(closing * (1 - behind**power) ** (1 / power), float)


def _floor(base: Base, x: NDArray[np.float64]) -> NDArray[np.float64]:
    share = np.clip((base.tail_start + _RAMP - x) / _RAMP, 0.0, 1.0)
    return np.asarray(base.bottom + (base.tail_bottom - base.bottom) * share**2 * (3 - 2 * share))


def _section() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the unit section's points: across and up, each reaching from -1 to 1."""
    angle = np.linspace(0.0, 2 * np.pi, _SECTION_POINTS, endpoint=False)
    power = 2 / _SECTION_POWER
    across = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** power
    up = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power
    across = across * (1 - _LEAN * (1 + up) / 2)
    return across / np.abs(across).max(), up


def solve_ballast(dimensions: Dimensions, rest: MassProperties, room: Manifold) -> MassProperties:
    """Return the ballast that, with the ``rest``, has the wanted mass and centre of mass.

    Raises OneBotError if its mass would be negative, or it would stick out of the ``room`` inside
    the hull.
    """
    mass = dimensions.base_mass - rest.mass
    if mass <= 0:
        raise OneBotError(
            f"the base weighs {rest.mass:.3f} kg without ballast, more than {dimensions.base_mass}"
        )
    moment = dimensions.base_mass * np.array(dimensions.base_center_of_mass)
    center = (moment - rest.mass * rest.center) / mass
    block = dimensions.base.ballast
    size = (block.length, block.width, block.height)
    low, high = center - np.array(size) / 2, center + np.array(size) / 2
    outside = (box(tuple(low), tuple(high)) - room).volume() / float(np.prod(size))
    if outside > 1e-6:
        position = ", ".join(f"{value:.4f}" for value in center)
        raise OneBotError(
            f"the ballast, at ({position}) m, sticks out of the hull by {outside:.1%}"
        )
    return weigh_box(mass, center, size)


def make_base(dimensions: Dimensions) -> Part:
    """Return the part "base_link"."""
    base = dimensions.base
    skin = hull(base)
    seen = (
        ("shell", _shell(base, skin)),
        ("tray", _tray(dimensions, skin)),
        ("trim", _sensor_body(base)),
        ("deck", _deck(base)),
        ("glass", _face(base) + _sensor_window(base)),
        ("glow", _strip(base) + _eyes(base) + _sensor_ring(base)),
        ("tail_light", _tail_light(base)),
        ("accent", _handle(base) + _stripe(base)),
        ("rubber", _bumper(base)),
    )
    bodies = weigh_all([*_walls(base, seen), *_motors(base)], dimensions.densities)
    ballast = solve_ballast(dimensions, bodies, hull(base, -base.wall))
    inertial = total([bodies, ballast])
    return Part("base_link", seen, inertial, lambda points: is_inside(base, points, -_HIDDEN))


def _walls(base: Base, seen: Sequence[tuple[str, Manifold]]) -> list[tuple[str, Manifold]]:
    """Hollow the solids; where two overlap, the later one displaces the earlier."""
    walls = []
    space = hull(base, -base.wall) + _sensor(base, _SENSOR_INSIDE)
    for name, solid in reversed(seen):
        walls.append((name, solid - space))
        space += solid
    return walls


def _motors(base: Base) -> list[tuple[str, Manifold]]:
    end = base.width / 2 - base.wall
    left = cylinder_y(base.motor.radius, end - base.motor.length, end)
    return [("motor", left), ("motor", left.mirror((0.0, 1.0, 0.0)))]


def _above_seam(base: Base, solid: Manifold, shift: float) -> Manifold:
    """Cut off what is below the seam's plane, ``shift`` metres higher than its middle."""
    return solid.trim_by_plane((-base.seam_slope, 0.0, 1.0), base.seam_height + shift)


def _below_seam(base: Base, solid: Manifold, shift: float) -> Manifold:
    """Cut off what is above the seam's plane, ``shift`` metres higher than its middle."""
    return solid.trim_by_plane((base.seam_slope, 0.0, -1.0), -base.seam_height - shift)


def _shell(base: Base, skin: Manifold) -> Manifold:
    upper = _above_seam(base, skin, base.seam_width / 2)
    return upper - _deck_cut(base, 0.0012) - _vents(base)


def _tray(dimensions: Dimensions, skin: Manifold) -> Manifold:
    """The hull's lower half, with the stubs that carry the wheels and the caster's mount."""
    base = dimensions.base
    axle = cylinder_y(base.axle_radius, -base.axle_length / 2, base.axle_length / 2)
    mount = dimensions.caster.mount_height - dimensions.wheel.radius
    plinth = lathe([(0.0, mount), (0.023, mount), (0.027, 0.02), (0.0, 0.02)], 40)
    place = (dimensions.caster.x, 0.0, 0.0)
    return _below_seam(base, skin, -base.seam_width / 2) + axle + plinth.translate(place)


def _strip(base: Base) -> Manifold:
    """The light strip around the hull, set back in the seam between the shell's halves."""
    band = _above_seam(base, hull(base, -0.0012), -base.seam_width / 2)
    return _below_seam(base, band, base.seam_width / 2)


def _deck_cut(base: Base, margin: float) -> Manifold:
    shape = rounded_rectangle(0.165 + 2 * margin, 0.15 + 2 * margin, 0.018 + margin, 4)
    return prism_z(shape, base.deck - 0.008, base.deck + 0.05, (-0.165, 0.0))


def _deck(base: Base) -> Manifold:
    """The plate for payloads, with a grid of threaded holes."""
    plate = hull(base, -0.0012) ^ _deck_cut(base, 0.0)
    hole = Manifold.cylinder(0.02, 0.0026, circular_segments=8).translate((0, 0, base.deck - 0.004))
    holes = [
        hole.translate((-0.165 + x, y, 0.0)) for x in (-0.06, 0.0, 0.06) for y in (-0.05, 0.0, 0.05)
    ]
    return plate - Manifold.compose(holes)


def _vents(base: Base) -> Manifold:
    """Slanted slots in both sides, behind the wheels."""
    slanted = outline([(0.0, 0.0), (0.004, 0.0), (0.013, 0.02), (0.009, 0.02)])
    slot = Manifold.extrude(slanted, 2 * _FAR).rotate((90.0, 0.0, 0.0)).translate((0, _FAR, 0))
    inside = hull(base, -0.004)
    slots = [slot.translate((-0.15 - 0.0095 * index, 0.0, 0.015)) for index in range(6)]
    return Manifold.compose(slots) - inside


def _face(base: Base) -> Manifold:
    """The dark window of the sensor."""
    shape = rounded_rectangle(0.15, 0.034, 0.0165, 6)
    window = prism_x(shape, 0.0, _FAR, (0.0, 0.008))
    return (hull(base, 0.0009) ^ window) - hull(base, -_DEPTH)


def _eyes(base: Base) -> Manifold:
    shape = rounded_rectangle(0.013, 0.019, 0.006, 3)
    eyes = [prism_x(shape, 0.0, _FAR, (y, 0.009)) for y in (-0.03, 0.03)]
    return (hull(base, 0.0016) ^ (eyes[0] + eyes[1])) - hull(base, -_DEPTH)


def _bumper(base: Base) -> Manifold:
    low, high = -0.038, -0.017
    front = hull(base, base.bumper) ^ box((0.012, -_FAR, low), (_FAR, _FAR, high))
    return front - hull(base, -_DEPTH)


def _tail_light(base: Base) -> Manifold:
    window = prism_x(rounded_rectangle(0.11, 0.006, 0.0029, 3), -_FAR, -0.25, (0.0, 0.041))
    return (hull(base, 0.0008) ^ window) - hull(base, -_DEPTH)


def _stripe(base: Base) -> Manifold:
    """A coloured line across the shell, ahead of the sensor."""
    band = box((-0.0775, -_FAR, 0.0), (-0.0715, _FAR, _FAR))
    upper = _above_seam(base, hull(base, 0.0004), base.seam_width / 2)
    return (upper ^ band) - hull(base, -_DEPTH)


def _handle(base: Base) -> Manifold:
    """A handle to carry the robot."""
    turn = np.linspace(0.0, np.pi, 13)
    across = 0.062 * np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** 0.45
    up = base.deck - 0.008 + 0.036 * np.sin(turn) ** 0.55
    path = np.column_stack([-0.268 - 0.25 * (up - base.deck), across, up])
    return tube(path, (1.0, 0.0, 0.0), 0.016, 0.008)


def _sensor(base: Base, profile: list[tuple[float, float]]) -> Manifold:
    """Turn a profile of (radius as a share, height as a share) about the sensor's axis."""
    sensor = base.sensor
    points = [(radius * sensor.radius, height * sensor.height) for radius, height in profile]
    return lathe(points, 36).translate((sensor.x, 0.0, base.deck))


def _sensor_body(base: Base) -> Manifold:
    foot = [(0.0, -0.2), (1.0, -0.2), (1.0, 0.16), (0.94, 0.24), (0.0, 0.24)]
    cap = [(0.0, 0.68), (0.9, 0.68), (0.9, 0.82), (0.84, 0.93), (0.7, 0.985), (0.5, 1.0), (0, 1.0)]
    return Manifold.batch_boolean([_sensor(base, foot), _sensor(base, cap)], OpType.Add)


def _sensor_window(base: Base) -> Manifold:
    return _sensor(base, [(0.0, 0.24), (0.84, 0.24), (0.84, 0.68), (0.0, 0.68)])


def _sensor_ring(base: Base) -> Manifold:
    return _sensor(base, [(0.70, 0.26), (0.87, 0.26), (0.87, 0.32), (0.70, 0.32)])
