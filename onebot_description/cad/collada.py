"""Writes a part as Collada, with colors, for every reader used here.

The file is in meters with z up, and has triangles only, one geometry per material. The symbol of
each material equals its id, because readers find the color by either. Equal parts give equal
bytes: the date is fixed.
"""

import datetime
import io
import math
from types import SimpleNamespace

import collada
import numpy as np
import trimesh
from collada.material import Effect, Material
from collada.scene import GeometryNode, MaterialNode, Node, Scene
from collada.source import FloatSource, InputList
from manifold3d import Manifold

from onebot_description.cad.solids import Part, skin

_EDGE = math.radians(38.0)  # surfaces are shaded smoothly up to this angle between faces
_TOLERANCE = 1e-4  # m; a surface may move this far when points are removed
_MIN_HEIGHT = 1e-5  # m; flatter triangles are numerical errors
_LENGTH_DIGITS = 5  # 0.01 mm
_NORMAL_DIGITS = 3
_DATE = datetime.datetime(2025, 1, 1, tzinfo=datetime.timezone.utc)


def to_collada(part: Part, colors: SimpleNamespace) -> bytes:
    """Return the file's content."""
    document = collada.Collada()
    document.assetInfo.created = document.assetInfo.modified = _DATE
    document.assetInfo.unitmeter, document.assetInfo.unitname = 1.0, "meter"
    document.assetInfo.upaxis = collada.asset.UP_AXIS.Z_UP
    nodes = []
    for name, solid in part.seen.items():
        gloss = 0.25 if name in ("glass", "metal", "shell") else 0.05
        effect = Effect(
            f"{name}-effect",
            [],
            "phong",
            diffuse=(*getattr(colors, name), 1.0),
            specular=(gloss, gloss, gloss, 1.0),
            shininess=30.0,
        )
        document.effects.append(effect)
        material = Material(name, name, effect)
        document.materials.append(material)
        geometry = _geometry(document, f"{part.name}-{name}", name, solid)
        document.geometries.append(geometry)
        link = MaterialNode(name, material, inputs=[])
        nodes.append(Node(f"{geometry.id}-node", [GeometryNode(geometry, [link])]))
    document.scene = Scene(part.name, nodes)
    document.scenes.append(document.scene)
    buffer = io.BytesIO()
    document.write(buffer)
    return buffer.getvalue()


def _geometry(
    document: collada.Collada, identifier: str, material: str, solid: Manifold
) -> collada.geometry.Geometry:
    mesh = skin(solid.simplify(_TOLERANCE))
    mesh.vertices = np.round(mesh.vertices, _LENGTH_DIGITS) + 0.0
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces(_MIN_HEIGHT))
    mesh = trimesh.graph.smooth_shade(mesh, _EDGE, facet_minarea=None)
    normals = np.round(mesh.vertex_normals, _NORMAL_DIGITS) + 0.0
    sources = [
        FloatSource(f"{identifier}-points", mesh.vertices, ("X", "Y", "Z")),
        FloatSource(f"{identifier}-normals", normals, ("X", "Y", "Z")),
    ]
    inputs = InputList()
    inputs.addInput(0, "VERTEX", f"#{identifier}-points")
    inputs.addInput(0, "NORMAL", f"#{identifier}-normals")
    geometry = collada.geometry.Geometry(document, identifier, identifier, sources)
    geometry.primitives.append(geometry.createTriangleSet(mesh.faces.flatten(), inputs, material))
    return geometry
