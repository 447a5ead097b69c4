"""Draws each type of marker: columns of Rerun's archetypes for many markers at once.

All markers of one type lie on one entity, as arrays. Where Rerun has no counterpart, they look
similar: points are round, arrowheads have the size that fits their shaft, and letters have the same
size on the screen at any distance.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.columns import ColumnMaker, ReadyColumn, one_row, ready
from onebot_bringup.viewer.core.robot_shapes import file_state
from onebot_description.arrays import Floats
from onebot_description.elements.meshes import locate_mesh
from onebot_description.elements.packages import Resources
from onebot_description.geometry.quaternions import rotate

# A column, or a function that makes it from numbers, called only if the numbers have changed.
Piece: TypeAlias = "ReadyColumn | tuple[Callable[[NDArray[Any]], ReadyColumn], NDArray[Any]]"

ARROW, CUBE, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST, CUBE_LIST, SPHERE_LIST = range(8)
POINTS, TEXT, MESH, TRIANGLE_LIST, ARROW_STRIP = range(8, 13)


class MarkerContent(NamedTuple):
    """The content of a marker besides pose, scale and color."""

    points: Floats  # (N, 3) meters, in the marker's own frame
    colors: Floats  # (N, 4), or (0, 4) if all points have the marker's color
    pairs: bool  # each two points are the ends of a separate line
    text: str


Rows = NDArray[np.intp] | slice


class Batch(NamedTuple):
    """Markers of one type, one per row; or the shapes that they are drawn as."""

    poses: Floats  # (N, 7) meters and x y z w
    scales: Floats  # (N, 3)
    colors: Floats  # (N, 4), 0 to 1
    ends: NDArray[np.int64]  # when its lifetime is over, nanoseconds
    parts: NDArray[np.object_]  # a MarkerContent for markers with points or text, else None

    def at(self, rows: Rows) -> "Batch":
        """Return some of the markers."""
        columns: Any = self
        return Batch(*(column[rows] for column in columns))

    def joined(self, other: "Batch") -> "Batch":
        """Return these markers followed by others."""
        pairs: Any = zip(self, other, strict=True)
        return Batch(*map(np.concatenate, pairs))

    @property
    def counts(self) -> NDArray[np.intp]:
        """The number of points of each marker."""
        return np.array([len(part.points) for part in self.parts], np.intp)

    def vertices(self, *, scaled: bool = False) -> "Batch":
        """Return each point of each marker as one shape at its place.

        Ends and parts stay the markers'.

        Args:
            scaled: scale the points with their marker.
        """
        rows = np.repeat(np.arange(len(self.poses)), self.counts)
        points = np.concatenate([part.points for part in self.parts])
        turns, scales, colors = self.poses[rows, 3:], self.scales[rows], self.colors[rows]
        places = rotate(turns, points * scales if scaled else points) + self.poses[rows, :3]
        point_colors = np.concatenate(
            [
                part.colors if len(part.colors) else np.full((len(part.points), 4), np.nan)
                for part in self.parts
            ]
        )
        colors = np.where(np.isnan(point_colors), colors, point_colors)
        return self._replace(poses=np.hstack([places, turns]), scales=scales, colors=colors)


Draw = Callable[[Batch], Sequence[Piece]]


def rgba(colors: Floats) -> NDArray[np.uint32]:
    """Convert (N, 4) numbers from 0 to 1 to Rerun's colors, whose bytes the screen shows as is."""
    channels = np.rint(np.clip(colors, 0.0, 1.0) * 255).astype(np.uint8)
    return channels.view(">u4").astype(np.uint32).ravel()


def _in_color(archetype: Any) -> Callable[[NDArray[Any]], ReadyColumn]:
    maker = ColumnMaker(archetype.columns(colors=[0]))
    return lambda colors: maker.row(rgba(colors))


# --- shapes that are drawn as instances of one shape ----------------------------------------------

_POSES = rr.InstancePoses3D
_TRANSLATIONS = ColumnMaker(_POSES.columns(translations=np.zeros((1, 3)))).row
_QUATERNIONS = ColumnMaker(_POSES.columns(quaternions=np.zeros((1, 4)))).row
_SCALES = ColumnMaker(_POSES.columns(scales=np.zeros((1, 3)))).row


def _poses(shapes: Batch) -> Sequence[Piece]:
    places, turns = shapes.poses[:, :3], shapes.poses[:, 3:]
    return [(_TRANSLATIONS, places), (_QUATERNIONS, turns), (_SCALES, shapes.scales)]


def _solid(archetype: Any, **sizes: Any) -> Draw:
    """Return a function that draws scaled instances of a shape with a size of one meter."""
    unit = one_row(archetype.from_fields(fill_mode=rr.components.FillMode.Solid, **sizes))
    color = _in_color(archetype)
    return lambda shapes: [*unit, *_poses(shapes), (color, shapes.colors)]


_cubes = _solid(rr.Boxes3D, half_sizes=[[0.5] * 3])
_spheres = _solid(rr.Ellipsoids3D, half_sizes=[[0.5] * 3])
_cylinders = _solid(rr.Cylinders3D, lengths=[1.0], radii=[0.5])

# --- arrows ---------------------------------------------------------------------------------------

_ORIGINS = ColumnMaker(rr.Arrows3D.columns(origins=np.zeros((1, 3)))).row
_VECTORS = ColumnMaker(rr.Arrows3D.columns(vectors=np.zeros((1, 3)))).row
_SHAFTS = ColumnMaker(rr.Arrows3D.columns(radii=[0.0])).row
_ARROW_COLORS = _in_color(rr.Arrows3D)


def _arrows(starts: Floats, ways: Floats, widths: Floats, colors: Floats) -> Sequence[Piece]:
    shafts = (_SHAFTS, widths / 2)
    return [(_ORIGINS, starts), (_VECTORS, ways), shafts, (_ARROW_COLORS, colors)]


def _arrows_along_x(shapes: Batch) -> Sequence[Piece]:
    along = np.zeros((len(shapes.poses), 3))
    along[:, 0] = shapes.scales[:, 0]
    ways = rotate(shapes.poses[:, 3:], along)
    return _arrows(shapes.poses[:, :3], ways, shapes.scales[:, 1], shapes.colors)


def _arrows_of_points(batch: Batch) -> Sequence[Piece]:
    corners = batch.vertices()
    begins = _segments(batch.counts)
    places = corners.poses[:, :3]
    ways = places[begins + 1] - places[begins]
    return _arrows(places[begins], ways, corners.scales[begins, 0], corners.colors[begins])


def _segments(counts: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the indexes of all markers' points that are not the last of their marker."""
    last = np.zeros(counts.sum(), bool)
    last[np.cumsum(counts[counts > 0]) - 1] = True
    return np.flatnonzero(~last)


# --- lines ----------------------------------------------------------------------------------------

[_STRIP_COLUMN] = ready(rr.LineStrips3D.columns(strips=[np.zeros((2, 3))]))
_STRIP = _STRIP_COLUMN.as_arrow_array().type.value_type
_WIDTHS = ColumnMaker(rr.LineStrips3D.columns(radii=[0.0])).row
_LINE_COLORS = _in_color(rr.LineStrips3D)


def _lines(batch: Batch) -> Sequence[Piece]:
    """Draw lines; a strip whose points have colors is split, since Rerun's have one color."""
    corners = batch.vertices()
    points: list[NDArray[np.intp]] = []  # indexes of points, an array for each line
    lengths: list[NDArray[np.intp]] = []
    at = 0
    for part in batch.parts:
        count = len(part.points)
        if part.pairs:
            chosen, length = np.arange(at, at + count - count % 2), 2
        elif len(part.colors):
            chosen, length = np.repeat(np.arange(at, at + count), 2)[1:-1], 2
        else:
            chosen, length = np.arange(at, at + count), max(count, 1)
        points.append(chosen)
        lengths.append(np.full(len(chosen) // length, length))
        at += count
    chosen, counts = np.concatenate(points), np.concatenate(lengths)
    if not len(chosen):
        return []
    ends = np.cumsum(counts)
    first, final = chosen[ends - counts], chosen[ends - 1]
    colors = (corners.colors[first] + corners.colors[final]) / 2
    widths = corners.scales[first, 0] / 2
    strips = _strips(corners.poses[chosen, :3], ends)
    return [strips, (_WIDTHS, widths), (_LINE_COLORS, colors)]


def _strips(points: Floats, ends: NDArray[np.intp]) -> ReadyColumn:
    """Return a row of line strips, from their points and the number of points up to each end."""
    numbers = pa.array(points.astype(np.float32).ravel())
    places = pa.FixedSizeListArray.from_arrays(numbers, type=_STRIP.value_type)
    offsets = pa.array([0, *ends.tolist()], pa.int32())
    strips = pa.ListArray.from_arrays(offsets, places, type=_STRIP)
    row = pa.ListArray.from_arrays(pa.array([0, len(ends)], pa.int32()), strips)
    return ReadyColumn(_STRIP_COLUMN.component_descriptor(), row)


# --- the others -----------------------------------------------------------------------------------


def _points(batch: Batch) -> Sequence[Piece]:
    points = batch.vertices()
    return one_row(
        rr.Points3D.from_fields(
            positions=points.poses[:, :3],
            radii=points.scales[:, 0] / 2,
            colors=rgba(points.colors),
        )
    )


def _texts(batch: Batch) -> Sequence[Piece]:
    return one_row(
        rr.Points3D.from_fields(
            positions=batch.poses[:, :3],
            radii=[0.0],
            colors=rgba(batch.colors),
            labels=[part.text for part in batch.parts],
            show_labels=True,
        )
    )


def _triangles(batch: Batch) -> Sequence[Piece]:
    """Draw triangles with one opacity, since Rerun ignores the opacity of vertices."""
    corners = batch.vertices(scaled=True)
    opaque = corners.colors.copy()
    opaque[:, 3] = 1.0
    factor = (255, 255, 255, int(rgba(corners.colors[:1])[0]) & 255)
    return one_row(
        rr.Mesh3D.from_fields(
            vertex_positions=corners.poses[:, :3],
            triangle_indices=np.arange(len(opaque)).reshape(-1, 3),
            vertex_colors=rgba(opaque),
            albedo_factor=factor,
        )
    )


class MeshVariant(NamedTuple):
    """The properties that all meshes of one entity have in common."""

    uri: str
    color: int | None  # Rerun's number; None for the file's own colors

    def pieces(self) -> Sequence[Piece]:
        """Return the columns of the mesh itself."""
        from onebot_bringup.viewer.core.glb import load_mesh  # imports trimesh

        mesh = locate_mesh(Resources(None), self.uri)
        asset = load_mesh(mesh, file_state(mesh))
        color = self.color if self.color is not None or asset.colored else 0xFFFFFFFF
        return one_row(
            rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=color)
        )


# --- all ------------------------------------------------------------------------------------------


class MarkerKind(NamedTuple):
    """How a type of marker is drawn."""

    name: str  # name of the entity
    draw: Draw
    min_points: int = 0  # 0 if it has none
    of_scale: Sequence[int] = (0, 1, 2)  # components of the scale that must not be zero

    def pieces(self, batch: Batch) -> Sequence[Piece]:
        """Return the columns of markers; none if there is nothing to draw."""
        return self.draw(batch) if not self.min_points or batch.counts.any() else []


KINDS: Mapping[int, MarkerKind] = {
    ARROW: MarkerKind("arrows", _arrows_along_x),
    CUBE: MarkerKind("cubes", _cubes),
    SPHERE: MarkerKind("spheres", _spheres),
    CYLINDER: MarkerKind("cylinders", _cylinders),
    LINE_STRIP: MarkerKind("lines", _lines, 2, (0,)),
    LINE_LIST: MarkerKind("lines", _lines, 2, (0,)),
    CUBE_LIST: MarkerKind("cube_lists", lambda batch: _cubes(batch.vertices()), 1),
    SPHERE_LIST: MarkerKind("sphere_lists", _points, 1),
    POINTS: MarkerKind("points", _points, 1, (0, 1)),
    TEXT: MarkerKind("texts", _texts, 0, (2,)),
    MESH: MarkerKind("meshes", _poses),
    TRIANGLE_LIST: MarkerKind("triangles", _triangles, 3),
    ARROW_STRIP: MarkerKind("arrow_strips", _arrows_of_points, 2, (0,)),
}
"""The types of markers; an arrow with points counts as ARROW_STRIP, since RViz draws both alike."""
