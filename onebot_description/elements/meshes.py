"""Locates mesh files, and loads their surfaces for the viewer, the simulation and its sensors.

To publish a description, files are only located. yourdfpy or trimesh loads the surfaces. This
module adds what RViz shows but they ignore: the <unit> of a Collada file, surfaces with a broken
material, textures wherever they are, and that y is up in glTF, which is turned as in RViz 15.1.4
(2025) and later. As in all of them, <up_axis> has no effect. yourdfpy and trimesh are imported in
functions, because they are slow to import.
"""

import io
import re
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote
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
_MAX_BYTES = 100_000_000  # readers take ten times as much memory
_LOOKS = ("bind_material", "library_materials", "library_effects", "library_images")
# Options before the name of a texture in a .mtl file; -s, -o and -t take up to three numbers.
_NUMBERS = r"(?:\s+[-+]?[\d.]+(?:[eE][-+]?\d+)?(?=\s)){1,3}"
_OPTIONS = re.compile(rf"(?:-[sot]{_NUMBERS}\s+|-mm\s+\S+\s+\S+\s+|-[a-z]+\s+\S+\s+)*")
GLTF_SUFFIXES = (".glb", ".gltf")
_WARNINGS = "warnings"  # key in a scene's metadata
_MATERIAL = re.compile(rb"^\s*usemtl\s", re.MULTILINE)


def locate_mesh(resources: Resources, uri: str, scale: Triple = (1.0, 1.0, 1.0)) -> Mesh:
    """Return the mesh that ``uri`` names, with its file, or the reason why there is none."""
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
        return f"{shown_path(path)}: {'is not a file' if path.exists() else 'no such file'}"
    if path.suffix.lower() not in MESH_SUFFIXES:
        kinds = ", ".join(MESH_SUFFIXES)
        return f'"{path.name}" has an unsupported format; convert it to one of: {kinds}'
    return ""


class _Files:
    """Reads the files that a mesh file names, such as its textures, for trimesh.

    Attributes:
        missing: names of missing files.
    """

    def __init__(self, mesh: Path) -> None:
        self._folder = mesh.parent
        self.missing: dict[str, None] = {}

    def get(self, name: str) -> bytes:
        name = name.strip()
        written = name[_OPTIONS.match(name).end() :].strip("\"'")  # type: ignore[union-attr]
        slashed = written.replace("\\", "/")
        for choice in (name, written, unquote(written), slashed, PureWindowsPath(written).name):
            if (path := self._folder / choice).is_file():
                return path.read_bytes()
        self.missing[written] = None
        raise FileNotFoundError(name)

    __getitem__ = get


def look_warnings(scene: "trimesh.Scene") -> list[str]:
    """Return a sentence for each texture or material file that a scene of ``mesh_scene`` lacks."""
    return list(scene.metadata.get(_WARNINGS, ()))


def mesh_scene(mesh: Mesh, *, materials: bool = True) -> "trimesh.Scene":
    """Return the surfaces of a mesh file, in meters, unscaled, with z up.

    Raises:
        OneBotError: the file cannot be read, or has no triangles.
    """
    import trimesh

    path = mesh.path
    if path is None:
        raise OneBotError(mesh.problem)
    files, suffix = _Files(path), path.suffix.lower()
    try:
        _check_file(path)
        if suffix == ".dae":
            scene = _collada_scene(path, files, materials).convert_units("meters")
        else:
            scene = _load(path, files)
    except OneBotError:
        raise
    except Exception as error:  # trimesh and its parsers raise exceptions of many types
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        text = f"{path} cannot be read: {reason}; is it malformed or truncated?"
        raise OneBotError(text) from error
    parts = scene.geometry.values()
    if not any(isinstance(part, trimesh.Trimesh) and len(part.faces) for part in parts):
        raise OneBotError(f"{path} has no triangles, or is truncated; export it again")
    if suffix in GLTF_SUFFIXES:  # its y, which is up, becomes z
        scene.apply_transform([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    text = "it is drawn without this file, which is missing"
    scene.metadata[_WARNINGS] = [f"{shown_path(path)}: {text}: {name}" for name in files.missing]
    return scene


class ColoredTriangles(NamedTuple):
    """Triangles of one color."""

    corners: "NDArray[np.float64]"  # (N, 3, 3), m
    color: "NDArray[np.float64]"  # (3,), sRGB, 0 to 1


def colored_triangles(path: Path) -> list[ColoredTriangles]:
    """Return the surfaces of a Collada file that has only colored triangles in meters.

    They equal those of ``mesh_scene``, without the imports of trimesh (0.3 s) and pycollada
    (0.02 s). For any other file, the result is empty.
    """
    if path.suffix.lower() != ".dae":
        return []
    try:
        _check_file(path)
        return [*_PlainCollada(path).triangles()]
    except Exception:  # the file is not plain, or is broken, as ``mesh_scene`` explains
        return []


class _PlainCollada:
    """A Collada file without transforms and textures; any other file raises an exception."""

    def __init__(self, path: Path) -> None:
        self._root = ElementTree.parse(path).getroot()
        (unit,) = self._all("asset/unit")
        (self._scene,) = self._all("library_visual_scenes/visual_scene")
        _require(float(unit.get("meter", "1")) == 1.0)
        self._named = {f"#{element.get('id')}": element for element in self._root.iter()}

    def _all(self, path: str, root: ElementTree.Element | None = None) -> list[ElementTree.Element]:
        where = "/".join("{*}" + name for name in path.split("/"))
        return (self._root if root is None else root).findall(where)

    def triangles(self) -> "Iterator[ColoredTriangles]":
        """Yield the triangles of each part, in the order of the scene."""
        for node in self._all("node", self._scene):
            (instance,) = node
            _require(instance.tag.endswith("}instance_geometry"))
            colors = {
                bound.get("symbol"): self._color(bound.get("target", ""))
                for bound in self._all("bind_material/technique_common/instance_material", instance)
            }
            (mesh,) = self._named[instance.get("url", "")]
            for part in mesh:
                kind = part.tag.rpartition("}")[2]
                _require(kind in ("source", "vertices", "triangles"))
                if kind == "triangles":
                    yield ColoredTriangles(self._corners(part), colors[part.get("material")])

    def _color(self, material: str) -> "NDArray[np.float64]":
        import numpy as np

        (effect,) = self._all("instance_effect", self._named[material])
        (technique,) = self._all("profile_COMMON/technique", self._named[effect.get("url", "")])
        (color,) = self._all("diffuse/color", technique[0])
        return np.round(np.fromstring(color.text or "", sep=" ")[:3] * 255.0) / 255.0

    def _corners(self, part: ElementTree.Element) -> "NDArray[np.float64]":
        import numpy as np

        inputs = {element.get("semantic"): element for element in self._all("input", part)}
        offset = int(inputs["VERTEX"].get("offset", "0"))
        stride = 1 + max(int(element.get("offset", "0")) for element in inputs.values())
        (position,) = self._all("input", self._named[inputs["VERTEX"].get("source", "")])
        numbers, common = self._named[position.get("source", "")]
        (accessor,) = common
        (indices,) = self._all("p", part)
        # float32, as in pycollada.
        places = np.fromstring(numbers.text or "", np.float32, sep=" ")
        rows = np.fromstring(indices.text or "", int, sep=" ")
        _require(
            "COLOR" not in inputs
            and [element.get("name") for element in accessor] == ["X", "Y", "Z"]
            and (accessor.get("stride"), accessor.get("offset", "0")) == ("3", "0")
            and places.size == int(numbers.get("count", ""))
            and rows.size == int(part.get("count", "")) * 3 * stride
            and bool(np.isfinite(places).all() and rows.min() >= 0)
        )
        corners = places.reshape(-1, 3)[rows.reshape(-1, 3, stride)[..., offset]]
        return np.asarray(corners, float)


def _require(condition: bool) -> None:
    if not condition:
        raise ValueError


def _check_file(path: Path) -> None:
    """Reject files for which the mesh readers would give poor error messages."""
    if (size := path.stat().st_size) > _MAX_BYTES:
        limit = _MAX_BYTES // 1_000_000
        raise OneBotError(f"{path} has {size // 1_000_000} MB, more than {limit}; simplify it")
    with path.open("rb") as file:
        if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
            text = "is a Git LFS pointer in place of the mesh; fetch it with git lfs pull"
            raise OneBotError(f"{path} {text}")


def surfaces(scene: "trimesh.Scene") -> list[Any]:
    """Return the parts of a scene as trimesh.Trimesh, each moved to its pose."""
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


def _load(path: Path, files: _Files) -> "trimesh.Scene":
    """Load an STL file with yourdfpy, and others, which have textures, with trimesh."""
    if path.suffix.lower() != ".stl":
        import trimesh

        return trimesh.load_scene(path, resolver=files, ignore_broken=True)
    import yourdfpy

    geometry = yourdfpy.Geometry(mesh=yourdfpy.Mesh(str(path)))
    visual = yourdfpy.Visual(name="shape", geometry=geometry)
    robot = yourdfpy.Robot("robot", links=[yourdfpy.Link("link", visuals=[visual])])
    return yourdfpy.URDF(robot=robot, filename_handler=lambda fname: fname).scene


def has_colors(path: Path, scene: "trimesh.Scene") -> bool:
    """Return whether a mesh file has its own colors, which override the URDF's, as in RViz."""
    suffix = path.suffix.lower()
    if suffix == ".stl":
        return False
    if suffix == ".obj":
        return _MATERIAL.search(path.read_bytes()) is not None
    visuals = [part.visual for part in scene.geometry.values()]
    return any(visual.kind is not None and visual.defined for visual in visuals)


def _collada_scene(path: Path, files: _Files, materials: bool) -> "trimesh.Scene":
    """Load a Collada file; without colors if a broken material would lose surfaces."""
    if not materials:
        return _without_materials(path)
    scene = _load(path, files)
    drawn = len(scene.graph.nodes_geometry)
    if drawn >= path.read_bytes().count(b"<instance_geometry"):
        return scene
    plain = _without_materials(path)
    return plain if len(plain.graph.nodes_geometry) > drawn else scene


def _without_materials(path: Path) -> "trimesh.Scene":
    """Load the surfaces of a Collada file without their materials."""
    import trimesh

    root = ElementTree.parse(path).getroot()
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag.rpartition("}")[2] in _LOOKS:
                parent.remove(child)
    surfaces_alone = io.BytesIO(ElementTree.tostring(root))
    return trimesh.load_scene(surfaces_alone, file_type="dae", ignore_broken=True)
