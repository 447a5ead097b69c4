"""Writing a part as Collada that every reader used here can read, with colours.

Metres, z up, triangles only, one geometry a material, and for each material a symbol equal to its
id (some readers find the colour by the one, some by the other). Equal parts give equal bytes: there
is no date in it that changes.
"""

import datetime
import io
import math
from collections.abc import Callable

import collada
import numpy as np
import trimesh
from collada.material import Effect, Material
from collada.scene import GeometryNode, MaterialNode, Node, Scene
from collada.source import FloatSource, InputList
from manifold3d import Manifold
from numpy.typing import NDArray

from onebot_description.arrays import Floats
from onebot_description.cad.primitives import Part, to_mesh
from onebot_description.geometry.poses import Triple

_EDGE = math.radians(38.0)  # surfaces are shaded smoothly up to this angle between faces
_TOLERANCE = 1e-4  # m, that a surface may move when points are removed
_MIN_AREA = 5e-12  # m2; smaller triangles are numerical errors
_LENGTH_DIGITS = 5  # 0.01 mm
_NORMAL_DIGITS = 3
_DATE = datetime.datetime(2025, 1, 1, tzinfo=datetime.timezone.utc)


def corner_normals(mesh: trimesh.Trimesh, edge: float) -> Floats:
    """Return a normal for each corner of each face, (F, 3, 3), of unit length.

    A corner's normal is the mean, weighted by angle, of the normals of those faces around the point
    that differ from the corner's own by less than ``edge``, rad.
    """
    result = np.empty((*mesh.faces.shape, 3))
    for point in range(len(mesh.vertices)):
        at_face, at_corner = np.nonzero(mesh.faces == point)
        around = mesh.face_normals[at_face]
        near = (around @ around.T > np.cos(edge)).astype(float)
        mean = near @ (around * mesh.face_angles[at_face, at_corner][:, None])
        result[at_face, at_corner] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    return result


def to_collada(part: Part, colors: dict[str, Triple]) -> bytes:
    """Return the file's content; colors are sRGB, 0 to 1, by material."""
    document = collada.Collada()
    document.assetInfo.created = document.assetInfo.modified = _DATE
    document.assetInfo.unitmeter, document.assetInfo.unitname = 1.0, "meter"
    document.assetInfo.upaxis = collada.asset.UP_AXIS.Z_UP
    nodes = []
    for name, solid in part.seen:
        material = _material(document, name, colors[name])
        geometry = _geometry(document, f"{part.name}-{name}", name, *_skin(solid, part.hidden))
        link = MaterialNode(name, material, inputs=[])
        nodes.append(Node(f"{geometry.id}-node", [GeometryNode(geometry, [link])]))
    document.scene = Scene(part.name, nodes)
    document.scenes.append(document.scene)
    buffer = io.BytesIO()
    document.write(buffer)
    return buffer.getvalue()


def _material(document: collada.Collada, name: str, color: Triple) -> Material:
    gloss = 0.25 if name in ("glass", "metal", "shell") else 0.05
    effect = Effect(
        f"{name}-effect",
        [],
        "phong",
        diffuse=(*color, 1.0),
        ambient=(0.0, 0.0, 0.0, 1.0),
        specular=(gloss, gloss, gloss, 1.0),
        shininess=30.0,
    )
    material = Material(name, name, effect)
    document.effects.append(effect)
    document.materials.append(material)
    return material


def _geometry(
    document: collada.Collada,
    identifier: str,
    material: str,
    points: Floats,
    normals: Floats,
    corners: NDArray[np.int64],
) -> collada.geometry.Geometry:
    sources = [
        FloatSource(f"{identifier}-points", points, ("X", "Y", "Z")),
        FloatSource(f"{identifier}-normals", normals, ("X", "Y", "Z")),
    ]
    geometry = collada.geometry.Geometry(document, identifier, identifier, sources)
    inputs = InputList()
    inputs.addInput(0, "VERTEX", f"#{identifier}-points")
    inputs.addInput(1, "NORMAL", f"#{identifier}-normals")
    geometry.primitives.append(geometry.createTriangleSet(corners, inputs, material))
    document.geometries.append(geometry)
    return geometry


def _skin(
    solid: Manifold, hidden: Callable[[Floats], NDArray[np.bool_]] | None
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return points, normals, and for each corner of each triangle a pair of indices into them."""
    mesh = to_mesh(solid.simplify(_TOLERANCE))
    rounded = np.round(mesh.vertices, _LENGTH_DIGITS) + 0.0
    points, index = np.unique(rounded, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    mesh = trimesh.Trimesh(points, faces, process=False)
    mesh.update_faces(mesh.area_faces > _MIN_AREA)
    faces, normals = mesh.faces, corner_normals(mesh, _EDGE)
    if hidden is not None:
        visible = ~hidden(points)[faces].all(axis=1)
        faces, normals = faces[visible], normals[visible]
    used, index = np.unique(faces, return_inverse=True)
    directions, pointer = np.unique(
        np.round(normals.reshape(-1, 3), _NORMAL_DIGITS) + 0.0, axis=0, return_inverse=True
    )
    pairs = np.stack([index.reshape(-1), pointer.reshape(-1)], axis=-1)
    return points[used], directions, pairs.reshape(-1)
