"""Warns about wrong units, mostly millimeters, by the sizes of a robot's shapes."""

import math
from collections.abc import Iterator, Mapping

from onebot_description.elements.meshes import look_warnings, mesh_scene
from onebot_description.elements.urdf import Description, Mesh, Shape
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import ZERO, Triple

# m; no larger robot is known. A description without moving joints may be a world.
LARGEST_ROBOT = 20.0
_LARGEST_WORLD = 200.0
MILLIMETERS = 100.0  # m; larger lengths are in millimeters, smaller ones may be in centimeters
_TIMES = 100.0  # a shape may be larger than most others by this factor


def shape_sizes(description: Description) -> tuple[dict[Shape, Triple], list[str], list[str]]:
    """Measure the shapes of a robot; meshes are opened.

    Returns:
        Side lengths of each shape along its axes, m, without unreadable meshes; a message for each
        unreadable mesh; and a warning for each missing texture or material file of a visual's mesh.
    """
    sizes: dict[Shape, Triple] = {}
    faults: dict[str, str] = {}  # key: what is wrong
    warnings: dict[str, None] = {}
    for link in description.links:
        for number, part in enumerate((*link.visuals, *link.collisions)):
            shape = part.shape
            is_missing = isinstance(shape, Mesh) and shape.path is None  # already a problem
            if shape not in sizes and not is_missing:
                try:
                    if isinstance(shape, Mesh):
                        scene = mesh_scene(shape)
                        if number < len(link.visuals):
                            warnings.update(dict.fromkeys(look_warnings(scene)))
                        x, y, z = abs(scene.extents * shape.scale).tolist()
                        sizes[shape] = x, y, z
                    else:
                        sizes[shape] = shape.size
                except OneBotError as error:
                    text = f'{part.where}: link "{link.name}": mesh {error}'
                    faults.setdefault(str(error), text)
    return sizes, list(faults.values()), list(warnings)


def size_warnings(description: Description, sizes: Mapping[Shape, Triple]) -> list[str]:
    """Return a warning for each shape and joint origin that is probably not in meters."""
    largest = LARGEST_ROBOT if description.moving_joints else _LARGEST_WORLD
    return [*_large_shapes(description, sizes, largest), *_far_joints(description, largest)]


def _large_shapes(
    description: Description, sizes: Mapping[Shape, Triple], largest: float
) -> Iterator[str]:
    usual = _usual(sizes)
    reported: set[Shape] = set()
    for link in description.links:
        for part in (*link.visuals, *link.collisions):
            size, kind = sizes.get(part.shape, ZERO), type(part.shape).__name__.lower()
            length = max(size)
            if part.shape in reported or length <= min(largest, _TIMES * usual):
                continue
            reported.add(part.shape)
            sides = " x ".join(f"{side:.4g}" for side in size)
            excess = "" if length > largest else f", over {_TIMES:g} times the other shapes"
            factor = "0.001" if length >= MILLIMETERS else "0.01"
            scale = f'write scale="{factor} {factor} {factor}"'
            remedy = scale if isinstance(part.shape, Mesh) else "lengths are in m"
            yield (
                f'{part.where}: link "{link.name}": its {kind} is {sides} m large{excess}; is it '
                f"in {unit_of(length)}? {remedy}"
            )


def _usual(sizes: Mapping[Shape, Triple]) -> float:
    """Return the size, m, of the largest shape of usual size; infinite if no shape stands out."""
    lengths = sorted(length for length in map(max, sizes.values()) if length > 0.0)
    for row, (below, above) in enumerate(zip(lengths, lengths[1:], strict=False), 1):
        if above > _TIMES * below and 2 * row > len(lengths):
            return below
    return math.inf


def _far_joints(description: Description, largest: float) -> Iterator[str]:
    for joint in description.joints:
        away = math.hypot(*joint.origin.xyz)
        if away > largest:
            yield (
                f'{joint.where}: joint "{joint.name}": its <origin> is {away:.4g} m away; is it in '
                f"{unit_of(away)}? lengths are in m"
            )


def unit_of(length: float) -> str:
    """Return the probable unit of a length (m) that is too large."""
    return "millimeters" if length >= MILLIMETERS else "centimeters or millimeters"
