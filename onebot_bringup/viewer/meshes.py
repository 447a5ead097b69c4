"""Mesh files as RViz shows them, converted to GLB, which every Rerun viewer reads.

Rerun's own Collada loader ignores <unit> and turns the axes of <up_axis>; RViz (through Assimp)
does the opposite: it scales by <unit> and leaves the axes as they are written. So do we.
"""

import functools
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from onebot_description.description import packages
from onebot_description.description.description import MESH_SUFFIXES
from onebot_description.errors import OneBotError

# Above this many faces sharp edges are not searched for (it takes seconds); shading is then flat.
_MOST_FACES_TO_SMOOTH = 200_000


@dataclass(frozen=True)
class MeshAsset:
    """A mesh ready to be logged.

    Attributes:
        glb: the file as binary glTF.
        bounds: (2, 3), least and greatest corner, metres, before the URDF's scale.
        colored: it has colours of its own, which win over the URDF's, as in RViz.
    """

    glb: bytes
    bounds: NDArray[np.float64]
    colored: bool


def resolve(uri: str) -> Path:
    """Return the file that a URDF's mesh ``filename`` means.

    Raises:
        OneBotError: no such package, file or kind of address.
    """
    try:
        path = packages.resolve(uri, None)
    except OneBotError as error:
        raise OneBotError(f"mesh {error}") from error
    if not path.is_file():
        raise OneBotError(f'mesh "{uri}": there is no file {path}')
    return path


def load_mesh(path: Path) -> MeshAsset:
    """Convert the mesh file at ``path``; the last 64 files are remembered until they change.

    Raises:
        OneBotError: it cannot be read, or holds no surface.
    """
    status = path.stat()
    return _load(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=64)
def _load(path: Path, _modified: int, _size: int) -> MeshAsset:
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        known = ", ".join(MESH_SUFFIXES)
        raise OneBotError(f"mesh {path}: {suffix or 'no suffix'} is none of {known}")
    try:
        scene = trimesh.load_scene(str(path), process=False)
        return _convert(path, suffix, scene)
    except OneBotError:
        raise
    except Exception as error:  # trimesh and its parsers raise whatever they stumble over
        lines = str(error).strip().splitlines()
        reason = lines[0] if lines else type(error).__name__
        raise OneBotError(f"mesh {path}: {reason}") from error


def _convert(path: Path, suffix: str, scene: trimesh.Scene) -> MeshAsset:
    if not any(isinstance(part, trimesh.Trimesh) for part in scene.geometry.values()):
        raise OneBotError(f"mesh {path}: it holds no triangles")
    if suffix == ".glb":
        return MeshAsset(path.read_bytes(), np.asarray(scene.bounds, float), True)
    colored = _has_colors(path, suffix, scene)
    scene = _with_normals(scene, path, suffix)
    if suffix == ".dae":
        scene.apply_transform(np.diag([*[collada_unit(path)] * 3, 1.0]))
    # glTF's colours are linear light, those of the other formats are what is seen.
    adjust = None if suffix == ".gltf" else _linearise
    glb = scene.export(file_type="glb", include_normals=True, tree_postprocessor=adjust)
    return MeshAsset(bytes(glb), np.asarray(scene.bounds, float), colored)


def _has_colors(path: Path, suffix: str, scene: trimesh.Scene) -> bool:
    if suffix == ".stl":
        return False
    if suffix == ".obj":
        return re.search(rb"^\s*usemtl\s", path.read_bytes(), re.MULTILINE) is not None
    visuals = [part.visual for part in scene.geometry.values()]
    return any(visual.kind is not None and visual.defined for visual in visuals)


def _with_normals(scene: trimesh.Scene, path: Path, suffix: str) -> trimesh.Scene:
    """Give what has no normals at its corners round faces and sharp edges."""
    if not _lacks_normals(path, suffix):
        return scene
    shaded = trimesh.Scene()
    for part in scene.dump():
        few = len(part.faces) <= _MOST_FACES_TO_SMOOTH
        shaded.add_geometry(shade(part) if few and not _is_textured(part) else _flat(part))
    return shaded


def _is_textured(mesh: trimesh.Trimesh) -> bool:
    return mesh.visual.kind == "texture" and mesh.visual.uv is not None


def _lacks_normals(path: Path, suffix: str) -> bool:
    if suffix == ".stl":  # it has one a face only
        return True
    pattern = {".obj": rb"^vn\s", ".dae": rb"semantic=[\"']NORMAL"}.get(suffix)
    return pattern is not None and not re.search(pattern, path.read_bytes(), re.MULTILINE)


def shade(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Split ``mesh`` at edges sharper than 30 degrees, so that only round parts look round."""
    joined = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    joined.merge_vertices()
    smooth: trimesh.Trimesh = trimesh.graph.smooth_shade(joined, angle=np.radians(30.0))
    if mesh.visual.kind == "texture":
        smooth.visual = trimesh.visual.TextureVisuals(material=mesh.visual.material)
    elif mesh.visual.defined:  # by corner or face: the split has reordered both
        return _flat(mesh)
    return smooth


def _flat(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    faces = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    normals = np.repeat(mesh.face_normals, 3, axis=0)
    corners = mesh.triangles.reshape(-1, 3)
    flat = trimesh.Trimesh(corners, faces, vertex_normals=normals, process=False)
    if mesh.visual.kind == "texture":
        uv = mesh.visual.uv[mesh.faces].reshape(-1, 2) if _is_textured(mesh) else None
        flat.visual = trimesh.visual.TextureVisuals(uv=uv, material=mesh.visual.material)
    elif mesh.visual.defined:
        flat.visual.vertex_colors = mesh.visual.vertex_colors[mesh.faces].reshape(-1, 4)
    return flat


def collada_unit(path: Path) -> float:
    """Return how many metres a Collada file's unit is (<unit meter="...">; 1 if not said)."""
    for _, element in ET.iterparse(path, events=("end",)):
        tag = element.tag.rpartition("}")[2]
        if tag == "unit":
            return float(element.get("meter", "1"))
        if tag == "asset":
            break
    return 1.0


def _linearise(tree: dict[str, Any]) -> None:
    """Turn the sRGB colours of ``tree`` (glTF) into linear light (IEC 61966-2-1)."""
    for material in tree.get("materials", ()):
        factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor")
        if factor is not None:
            factor[:3] = [_linear(value) for value in factor[:3]]


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
