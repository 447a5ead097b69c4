"""Locates mesh files, and loads their surfaces for the viewer, the simulation and its sensors.

To publish a description, files are only located. yourdfpy loads the surfaces. Added here is what
RViz shows, but yourdfpy ignores: the <unit> of a Collada file, and surfaces with a broken material.
As in both of them, <up_axis> has no effect. yourdfpy and trimesh are imported in functions, because
they are slow to import.
"""

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

from onebot_description.elements.packages import Resources
from onebot_description.elements.urdf import MESH_SUFFIXES, Mesh
from onebot_description.elements.xml import shown_path
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import Triple

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import trimesh
    from numpy.typing import NDArray

_LFS_POINTER = b"version https://git-lfs.github.com/spec/"
_MOST_BYTES = 100_000_000  # readers take ten times as much memory
_LOOKS = ("bind_material", "library_materials", "library_effects", "library_images")
_MATERIAL = re.compile(rb"^\s*usemtl\s", re.MULTILINE)


def locate_mesh(resources: Resources, uri: str, scale: Triple = (1.0, 1.0, 1.0)) -> Mesh:
    """Return the mesh that ``uri`` names, with its file, or with the reason why there is none."""
    try:
        path, uri = resources.locate(uri)
    except OneBotError as error:
        return Mesh(uri, scale, problem=str(error))
    try:
        problem = _unsuitable(path)
    except (OSError, ValueError) as error:
        problem = f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
    return Mesh(uri, scale, None if problem else path, problem)


def _unsuitable(path: Path) -> str:
    """Return why ``path`` cannot be a mesh, without opening it; "" if it can."""
    if not path.is_file():
        return f"{shown_path(path)}: {'is no file' if path.exists() else 'no such file'}"
    if path.suffix.lower() not in MESH_SUFFIXES:
        kinds = ", ".join(MESH_SUFFIXES)
        return f'"{path.name}" is of an unsupported kind; convert it to one of: {kinds}'
    return ""


def mesh_scene(mesh: Mesh, *, materials: bool = True) -> "trimesh.Scene":
    """Return the surfaces of a mesh file, in metres, unscaled.

    Raises:
        OneBotError: the file cannot be read, or has no triangles.
    """
    import trimesh

    path = mesh.path
    if path is None:
        raise OneBotError(mesh.problem)
    try:
        _check_file(path)
        if path.suffix.lower() == ".dae":
            scene = _collada_scene(path, materials).convert_units("meters")
        else:
            scene = _load(path)
    except OneBotError:
        raise
    except Exception as error:  # trimesh and its parsers raise exceptions of many types
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        text = f"{path} cannot be read: {reason}; is it malformed or cut short?"
        raise OneBotError(text) from error
    parts = scene.geometry.values()
    if not any(isinstance(part, trimesh.Trimesh) and len(part.faces) for part in parts):
        raise OneBotError(f"{path} holds no triangles, or is cut short; export it again")
    return scene


class ColoredTriangles(NamedTuple):
    """Triangles of one colour."""

    corners: "NDArray[np.float64]"  # (N, 3, 3), m
    color: "NDArray[np.float64]"  # (3,), sRGB, 0 to 1


def colored_triangles(path: Path) -> list[ColoredTriangles]:
    """Return the surfaces of a Collada file that has nothing but coloured triangles in metres.

    They are those of ``mesh_scene``, without trimesh, which takes 0.3 s to import. Of any other
    file nothing is returned.
    """
    if path.suffix.lower() != ".dae":
        return []
    from collada import Collada

    try:
        _check_file(path)
        document = Collada(str(path))
        if document.assetInfo.unitmeter != 1.0:
            return []
        return [part for node in document.scene.nodes for part in _colored(node)]
    except Exception:  # ``mesh_scene`` says what is wrong with it
        return []


def _colored(node: Any) -> "Iterator[ColoredTriangles]":
    """Yield the triangles below a node of a Collada file.

    Raises:
        ValueError: it has something else, too.
    """
    import numpy as np
    from collada.scene import GeometryNode
    from collada.triangleset import TriangleSet

    if not isinstance(node, GeometryNode):
        if not np.array_equal(node.matrix, np.eye(4)):
            raise ValueError("it is moved")
        for child in node.children:
            yield from _colored(child)
        return
    effects = {material.symbol: material.target.effect for material in node.materials}
    for part in node.geometry.primitives:
        effect = effects[part.material]
        color = np.array(effect.diffuse[:3], float)
        if type(part) is not TriangleSet or part.sources.get("COLOR") or effect.bumpmap:
            raise ValueError("it has more than triangles of one colour")
        corners = np.asarray(part.vertex[part.vertex_index], float)
        if not np.isfinite(corners).all():
            raise ValueError("not finite")
        yield ColoredTriangles(corners, np.round(color * 255.0) / 255.0)


def _check_file(path: Path) -> None:
    """Refuse files that the readers of meshes would explain badly, or not at all."""
    if (size := path.stat().st_size) > _MOST_BYTES:
        most = _MOST_BYTES // 1_000_000
        raise OneBotError(f"{path} is of {size // 1_000_000} MB, more than {most}; simplify it")
    with path.open("rb") as file:
        if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
            text = "is a Git LFS pointer in place of the mesh; fetch it with git lfs pull"
            raise OneBotError(f"{path} {text}")


def surfaces(scene: "trimesh.Scene") -> list[Any]:
    """Return the parts of a scene as trimesh.Trimesh, each at its pose."""
    return [part for part in scene.dump() if hasattr(part, "faces")]


def mesh_corners(mesh: Mesh) -> "NDArray[np.float64]":
    """Return the scaled corners (N, 3) of all triangles of a mesh, m, in its shape's frame."""
    return read_mesh(mesh)[0] * mesh.scale


def read_mesh(mesh: Mesh) -> "tuple[NDArray[np.float64], NDArray[np.intp]]":
    """Return the corners (N, 3) of a mesh file, m, unscaled, and its triangles (M, 3), indices."""
    import numpy as np

    parts = surfaces(mesh_scene(mesh, materials=False))
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = np.concatenate([np.asarray(part.vertices, float) for part in parts])
    faces = [np.asarray(part.faces, np.intp) + at for part, at in zip(parts, starts, strict=False)]
    return corners, np.concatenate(faces)


def _load(path: Path) -> "trimesh.Scene":
    """Load a mesh file with yourdfpy."""
    import yourdfpy

    geometry = yourdfpy.Geometry(mesh=yourdfpy.Mesh(str(path)))
    visual = yourdfpy.Visual(name="shape", geometry=geometry)
    robot = yourdfpy.Robot("robot", links=[yourdfpy.Link("link", visuals=[visual])])
    return yourdfpy.URDF(robot=robot, filename_handler=lambda fname: fname).scene


def has_colors(path: Path, scene: "trimesh.Scene") -> bool:
    """Return whether a mesh file has colours of its own, which override the URDF's, as in RViz."""
    suffix = path.suffix.lower()
    if suffix == ".stl":
        return False
    if suffix == ".obj":
        return _MATERIAL.search(path.read_bytes()) is not None
    visuals = [part.visual for part in scene.geometry.values()]
    return any(visual.kind is not None and visual.defined for visual in visuals)


def _collada_scene(path: Path, materials: bool) -> "trimesh.Scene":
    """Load a Collada file; without colours if a broken material would lose surfaces."""
    scene, drawn = None, 0
    if materials:
        scene = _load(path)
        drawn = len(scene.graph.nodes_geometry)
        if drawn >= path.read_bytes().count(b"<instance_geometry"):
            return scene
    plain = _without_materials(path)
    return scene if scene is not None and len(plain.graph.nodes_geometry) <= drawn else plain


def _without_materials(path: Path) -> "trimesh.Scene":
    """Load the surfaces of a Collada file alone."""
    import trimesh

    root = ElementTree.parse(path).getroot()
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.rpartition("}")[2] in _LOOKS:
                parent.remove(child)
    surfaces_alone = io.BytesIO(ElementTree.tostring(root))
    return trimesh.load_scene(surfaces_alone, file_type="dae", ignore_broken=True)
