"""Converts meshes to GLB, which every Rerun viewer reads, so that they look as in RViz.

yourdfpy makes a trimesh scene of each mesh (see ``meshes``). This module adds what RViz shows and
yourdfpy leaves out:

- round faces and sharp edges where a file has no normals
- whether a file has its own colors, converted to glTF's linear light

trimesh takes a second to import, so modules import this one only to draw a shape.
"""

import functools
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from onebot_description.elements.meshes import (
    GLTF_SUFFIXES,
    has_colors,
    look_warnings,
    mesh_scene,
)
from onebot_description.elements.urdf import Mesh
from onebot_description.errors import OneBotError

# Meshes with more faces are shaded flat, since finding their sharp edges would take seconds.
_MAX_FACES_TO_SMOOTH = 200_000


class MeshAsset(NamedTuple):
    """A mesh ready to be logged."""

    glb: bytes  # binary glTF
    bounds: NDArray[np.float64]  # (2, 3), minimum and maximum corner, m
    colored: bool  # has its own colors, which override the URDF's, as in RViz
    warnings: tuple[str, ...] = ()  # a sentence for each missing file that affects its look


@functools.lru_cache(maxsize=256)
def load_mesh(mesh: Mesh, file: tuple[Path, int, int]) -> MeshAsset:
    """Return a mesh for Rerun.

    Args:
        mesh: the mesh.
        file: its file, with what changes if the file does.

    Raises:
        OneBotError: it cannot be read, or has no surface.
    """
    path, *_ = file
    suffix = path.suffix.lower()
    try:
        scene = mesh_scene(mesh)
    except OneBotError as error:
        raise OneBotError(f"mesh {error}") from error
    warnings = tuple(look_warnings(scene))
    if mesh.scale != (1.0, 1.0, 1.0):
        scene = scene.scaled(np.array(mesh.scale))
    colored = has_colors(path, scene)
    if _lacks_normals(path, suffix):
        scene = _with_normals(scene)
    asset = _asset(scene, colored, linear=suffix in GLTF_SUFFIXES)
    return asset._replace(warnings=warnings)


def _asset(scene: trimesh.Scene, colored: bool, *, linear: bool) -> MeshAsset:
    for part in scene.geometry.values():
        if isinstance(part, trimesh.Trimesh):
            # Vertex colors, such as Blender writes into Collada, would become an attribute
            # "_color", and Rerun shows nothing of a glTF with unknown attributes.
            part.vertex_attributes.clear()
    # glTF's colors are in linear light, the other formats' in sRGB.
    adjust = None if linear else _adjust_colors
    glb = scene.export(file_type="glb", include_normals=True, tree_postprocessor=adjust)
    return MeshAsset(bytes(glb), np.asarray(scene.bounds, float), colored)


def _with_normals(scene: trimesh.Scene) -> trimesh.Scene:
    """Give meshes without vertex normals round faces and sharp edges."""
    shaded = trimesh.Scene()
    for part in scene.dump():
        few = len(part.faces) <= _MAX_FACES_TO_SMOOTH
        shaded.add_geometry(_shade(part) if few and not _is_textured(part) else _flat(part))
    return shaded


def _is_textured(mesh: trimesh.Trimesh) -> bool:
    return mesh.visual.kind == "texture" and mesh.visual.uv is not None


def _lacks_normals(path: Path, suffix: str) -> bool:
    if suffix == ".stl":  # it has only one normal per face
        return True
    pattern = {".obj": rb"^vn\s", ".dae": rb"semantic=[\"']NORMAL"}.get(suffix)
    return pattern is not None and not re.search(pattern, path.read_bytes(), re.MULTILINE)


def _shade(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Split ``mesh`` at edges sharper than 30 degrees, so that only round parts look round."""
    joined = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    joined.merge_vertices()
    smooth: trimesh.Trimesh = trimesh.graph.smooth_shade(joined, angle=np.radians(30.0))
    if mesh.visual.kind == "texture":
        smooth.visual = trimesh.visual.TextureVisuals(material=mesh.visual.material)
    elif mesh.visual.defined:  # the split has reordered vertices and faces
        return _flat(mesh)
    return smooth


def _flat(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    flat = mesh.copy()
    flat.unmerge_vertices()
    flat.vertex_normals = np.repeat(flat.face_normals, 3, axis=0)
    return flat


def _adjust_colors(tree: dict[str, Any]) -> None:
    """Convert the sRGB colors of ``tree`` (glTF) to linear light (IEC 61966-2-1).

    Invisible materials become opaque: exporters do not agree on which end of Collada's
    transparency is the clear one.
    """
    for material in tree.get("materials", ()):
        factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor")
        if factor is not None:
            factor[:3] = [_linear(value) for value in factor[:3]]
            factor[3:] = [alpha or 1.0 for alpha in factor[3:]]


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
